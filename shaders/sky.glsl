// sky.glsl: what rays see that hit nothing: from the horizon (and below) to the zenith by the sine of the elevation.
// Units:  radiance W sr^-1 m^-2, linear Rec. 709.
uniform vec3 sky_zenith;
uniform vec3 sky_horizon;
uniform vec3 sky_up;

vec3 sky(vec3 direction)
{
    return mix(sky_horizon, sky_zenith, clamp(dot(direction, sky_up), 0.0, 1.0));
}
