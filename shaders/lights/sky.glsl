// sky.glsl: radiance of rays that hit nothing: a blend from the horizon (and below) to the zenith by the sine of the elevation,
// or a bilinearly filtered environment map, and the sun. `glpath.sky.sky` is the same on the CPU.
// Needs:  <SCENE> if HAS_ENVIRONMENT is set; HAS_SUN: the map also has a sun, a disc of constant radiance
// Units:  radiance W sr^-1 m^-2, linear Rec. 709.
#include "sampling/angles.glsl"
#ifdef HAS_ENVIRONMENT
uniform ivec2 sky_size;
uniform vec3 sky_middle;  // unit direction to the middle of the environment map
uniform vec3 sky_up;
// Number of the map's rows above the horizon, if the map is not interpolated across the horizon; otherwise 0.
uniform int sky_rows_above;
#ifdef HAS_SUN
uniform vec3 sun_direction;  // unit direction to the sun
uniform float sun_square_chord;  // squared chord from the middle of the sun to its rim, on the unit sphere
uniform vec3 sun_radiance;

vec3 sun(vec3 direction)
{
    vec3 apart = direction - sun_direction;
    return dot(apart, apart) < sun_square_chord ? sun_radiance : vec3(0.0);
}
#endif

// Returns the radiance of a row, interpolated between two columns; row: clamped to the rows from blended.x to
// blended.y.
vec3 sky_row(int row, ivec2 blended, ivec2 columns, float share)
{
    int first = clamp(row, blended.x, blended.y) * sky_size.x;
    vec3 left = environment_texel(first + columns.x, ENVIRONMENT_RADIANCE).rgb;
    return mix(left, environment_texel(first + columns.y, ENVIRONMENT_RADIANCE).rgb, share);
}

vec3 sky(vec3 direction)
{
    vec3 d = vec3(dot(direction, sky_middle), dot(direction, cross(sky_up, sky_middle)), dot(direction, sky_up));
    vec2 turned = vec2(0.5 - arc_tangent(d.y, d.x) * (0.5 / PI), arc_tangent(length(d.xy), d.z) * (1.0 / PI));
    vec2 at = turned * vec2(sky_size) - 0.5;
    ivec2 texel_at = ivec2(floor(at));
    vec2 share = at - vec2(texel_at);
    ivec2 columns = (ivec2(texel_at.x, texel_at.x + 1) + sky_size.x) % sky_size.x;
    bool is_above = d.z > 0.0;
    ivec2 blended = ivec2(is_above ? 0 : sky_rows_above, (is_above && sky_rows_above > 0 ? sky_rows_above : sky_size.y) - 1);
    vec3 upper = sky_row(texel_at.y, blended, columns, share.x);
    vec3 seen = mix(upper, sky_row(texel_at.y + 1, blended, columns, share.x), share.y);
#ifdef HAS_SUN
    seen += sun(direction);
#endif
    return seen;
}
#else
uniform vec3 sky_zenith;
uniform vec3 sky_horizon;
uniform vec3 sky_up;

vec3 sky(vec3 direction)
{
    return mix(sky_horizon, sky_zenith, clamp(dot(direction, sky_up), 0.0, 1.0));
}
#endif
