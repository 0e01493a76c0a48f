// scan_word.glsl: a float that holds the distance of a hit and, in its ID_BITS lowest bits, the triangle's number.
// These floats have the same order as their bits, so the minimum is the nearest hit.
// Needs:  ID_BITS, DEPTH_LEVELS; NOTHING_FOUND: a float above all that hold a hit
// A distance t, in scene diameters, is quantised to one of DEPTH_LEVELS levels. The level is linear in the bits of
// t + DEPTH_BASE, a piecewise logarithm. Steps between levels are smallest near the path's start. Up to 7/16 of the
// diameter they are at most as large as steps of equal size. (14 bits give equal steps of 6e-5, or these: 1.6e-5 at
// the start, 3.2e-5 from 1/16 of the diameter on, and 6.3e-5 from 3/16 on.)
#include <CONSTANTS>

const int DEPTH_BASE_BITS = floatBitsToInt(DEPTH_BASE);
const float DEPTH_STEP = float(DEPTH_LEVELS) / float(floatBitsToInt(1.0 + DEPTH_BASE) - DEPTH_BASE_BITS);

uvec4 scan_words(vec4 t, uint triangle)
{
    ivec4 level = ivec4(vec4(floatBitsToInt(min(t, 1.0) + DEPTH_BASE) - DEPTH_BASE_BITS) * DEPTH_STEP);
    return ((uvec4(level) << ID_BITS) | uvec4(triangle)) + MIN_NORMAL;
}

int triangle_of_word(float word)
{
    return int((floatBitsToUint(word) - MIN_NORMAL) & ((1u << ID_BITS) - 1u));
}
