// path_result.glsl: looks up the result of a scan for one path.
// Needs: ray_record.glsl
#include <CONSTANTS>
#include "gl/texels.glsl"
#ifdef PACKED
#include "path/scan_word.glsl"
#endif
UINT_TEXELS(rgba32ui, ray_records);
UINT_TEXELS(rgba32ui, cell_slots);
TEXELS(rgba32f, cell_found);

// Returns the index of the triangle that the path hit (0 for any hit with OCCLUSION), or PATH_DEAD, PATH_LOST or
// PATH_MISSED. `weight`: number of paths that this one represents, itself included, because a crowded cell loses
// paths.
int path_result(ivec2 path, out float weight)
{
    weight = 1.0;
    uint where = texel(ray_records, path).x;
    if (where == NO_RAY) return PATH_DEAD;
    ivec2 cell = ivec2(where & 0xffffu, where >> 16u);
    uvec4 slots = texel(cell_slots, cell);
    bvec4 own = equal(slots & NUMBER_MASK, uvec4(permute(path_number(path))));
    if (!any(own)) return PATH_LOST;
    uint lost = (slots.x >> NUMBER_BITS) | ((slots.y >> NUMBER_BITS) << 12u);
    weight = 1.0 + 0.25 * float(lost);

    vec4 found = texel(cell_found, cell);
    float word = own.x ? found.x : own.y ? found.y : own.z ? found.z : found.w;
#if defined(OCCLUSION)
    return word >= NOTHING_FOUND ? PATH_MISSED : 0;
#elif defined(PACKED)
    return word >= NOTHING_FOUND ? PATH_MISSED : triangle_of_word(word);
#else
    return word == 0.0 ? PATH_MISSED : int(floatBitsToUint(word) - MIN_NORMAL);
#endif
}

// Events that a scan adds for a launched path, in the format of accumulate.glsl: one ray cast, and one lost ray if
// the path lost its slot.
float scan_events(int found)
{
    return found == PATH_LOST ? float((1 << CAST_BITS) + 1) : 1.0;
}
