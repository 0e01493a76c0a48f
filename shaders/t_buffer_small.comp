// t_buffer_small.comp: the rays at primitives that cover few pixels, a primitive per invocation [TB II.B].
// A rasteriser spends most of its time on setting up primitives of a pixel's size. First each pixel gets the least t
// (SECOND not defined), then the lowest number of those primitives that have it. Primitives of many pixels are marked,
// to be drawn.
#include "t_buffer_ray.glsl"

layout(local_size_x = 64) in;

uniform int first;  // number of the first primitive of the kind
uniform int count;  // of them

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };
#endif
layout(std430, binding = 2) buffer Nearest { uint least_t[]; };  // bits of a positive float have its order
layout(std430, binding = 3) buffer Numbers { uint lowest[]; };
layout(std430, binding = 4) buffer Large { uint large[]; };      // a bit per primitive

const int MOST_PIXELS = 64;

void main()
{
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    int item = int(group * gl_WorkGroupSize.x + gl_LocalInvocationID.x);
    if (item >= count) return;
    int primitive = first + item;
    ivec2 low, high;
    int status = bounds(primitive, low, high);
    if (status == HIDDEN) return;
    int across = high.x - low.x + 1, down = high.y - low.y + 1;
    if (status == AROUND || across > MOST_PIXELS || across * down > MOST_PIXELS)
    {
#ifndef SECOND
        atomicOr(large[item >> 5], 1u << uint(item & 31));
#endif
        return;
    }
    Target aim = target(primitive);
    ivec2 pixel = low;
    for (int i = across * down; i > 0; --i)
    {
        float t = shoot(aim, eye_direction(pixel));
        int at = pixel.y * eye_size.x + pixel.x;
#ifdef SECOND
        if (t < NO_HIT && least_t[at] == floatBitsToUint(t)) atomicMin(lowest[at], uint(primitive));
#else
        if (t < NO_HIT) atomicMin(least_t[at], floatBitsToUint(t));
#ifdef COUNT_TESTS
        atomicAdd(tests_of_pixel[at], 1u);
#endif
#endif
        ++pixel.x;
        if (pixel.x > high.x) pixel = ivec2(low.x, pixel.y + 1);
    }
}
