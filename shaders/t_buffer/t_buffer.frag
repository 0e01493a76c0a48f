// t_buffer.frag: a ray that may hit the object is shot; (object, t) is kept where t is less than what is there
// [TB II.B].
// The rule t' < t is the depth test. Scaling t by DEPTH_SCALE, a power of two, keeps all its bits and their order.
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
