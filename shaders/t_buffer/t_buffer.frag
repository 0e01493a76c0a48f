// t_buffer.frag: shoots the ray of a pixel that may hit the object; keeps (object, t) if t is less than the stored
// t [TB II.B].
// The depth test implements the rule t' < t. DEPTH_SCALE, a power of two, keeps all bits of t and their order.
#include "t_buffer/t_buffer_ray.glsl"

flat in int primitive;
flat in Target aim;
#ifdef SQUARES
flat in ivec4 own_pixels;
#endif

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };
#endif

layout(location = 0) out uvec2 found;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
#ifdef SQUARES
    if (any(lessThan(pixel, own_pixels.xy)) || any(greaterThan(pixel, own_pixels.zw))) discard;
#endif
#ifdef COUNT_TESTS
    atomicAdd(tests_of_pixel[pixel.y * eye_size.x + pixel.x], 1u);
#endif
    float t = shoot(primitive, aim, pixel);
    if (!(t < NO_HIT)) discard;
    found = uvec2(primitive + 1, floatBitsToUint(t));
    gl_FragDepth = t * DEPTH_SCALE;
}
