// t_buffer_small.comp: the rays at primitives that cover few pixels, a primitive per invocation [TB II.B].
// A rasteriser spends most of its time on setting up primitives of a pixel's size. First each pixel gets the least t
// (SECOND not defined), then the lowest number of those primitives that have it. Primitives of many pixels are marked,
// to be drawn.
// SECOND is another program, and GLSL does not promise that it finds the same bits: so it decides nothing, but goes
// through the rectangles of the first; it takes t a little off where nothing has the very bits; and where it finds
// nothing at all, one of those that the first has hit stays.
#include <T_BUFFER>
#include "t_buffer/t_buffer_ray.glsl"

layout(local_size_x = GROUP) in;

uniform int first;  // number of the first primitive of the kind
uniform int count;  // of them

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };
#endif
layout(std430, binding = 2) buffer Nearest { uint min_t[]; };    // bits of a positive float have its order
layout(std430, binding = 3) buffer Numbers { uint lowest[]; };     // of a primitive, and how sure that is
layout(std430, binding = 4) buffer Large { uint large[]; };        // a bit per primitive
layout(std430, binding = 6) buffer Small { uvec2 rectangles[]; };  // first pixel | y << 16; width | height << 16

const int MAX_PIXELS = 64;
const uint ULPS = 16u;  // that t may differ by from program to program

// The pixels of a small primitive; false where there are none.
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
