// light_draw.glsl: light samples that each path draws separately, used if samples shared by a path set would
// correlate the errors of all paths. `glpath.lighting` is the same on the CPU, and defines the densities.
// Needs:  <SCENE>, <CONSTANTS>, <LIGHT_DRAWS>; PARTS: number of parts of the lights, except those of a light tree;
//         surface.glsl, light_sample.glsl
// Frame:  world.
#include <LIGHT_DRAWS>
#ifdef PARTS
// For each part of the lights: the first random number that selects the part, the count of such numbers, and the
// indices of the part's first and last piece.
uniform uvec4 light_parts[PARTS];
#endif
#ifdef HAS_ENVIRONMENT
uniform int sky_halves;            // number of half rows of the environment map
#ifdef HAS_SUN
uniform float sun_share;           // fraction of the sky's light that comes from the sun
#endif
#endif

float fraction(uint number) { return float(number >> 8u) * (1.0 / 16777216.0); }

// Binary search: sets `first` to the last of the entries `first` to `last` whose random numbers begin at or below
// `number`.
#define SEARCH(first, last, number, begins_at)                 \
    while (first < last)                                       \
    {                                                          \
        int middle = (first + last + 1) >> 1;                  \
        if (begins_at(middle) <= number) first = middle;       \
        else last = middle - 1;                                \
    }

uint piece_begins(int piece) { return light_piece_texel(piece, LIGHT_PIECE_CHOICE).x; }

#ifdef HAS_SKY
vec3 perpendicular_to(vec3 unit)
{
    vec3 size = abs(unit), axis = vec3(0.0, 0.0, 1.0);
    if (size.x <= size.y && size.x <= size.z) axis = vec3(1.0, 0.0, 0.0);
    else if (size.y <= size.z) axis = vec3(0.0, 1.0, 0.0);
    return normalize(cross(unit, axis));
}
#endif

#ifdef HAS_ENVIRONMENT
uint half_begins(int half_row) { return sky_half_texel(half_row, SKY_HALF_CHOICE).x; }

uint texel_begins(int at) { return sky_column_texel(at >> 2, SKY_COLUMN_CHOICES)[at & 3]; }

// Draws a direction by the radiance of the environment map, like `Environment.directions`. Its density is sky_pdf()
// divided by `weight`. The weight contains the sine of the angle from up, which `Environment.directions` includes
// in its tents.
vec3 map_drawn(vec3 u, out float weight)
{
    uint number = uint(u.x * 16777216.0) << 8u;
    int first = 0, last = sky_halves - 1;
    SEARCH(first, last, number, half_begins)
    uvec4 of = sky_half_texel(first, SKY_HALF_CHOICE);
    int row = int(of.y >> 1u);
    float lower = (of.y & 1u) != 0u ? -1.0 : 1.0, mass = uintBitsToFloat(of.z), rows = float(sky_size.y), theta;
    // At the poles, radiance is constant beyond the middle of the first and the last row.
    if (int(of.y) == 0 || int(of.y) == 2 * sky_size.y - 1) {
        theta = 2.0 * asin(sqrt(0.5 * u.y * mass));
        if (lower < 0.0) theta = PI - theta;
        weight = 1.0;
    } else if (int(of.y) == 2 * sky_rows_above - 1 || int(of.y) == 2 * sky_rows_above) {
        // Radiance is also constant in the half rows beside the horizon, if the map is not interpolated across the
        // horizon.
        theta = 0.5 * PI + lower * asin(u.y * mass);
        weight = 1.0;
    } else {
        float w = sqrt(u.y);
        theta = (float(row) + 0.5 - lower * (1.0 - w)) * (PI / rows);
        weight = 0.5 * PI / rows * sin(theta) / mass;
    }
    int start = row * sky_size.x;
    first = start;
    last = start + sky_size.x - 1;
    number = uint(u.z * 16777216.0) << 8u;
    SEARCH(first, last, number, texel_begins)
    uint begins = texel_begins(first), ends = first + 1 < start + sky_size.x ? texel_begins(first + 1) : 0xFFFFFFFFu;
    float rest = min(float(number - begins) / float(max(ends - begins, 1u)), 1.0);
    float tent = rest < 0.5 ? sqrt(2.0 * rest) - 1.0 : 1.0 - sqrt(2.0 - 2.0 * rest);
    float phi = (0.5 - (float(first - start) + 0.5 + tent) / float(sky_size.x)) * (2.0 * PI);
    vec3 local = vec3(sin(theta) * vec2(cos(phi), sin(phi)), cos(theta));
    return local.x * sky_middle + local.y * cross(sky_up, sky_middle) + local.z * sky_up;
}

// Draws a direction of the environment map or of the sun; u.x chooses between the two.
vec3 sky_drawn(vec3 u, out float weight)
{
#ifdef HAS_SUN
    if (u.x < sun_share) {
        weight = 1.0;
        float below = 0.5 * sun_square_chord * u.y, r = sqrt(below * (2.0 - below)), phi = 2.0 * PI * u.z;
        vec3 x = perpendicular_to(sun_direction), y = cross(sun_direction, x);
        return r * cos(phi) * x + r * sin(phi) * y + (1.0 - below) * sun_direction;
    }
    u.x = clamp((u.x - sun_share) / max(1.0 - sun_share, 1e-7), 0.0, 0.99999994);
#endif
    return map_drawn(u, weight);
}
#elif defined(HAS_SKY)
// Draws a direction by the sky's radiance: inverts the integral of radiance below an elevation, as `Sky.directions`
// does.
vec3 sky_drawn(vec3 u, out float weight)
{
    weight = 1.0;
    float horizon = dot(sky_horizon, vec3(1.0 / 3.0)), zenith = dot(sky_zenith, vec3(1.0 / 3.0));
    float part = u.x * (horizon + 0.5 * (horizon + zenith)), above = part - horizon;
    float root = horizon + sqrt(max(horizon * horizon + 2.0 * (zenith - horizon) * above, 0.0));
    float z = above < 0.0 ? above / max(horizon, 1e-30) : 2.0 * above / max(root, 1e-30);
    z = clamp(z, -1.0, 1.0);
    float r = sqrt(1.0 - z * z), phi = 2.0 * PI * u.y;
    vec3 x = perpendicular_to(sky_up), y = cross(sky_up, x);
    return r * cos(phi) * x + r * sin(phi) * y + z * sky_up;
}
#endif

#ifdef PORTALS
#include "lights/portals.glsl"
#endif
#ifdef LAMP_RECTANGLES
#include "lights/lamp_rectangles.glsl"
#endif

// Draws a point of a lamp's triangle, as seen from a position. drawn.pdf: on entry, the density of sampling
// by area; on return, the density per area of the point drawn.
void draw_on_triangle(inout LightSample drawn, int triangle, bool front, vec3 numbers, vec3 from)
{
    uvec4 face = face_texel(triangle, FACE_CORNERS);
    vec3 a = vertex_position(face.x), b = vertex_position(face.y), c = vertex_position(face.z);
    // Area-preserving map: `root` selects a line parallel to the edge opposite corner a, and numbers.y a point on
    // that line.
    float root = sqrt(numbers.x), unused;
    drawn.position = mix(a, mix(b, c, numbers.y), root);
#ifdef LAMP_RECTANGLES
    // Each of the two triangles of a rectangular lamp represents the whole lamp.
    SeenRectangle lamp = seen_lamp(triangle, front, from);
    if (lamp.solid_angle > 0.0) {
        vec3 wi = towards_rectangle(lamp, numbers.xy);
        float t = lamp.height / max(-dot(wi, lamp.normal), 1e-9);
        drawn.position = from + t * wi;
        drawn.pdf = lamp_pdf_area(lamp, drawn.pdf, wi, t);
    }
#endif
    vec4 plane = facet_texel(triangle, FACET_PLANE);
    drawn.normal = front ? plane.xyz : -plane.xyz;
    drawn.radiance = emitted(surface_of_triangle(triangle, drawn.position, plane), front, unused);
}

// Draws a light sample of a piece of the lights, as seen from a position. choice: the piece's LIGHT_PIECE_CHOICE;
// numbers: uniform in [0, 1).
LightSample light_on(uvec4 choice, vec3 numbers, vec3 from)
{
    uint kind = choice.w & 7u;
    float weight = uintBitsToFloat(choice.z);
    LightSample drawn;
    drawn.position = drawn.normal = drawn.radiance = vec3(0.0);
    drawn.pdf = weight;
    drawn.kind = kind;
    drawn.cone = vec2(-1.0);
    drawn.quadratic = true;
#ifdef HAS_PROFILES
    drawn.profile = -1;
#endif
    if (kind == LIGHT_AREA) {
        draw_on_triangle(drawn, int(choice.y), (choice.w & 8u) == 0u, numbers, from);
    }
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
    else {
#ifdef HAS_SKY
        if (kind == LIGHT_SKY) {
#ifdef PORTALS
            vec3 wi = sky_drawn(from, numbers, weight);
            float pdf = sky_pdf(from, wi);
#else
            vec3 wi = sky_drawn(numbers, weight);
            float pdf = sky_pdf(wi);
#endif
            drawn.normal = -wi;
            drawn.radiance = sky(wi) * weight;
            drawn.pdf = max(pdf, 1e-30);
            return drawn;
        }
#endif
        int light = int(choice.y);
        uvec3 punctual = punctual_texel(light, PUNCTUAL_KIND).xyz;
        drawn.position = light_texel(light, LIGHT_POSITION).xyz;
        drawn.normal = light_texel(light, LIGHT_DIRECTION).xyz;
        drawn.radiance = light_texel(light, LIGHT_INTENSITY).rgb;
        drawn.cone = light_texel(light, LIGHT_CONE).xy;
        drawn.quadratic = punctual.y != 0u;
#ifdef HAS_PROFILES
        drawn.profile = int(punctual.z) - 1;
#endif
    }
#endif
    return drawn;
}

#ifdef PARTS
// Draws a light sample of one part of the lights, as seen from a position; share: probability of this part.
LightSample light_draw(int part, uvec3 point, vec3 from, out float share)
{
    uvec4 of = light_parts[part];
    share = float(of.y) * (1.0 / 4294967296.0);
    uint number, rest;
    umulExtended(point.x, of.y, number, rest);
    number += of.x;
    int piece = int(of.z), last = int(of.w);
    SEARCH(piece, last, number, piece_begins)
    uvec4 choice = light_piece_texel(piece, LIGHT_PIECE_CHOICE);
    // The remainder of the number is uniform within the piece.
    float u = (float(number - choice.x) + fraction(rest)) / float(max(piece_begins(piece + 1) - choice.x, 1u));
    vec3 numbers = vec3(min(u, 0.99999994), fraction(point.y), fraction(point.z));
    return light_on(choice, numbers, from);
}
#endif
