// accumulate.glsl: adds a sample of radiance to the sums of its pixel, in integers.
// Each channel's sum is a 64-bit integer, stored as a low and a high word. It counts quanta, and a quantum is a
// power of two. Integer addition is associative, so the sums have the same bits however the path sets are split.
//   low.rgb, high.rgb  sums
//   low.a              number of rays cast
//   high.a             number of lost rays; from bit DROPPED_SHIFT on, number of dropped samples
// With SPLIT_LIGHT, the direct light of this sample alone is also written, in quanta; direct_sums.frag adds it to
// its own sums.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include "film/split_light.glsl"
UINT_TEXELS(rgba32ui, sum_low);
UINT_TEXELS(rgba32ui, sum_high);
uniform float quanta;  // number of quanta per unit of radiance

#ifdef COMPUTE
layout(rgba32ui) writeonly uniform uimage2D new_low;
layout(rgba32ui) writeonly uniform uimage2D new_high;
uvec4 low, high;
#ifdef SPLIT_LIGHT
layout(rgba32f) writeonly uniform image2D new_direct;
vec4 direct;
#endif
#else
layout(location = 0) out uvec4 low;
layout(location = 1) out uvec4 high;
#ifdef SPLIT_LIGHT
layout(location = 2) out vec4 direct;
#endif
#endif

// radiance.a: event counts of a path: rays cast in the low CAST_BITS bits, lost rays and cut paths above
// (path_result.glsl)
void accumulate(ivec2 pixel, vec4 radiance)
{
    vec3 scaled = floor(radiance.rgb * quanta + 0.5);
    // Drop NaN, infinities, values that could overflow the words within a block of path sets, and negative values, which light
    // does not have. NaN is detected by bits, because compilers may invert a comparison, which changes the result for NaN.
    uvec3 exponent = floatBitsToUint(scaled) & 0x7f800000u;
    bool bad = any(equal(exponent, uvec3(0x7f800000u))) || any(greaterThan(scaled, vec3(1.0e18)));
#ifdef CONTROL_VARIATE
    bad = bad || any(lessThan(scaled, vec3(-1.0e18)));
#else
    bad = bad || any(lessThan(scaled, vec3(0.0)));
#endif
    if (bad) scaled = vec3(0.0);
#ifdef SPLIT_LIGHT
    direct = vec4(bad ? vec3(0.0) : floor(direct_part * quanta + 0.5), 0.0);
#endif
    vec3 upper = floor(abs(scaled) * (1.0 / 4294967296.0));
    uvec3 add_low = uvec3(abs(scaled) - upper * 4294967296.0), add_high = uvec3(upper);
#ifdef CONTROL_VARIATE
    // Two's complement of a negative number.
    uvec3 minus = uvec3(lessThan(scaled, vec3(0.0))), ones = 0xffffffffu * minus;
    add_low = (add_low ^ ones) + minus;
    add_high = (add_high ^ ones) + minus * uvec3(equal(add_low, uvec3(0u)));
#endif

    uvec4 old_low = texel(sum_low, pixel);
    uvec4 old_high = texel(sum_high, pixel);
    low.rgb = old_low.rgb + add_low;
    high.rgb = old_high.rgb + add_high + uvec3(lessThan(low.rgb, old_low.rgb));
    uint events = uint(radiance.a);
    low.a = old_low.a + (events & ((1u << CAST_BITS) - 1u));
    high.a = old_high.a + (events >> CAST_BITS) + (bad ? 1u << DROPPED_SHIFT : 0u);
#ifdef COMPUTE
    imageStore(new_low, pixel, low);
    imageStore(new_high, pixel, high);
#ifdef SPLIT_LIGHT
    imageStore(new_direct, pixel, direct);
#endif
#endif
}
