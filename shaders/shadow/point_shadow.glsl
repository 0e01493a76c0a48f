// point_shadow.glsl: visibility of a point light from a point on a surface, looked up in the light's shadow-buffer [TB III.D].
// Needs:  <SCENE>; SHADOW_CUBE as for point_shadow_map.glsl
//         SHADOW_TAPS      number of cells across, and up, that a lookup tests; 1: only the nearest, without a
//                          filter
//         SHADOW_IDENTITY  the paper's rule, which compares objects; otherwise distances are compared
// Frame:  world. The buffers of all lights are tiles of one texture.
//
// An entry holds the primitive that its ray hits, and the tangent plane there as the vector g, where g . x = 1 for
// points x of the plane, relative to the light. The distance t of the plane along a direction c is thus 1 / (g .
// c). Comparing this distance with that of the receiver's own plane needs no trigonometry, square root or division.
#include "gl/texels.glsl"
#include "shadow/point_shadow_map.glsl"
#include <SCENE>

UINT_TEXELS(rgba32ui, shadow_buffer);  // bits of the plane; number of the primitive + 1, 0 for an empty cell
TEXELS(rgba32f, shadow_lights);  // position of each light, in one texel for each tile
uniform int shadow_tiles_across;

// Rounding error of a point, as a fraction of its coordinates and the light's.
const float SHADOW_ROUNDING = 5e-7;

// Maximum slope, 1 / cos of the angle between an entry's normal and the light, for spheres and ellipsoids. A
// steeper entry is near the outline.
const float SHADOW_STEEPEST = 4.0;

ivec2 shadow_tile(int light) { return ivec2(light % shadow_tiles_across, light / shadow_tiles_across); }

// Returns an entry's texel; cell: position in cells of its face.
ivec2 shadow_texel(int light, int face, vec2 cell)
{
#ifdef SHADOW_CUBE
    const ivec2 faces = ivec2(3, 2);
#else
    const ivec2 faces = ivec2(1, 1);
#endif
    ivec2 tile = ivec2(face % faces.x, face / faces.x);
    return (shadow_tile(light) * faces + tile) * ivec2(shadow_cells) + ivec2(cell);
}

// Finds a cell that may lie beyond the edge of `face`; returns the face that has it, and the cell on that face.
ShadowPosition shadow_home(int face, vec2 cell)
{
#ifdef SHADOW_CUBE
    ShadowPosition home = shadow_position(shadow_direction(face, cell + 0.5));
    return ShadowPosition(home.face, shadow_cell(home.at));
#else
    bool south = cell.y < 0.0, north = cell.y >= shadow_cells.y;
    if (south) cell.y = -1.0 - cell.y;
    if (north) cell.y = 2.0 * shadow_cells.y - 1.0 - cell.y;
    if (south || north) cell.x += floor(0.5 * shadow_cells.x);
    cell.x -= shadow_cells.x * floor((cell.x + 0.5) / shadow_cells.x);
    return ShadowPosition(0, cell);
#endif
}

#ifdef SHADOW_IDENTITY
// Returns true if the light sees another object in this cell, or none [TB (8)]. This is wrong for objects that
// shadow themselves.
bool shadow_entry_hides(uvec4 seen, int object)
{
    return seen.w == 0u || shape_of(int(seen.w) - 1) != object;
}
#else
// Returns true if the surface that the entry's ray hits along c (unit) occludes the point w; c and w are relative
// to the light. `receiver` is the plane of the point, in the format of the entry's g.
//
// First, the entry must be nearer along c than the receiver's plane, so no slope makes the receiver shadow itself.
// This also decides at a ridge, where the cell may see the other side of the edge: the receiver's plane, extended
// past the edge, is nearer.
// Second, at a valley the cell may see the other side of the edge, too, and the entry is nearer. The entry's plane,
// extended to the point, is then behind the point. Both planes meet between c and w, which are an angle a apart. In
// a valley, t of the entry is therefore at least |w| - |w| a (1 / cos + 1 / cos'), with the cosines of both planes
// to the light. A nearer entry is always an occluder; otherwise its plane decides. A convex occluder's tangent
// plane hides all points that the occluder hides, so no true shadow is lost. Near the outline of a sphere the
// tangent plane soon leaves the sphere, so the slope is limited there.
bool shadow_entry_hides(uvec4 seen, vec3 c, vec3 w, vec3 receiver, float rounding)
{
    vec3 g = uintBitsToFloat(seen.xyz);
    float entry = dot(g, c), own = dot(receiver, c), length_g = length(g), length_r = length(receiver);
    if (entry - own <= rounding * (length_g * abs(entry) + length_r * abs(own))) return false;
    float r = length(w);
    float slope = length_g / max(entry, 1e-30);
    float slopes = r * length_r + (seen.w <= uint(first_triangle) ? min(slope, SHADOW_STEEPEST) : slope);
    float min_distance = r * (1.0 - distance(w / r, c) * slopes);
    return entry * min_distance > 1.0 || dot(g, w) > 1.0 + 2.0 * rounding * length_g;
}
#endif

// Returns the fraction of light that reaches `position` on a surface of an object with this normal (of either
// side). The filter is a box over SHADOW_TAPS - 1 cells around the point, so the result changes continuously with
// the point (percentage-closer filtering: Reeves et al. 1987). With 2 taps it is bilinear interpolation.
float point_light_visibility(int light, vec3 position, vec3 normal, int object)
{
    vec3 centre = texel(shadow_lights, shadow_tile(light)).xyz;
    vec3 w = position - centre;
    float height = dot(normal, w);
    vec3 receiver = normal / (abs(height) > 1e-30 ? height : 1e-30);
    vec3 size = abs(position) + abs(centre);
    float rounding = SHADOW_ROUNDING * max(size.x, max(size.y, size.z));

    ShadowPosition position_in_buffer = shadow_position(w);
    const float extent = float(SHADOW_TAPS - 1);
#if SHADOW_TAPS == 1
    vec2 first = shadow_cell(position_in_buffer.at), part = vec2(0.0);
#else
    vec2 first = floor(position_in_buffer.at - 0.5 * extent), part = position_in_buffer.at - 0.5 * extent - first;
#endif
    float lit = 0.0;
    for (int y = 0; y < SHADOW_TAPS; ++y) {
        for (int x = 0; x < SHADOW_TAPS; ++x) {
            ShadowPosition tap = ShadowPosition(position_in_buffer.face, first + vec2(x, y));
#if SHADOW_TAPS > 1
            tap = shadow_home(tap.face, tap.at);
#endif
            uvec4 seen = texel(shadow_buffer, shadow_texel(light, tap.face, tap.at));
#ifdef SHADOW_IDENTITY
            bool hidden = shadow_entry_hides(seen, object);
#else
            vec3 c = normalize(shadow_direction(tap.face, tap.at + 0.5));
            bool hidden = shadow_entry_hides(seen, c, w, receiver, rounding);
#endif
            vec2 weight = vec2(x == 0 ? 1.0 - part.x : x == SHADOW_TAPS - 1 ? part.x : 1.0,
                               y == 0 ? 1.0 - part.y : y == SHADOW_TAPS - 1 ? part.y : 1.0);
            lit += hidden ? 0.0 : weight.x * weight.y;
        }
    }
    return lit / max(extent * extent, 1.0);
}
