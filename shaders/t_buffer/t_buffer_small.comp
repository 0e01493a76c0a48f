// t_buffer_small.comp: shoots the rays at primitives that cover few pixels, one primitive for each invocation [TB
// II.B].
// A rasteriser spends most of its time on the setup of pixel-sized primitives. The first program (SECOND not
// defined) finds the minimum t of each pixel. The second finds the lowest number among primitives with that t.
// Primitives of many pixels are marked, to be drawn.
// SECOND is another program, and GLSL does not guarantee that it computes the same bits. It therefore uses the
// rectangles of the first program. If no primitive has exactly the minimum t, it accepts a slightly different t. If
// it finds no primitive at all, one that the first program has hit stays.
#include <T_BUFFER>
#include "t_buffer/t_buffer_ray.glsl"

layout(local_size_x = GROUP) in;

uniform int first;  // index of the first primitive of this kind
uniform int count;  // number of primitives

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };
#endif
layout(std430, binding = 2) buffer Nearest { uint min_t[]; };    // bits of positive floats, which have the same order
layout(std430, binding = 3) buffer Numbers { uint lowest[]; };     // number of a primitive, and how exact its t is
layout(std430, binding = 4) buffer Large { uint large[]; };        // one bit per primitive
layout(std430, binding = 6) buffer Small { uvec2 rectangles[]; };  // first pixel | y << 16; width | height << 16

const int MAX_PIXELS = 64;
const uint ULPS = 16u;  // maximum difference of t between programs, in units in the last place

// Sets the rectangle of pixels of a small primitive; returns false if it has none. Marks a primitive that is not
// small.
bool small_rectangle(int item, int primitive, out ivec2 low, out ivec2 size)
{
#ifdef SECOND
    uvec2 rectangle = rectangles[item];
    low = ivec2(rectangle.x & 0xffffu, rectangle.x >> 16u);
    size = ivec2(rectangle.y & 0xffffu, rectangle.y >> 16u);
    return size.x > 0;
#else
    ivec2 high;
    int status = bounds(primitive, low, high);
    size = high - low + 1;
    bool many = status == AROUND || size.x > MAX_PIXELS || size.x * size.y > MAX_PIXELS;
    bool few = status != HIDDEN && !many;
    if (status != HIDDEN && many) atomicOr(large[item >> 5], 1u << uint(item & 31));
    rectangles[item] = few ? uvec2(low.x | low.y << 16, size.x | size.y << 16) : uvec2(0u);
    return few;
#endif
}

void main()
{
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    int item = int(group * gl_WorkGroupSize.x + gl_LocalInvocationID.x);
    if (item >= count) return;
    int primitive = first + item;
    ivec2 low, size;
    if (!small_rectangle(item, primitive, low, size)) return;
    Target aim = target(primitive);
    ivec2 pixel = low;
    for (int i = size.x * size.y; i > 0; --i)
    {
        float t = shoot(primitive, aim, pixel);
        int at = pixel.y * eye_size.x + pixel.x;
        uint bits = floatBitsToUint(t);
#ifdef SECOND
        uint off = uint(abs(int(bits - min_t[at])));
        if (t < NO_HIT && off <= ULPS) atomicMin(lowest[at], uint(primitive) | (off == 0u ? EXACT : NEARLY_EXACT));
#else
        if (t < NO_HIT && atomicMin(min_t[at], bits) > bits) atomicExchange(lowest[at], uint(primitive) | HIT);
#ifdef COUNT_TESTS
        atomicAdd(tests_of_pixel[at], 1u);
#endif
#endif
        ++pixel.x;
        if (pixel.x >= low.x + size.x) pixel = ivec2(low.x, pixel.y + 1);
    }
}
