// path_flight.glsl: what a path takes into a scan, as two RG32UI texels, and its key in the slots of a cell.
//   flight.x  cell, y << 16 | x; NO_FLIGHT for a path that is dead
//   flight.y  its key: the scan's epoch above a permutation of the path's number
//   start.x   place in the cell, 16 bits for x and 15 for y, and in the top bit the hemisphere (1: against path_d)
//   start.y   depth z0 of its start, as float bits
const uint NO_FLIGHT = 0xffffffffu;
const uint KEY_BITS = 20u;
const uint KEY_MASK = (1u << KEY_BITS) - 1u;

// The epoch counts down from scan to scan: a new key is less than whatever an earlier scan left in the slot, so
// nothing has to be cleared.
uniform uint scan_epoch;
uniform uint permutation_seed;

// A bijection of 20 bits: which path comes first in its cell is chance, and can be turned back into the path.
uint permute(uint x)
{
    x ^= permutation_seed & KEY_MASK;
    x = (x * 0x9E375u) & KEY_MASK;
    x ^= x >> 10u;
    x = (x * 0xB5297u) & KEY_MASK;
    return x ^ (x >> 10u);
}

uint unpermute(uint x)
{
    x ^= x >> 10u;
    x = (x * 0x94d27u) & KEY_MASK;
    x ^= x >> 10u;
    x = (x * 0xb94ddu) & KEY_MASK;
    return x ^ (permutation_seed & KEY_MASK);
}

// A path's number runs along its row. The division in float is exact below 2^20; in integers it is slow on llvmpipe.
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

uint pack_place(vec2 place, bool against)
{
    uvec2 q = uvec2(clamp(place, 0.0, 1.0) * vec2(65535.0, 32767.0) + 0.5);
    return q.x | (q.y << 16u) | (against ? 0x80000000u : 0u);
}
