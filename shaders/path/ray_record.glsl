// ray_record.glsl: record of a path for a scan, as an RGBA32UI texel.
//   x  cell, y << 16 | x; NO_RAY for a dead path
//   y  number of the next path in the cell's list, or NO_RAY at its end
//   z  position in the cell, 16 bits for x and 15 for y, and in the top bit the hemisphere (1: against path_d)
//   w  depth z0 of the path's start, as float bits
#include <CONSTANTS>
const uint NO_RAY = 0xffffffffu;
const uint NUMBER_MASK = (1u << NUMBER_BITS) - 1u;

uniform uint permutation_seed;

// Bijection of the 20-bit path numbers. It puts the paths of a crowded cell in random order; the first four
// survive.
uint permute(uint x)
{
    x ^= permutation_seed & NUMBER_MASK;
    x = (x * 0x9E375u) & NUMBER_MASK;
    x ^= x >> 10u;
    x = (x * 0xB5297u) & NUMBER_MASK;
    return x ^ (x >> 10u);
}

// Paths are numbered row by row. The float division is exact below 2^20, and integer division is slow on llvmpipe.
uniform int path_columns;

uint path_number(ivec2 path)
{
    return uint(path.y * path_columns + path.x);
}

ivec2 path_of(uint number)
{
    int row = int((float(number) + 0.5) / float(path_columns));
    return ivec2(int(number) - row * path_columns, row);
}

uint pack_position(vec2 position, bool against)
{
    uvec2 q = uvec2(clamp(position, 0.0, 1.0) * vec2(65535.0, 32767.0) + 0.5);
    return q.x | (q.y << 16u) | (against ? 0x80000000u : 0u);
}
