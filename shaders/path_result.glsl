// path_result.glsl: what a scan found for a path.
// Needs: path_flight.glsl
#include "constants.glsl"
#include "texels.glsl"
UINT_TEXELS(rgba32ui, path_flights);
UINT_TEXELS(rgba32ui, cell_slots);
TEXELS(rgba32f, cell_found);

const int PATH_DEAD = -3;    // was not launched
const int PATH_LOST = -2;    // lost the roulette of its cell
const int PATH_MISSED = -1;  // nothing lies beyond its start

// The triangle found, or one of the above. `weight`: how many paths of the cell this one stands for.
int path_result(ivec2 path, out float weight)
{
    weight = 1.0;
    uint where = texel(path_flights, path).x;
    if (where == NO_FLIGHT) return PATH_DEAD;
    ivec2 cell = ivec2(where & 0xffffu, where >> 16u);
    uvec4 slots = texel(cell_slots, cell);
    bvec4 own = equal(slots & NUMBER_MASK, uvec4(permute(path_number(path))));
    if (!any(own)) return PATH_LOST;
    uint lost = (slots.x >> NUMBER_BITS) | ((slots.y >> NUMBER_BITS) << 12u);
    weight = 1.0 + 0.25 * float(lost);

    vec4 found = texel(cell_found, cell);
    float word = own.x ? found.x : own.y ? found.y : own.z ? found.z : found.w;
#ifdef PACKED
    if (word >= NOTHING_FOUND) return PATH_MISSED;
    return int((floatBitsToUint(word) - LEAST_NORMAL) & ((1u << ID_BITS) - 1u));
#else
    return word == 0.0 ? PATH_MISSED : int(floatBitsToUint(word) - LEAST_NORMAL);
#endif
}
