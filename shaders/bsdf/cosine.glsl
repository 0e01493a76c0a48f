// cosine.glsl: cosine-weighted directions about a normal.
#include <CONSTANTS>
#include "sampling/directions.glsl"

// Maps a point of the unit square to a direction about a unit normal.
vec3 cosine_direction(vec3 normal, vec2 u)
{
    vec3 x, y;
    axes_across(normal, x, y);
    float r = sqrt(u.x), phi = 2.0 * PI * u.y;
    return normalize(r * cos(phi) * x + r * sin(phi) * y + sqrt(1.0 - u.x) * normal);
}
