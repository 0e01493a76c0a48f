// parallel_rays.frag: tests if points see out of the scene along directions that all points share; one bit for each
// direction. Lanes of a vector are neighbouring points with one direction, so their rays visit the same nodes of
// the BVH.
// With thin dielectrics it outputs the transmittance of those that a ray passes, weighted by luminance, instead of
// a bit.
// ASKED: the words have bits already, and bits are cleared if their rays hit something. Scenes in parts are tested
// in this manner, one part after the other.
// Needs:  <SCENE>, <RAY_BVH>
// Runs over: squares of points, stacked for each word of 32 directions; with thin dielectrics for each direction.
// Output: the word, bit k for direction k; or the transmittance
// Frame:  world
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/ray_bvh.glsl"
#ifdef HAS_THIN_DIELECTRICS
// lobes.glsl needs these files for whole paths; here only its thin_transmittance() is called.
#include "scene/surface.glsl"
#include "sampling/random.glsl"
#include "lights/light_sample.glsl"
#include "path/path_vertex.glsl"
#include "bsdf/cosine.glsl"
#include "bsdf/lobes.glsl"
#endif

TEXELS(rgba32f, point_positions);   // a: index of the point + 1, for random numbers; 0 without a point
TEXELS(rgba32f, point_normals);     // directions below this normal's plane are not cast; 0 without a plane
TEXELS(rgba32f, shared_directions); // unit directions, a row of 32 for each word; a: 0 without a direction
uniform int square;                 // number of points along a side of the square
uniform int first_direction;        // index of the first direction, for random numbers

// Returns true if a direction is in front of a point's plane; sets the ray's random numbers.
bool is_cast(float point, vec3 normal, vec4 direction, int number)
{
#ifdef HAS_ALPHA
    opacity_key = pcg(uint(point) + pcg(opacity_seed + uint(first_direction + number)));
#endif
    return direction.w != 0.0 && (normal == vec3(0.0) || dot(direction.xyz, normal) > 0.0);
}

#ifdef HAS_THIN_DIELECTRICS
layout(location = 0) out float share;

const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    int number = at.y / square;
    at.y -= number * square;
    vec4 position = texel(point_positions, at), direction = texel(shared_directions, ivec2(number & 31, number >> 5));
    share = 0.0;
    if (position.w == 0.0 || !is_cast(position.w, texel(point_normals, at).xyz, direction, number)) return;
    if (!is_blocked(position.xyz, direction.xyz, NO_HIT, -1)) share = dot(LUMINANCE, passed_thin_dielectrics);
}
#else
layout(location = 0) out uint seen;

// Returns true if the ray hits nothing. occluder: item that blocked the previous ray. It is tested first, because
// it often blocks the next direction too.
bool sees_out(vec3 origin, vec3 direction, inout int occluder)
{
#if defined(HAS_ALPHA) || defined(HAS_INSTANCES)
    return !is_blocked(origin, direction, NO_HIT, -1);
#else
    Ray ray = ray_along(origin, direction);
    int triangle;
    uint flags;
    bool blocked = occluder >= 0 && meet_item(ray, max(occluder, 0), -1, triangle, flags) < NO_HIT;
    if (!blocked) {
        Walk walk = walk_from_root();
        do
        {
            int item = next_item(walk, ray, NO_HIT);
            float at = item < 0 ? NO_HIT : meet_item(ray, item, -1, triangle, flags);
            blocked = at < NO_HIT;
            occluder = blocked ? item : occluder;
        } while (!blocked && walk_continues(walk));
    }
    return !blocked;
#endif
}

#ifdef ASKED
UINT_TEXELS(r32ui, asked_words);  // words so far, in the format of the output

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    int word = at.y / square;
    seen = texel(asked_words, at).r;
    at.y -= word * square;
    vec3 position = texel(point_positions, at).xyz;
    int occluder = -1, k = 0;
    if (seen != 0u) do
    {
        vec4 direction = texel(shared_directions, ivec2(k, word));
        uint bit = 1u << uint(k);
        // direction.w is set only for directions in which any of the points may hit this part of the scene.
        if ((seen & bit) != 0u && direction.w != 0.0 && !sees_out(position, direction.xyz, occluder)) seen &= ~bit;
    } while (++k < 32);
}
#else
void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    int word = at.y / square;
    at.y -= word * square;
    vec4 position = texel(point_positions, at);
    vec3 normal = texel(point_normals, at).xyz;
    seen = 0u;
    int occluder = -1, k = 0;
    if (position.w != 0.0) do
    {
        vec4 direction = texel(shared_directions, ivec2(k, word));
        if (is_cast(position.w, normal, direction, 32 * word + k) && sees_out(position.xyz, direction.xyz, occluder))
            seen |= 1u << uint(k);
    } while (++k < 32);
}
#endif
#endif
