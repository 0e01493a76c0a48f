// aov.glsl: properties of the surfaces that the eye sees, for a denoiser or a compositor.
// Needs:  <SCENE>, surface.glsl, camera.glsl, background.glsl; seen() of the including shader; AOV_QUANTA: quanta
//         per unit of a colour or normal; AOV_SURFACE, AOV_POSITION, AOV_UV, AOV_NEAREST: defined for sums that are
//         requested, as the location of the sum's first output; with _1: location of its second output
// Runs over: the pixels of the window. Output: sums of integer quanta, which are the same in any order of addition
// Frame:  world. Units: lengths in scene units; components of normals are stored plus 1, so that none is negative.
//
//   AOV_SURFACE  first   albedo; normal.x
//                second  normal.yz; 0; number of normals dropped because they were not finite
//     albedo: diffuse reflectance plus radiance that the surface or the sky emits, clipped at 1 as Open Image Denoise expects;
//             lamps and a bright sky are white
//             FOLLOWS_MIRRORS: albedo and normal of the surfaces visible in mirrors and through clear glass; the
//             albedo is multiplied by the fraction of light from there
//     normal: unit shading normal on the visible side; 0 without a hit
//   AOV_POSITION    low     low words of position and of depth along the view (distance in a panorama), in two's complement
//                high    high words; that of depth also has the number of hits, above its low
//                        HITS_SHIFT bits
//   AOV_UV       uv_low  low words of u and v, in the format of AOV_POSITION
//                uv_high high words; the last also has the number of hits
//   AOV_NEAREST  nearest  minimum depth, stored as the bits of infinity minus those of the depth, because the
//                         maximum is kept; 0 without a hit
uniform float position_quanta;  // number of quanta per scene unit in sums of positions
uniform float position_extent;  // absolute coordinates and depths are clamped to this, in scene units
uniform float uv_quanta;     // number of quanta per unit in sums of texture coordinates
uniform float uv_extent;

UINT_TEXELS(rgba32ui, sum_first);
UINT_TEXELS(rgba32ui, sum_second);
UINT_TEXELS(rgba32ui, sum_low);
UINT_TEXELS(rgba32ui, sum_high);
UINT_TEXELS(rgba32ui, sum_uv_low);
UINT_TEXELS(rgba32ui, sum_uv_high);
UINT_TEXELS(r32ui, sum_nearest);
#ifdef AOV_SURFACE
layout(location = AOV_SURFACE) out uvec4 first;
layout(location = AOV_SURFACE_1) out uvec4 second;
#endif
#ifdef AOV_POSITION
layout(location = AOV_POSITION) out uvec4 low;
layout(location = AOV_POSITION_1) out uvec4 high;
#endif
#ifdef AOV_UV
layout(location = AOV_UV) out uvec4 uv_low;
layout(location = AOV_UV_1) out uvec4 uv_high;
#endif
#ifdef AOV_NEAREST
layout(location = AOV_NEAREST) out uint nearest;
#endif

// Tests bits, because compilers may invert a comparison, which changes the result for NaN.
bool is_finite(vec3 value)
{
    return all(notEqual(floatBitsToUint(value) & 0x7f800000u, uvec3(0x7f800000u)));
}

uvec3 quanta(vec3 value)
{
    return is_finite(value) ? uvec3(value * AOV_QUANTA + 0.5) : uvec3(0u);
}

#ifdef AOV_SURFACE
void add_surface(ivec2 pixel, bool hit, bool front, vec3 d, Surface s)
{
    vec3 share = vec3(1.0), normal = vec3(0.0);
    bool straight = true;
#ifdef FOLLOWS_MIRRORS
#ifdef HAS_ALPHA
    new_opacity_key(pixel + eye_corner, 1u);
#endif
    share = follow(hit, d, front, s, eye_origin(pixel), straight);
#endif
    vec3 albedo = straight ? seen_behind(d) : sky(d);
    if (hit) {
        float pdf_area;
        albedo = bsdf_albedo(bsdf_at(s, front)) + emitted(s, front, pdf_area);
        normal = shading_normal(s, front, -d);
    }
    albedo *= share;
    uvec3 a = quanta(min(albedo, 1.0)), n = quanta(1.0 + normal);
    first = texel(sum_first, pixel) + uvec4(a, n.x);
    second = texel(sum_second, pixel) + uvec4(n.yz, 0u, is_finite(normal) ? 0u : 1u);
}
#endif

#if defined(AOV_POSITION) || defined(AOV_NEAREST)
// Depth along the view, or the distance in a panorama.
float depth_of(vec3 position)
{
#ifdef EYE_PANORAMA
    return length(position - eye_position);
#else
    return max(eye_from_world(position).z + eye_ahead, 0.0);
#endif
}
#endif

#ifdef AOV_NEAREST
void keep_nearest(ivec2 pixel, bool hit, vec3 position)
{
    nearest = texel(sum_nearest, pixel).r;
    if (!hit || !is_finite(position)) return;
    nearest = max(nearest, 0x7f800000u - floatBitsToUint(min(depth_of(position), position_extent)));
}
#endif

#if defined(AOV_POSITION) || defined(AOV_UV)
// Adds a value as integer quanta to sums of two words each. Also counts one hit, in the bits of higher.w above the
// low HITS_SHIFT.
void add_exactly(inout uvec4 lower, inout uvec4 higher, vec4 value, float per_unit, float extent)
{
    vec4 scaled = floor(clamp(value, -extent, extent) * per_unit + 0.5);
    bvec4 negative = lessThan(scaled, vec4(0.0));
    scaled = abs(scaled);
    vec4 upper = floor(scaled * (1.0 / 4294967296.0));
    uvec4 words = uvec4(scaled - upper * 4294967296.0), upper_words = uvec4(upper);
    // Two's complement: invert all bits and add one.
    uvec4 turned = uvec4(negative) * 0xffffffffu;
    words ^= turned;
    upper_words ^= turned;
    uvec4 one = uvec4(negative);
    words += one;
    upper_words += one * uvec4(equal(words, uvec4(0u)));
    uvec4 before = lower;
    lower += words;
    higher += upper_words + uvec4(lessThan(lower, before));
    higher.w += 1u << HITS_SHIFT;
}
#endif

#ifdef AOV_POSITION
void add_position(ivec2 pixel, bool hit, vec3 position)
{
    low = texel(sum_low, pixel);
    high = texel(sum_high, pixel);
    if (hit && is_finite(position)) add_exactly(low, high, vec4(position, depth_of(position)), position_quanta, position_extent);
}
#endif

#ifdef AOV_UV
void add_uv(ivec2 pixel, bool hit, vec2 uv)
{
    uv_low = texel(sum_uv_low, pixel);
    uv_high = texel(sum_uv_high, pixel);
    if (hit && is_finite(vec3(uv, 0.0))) add_exactly(uv_low, uv_high, vec4(uv, 0.0, 0.0), uv_quanta, uv_extent);
}
#endif

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 d;
    bool front;
    Surface s;
    bool hit = seen(pixel, d, front, s);
#ifdef AOV_SURFACE
    add_surface(pixel, hit, front, d, s);
#endif
#ifdef AOV_POSITION
    add_position(pixel, hit, s.position);
#endif
#ifdef AOV_UV
    add_uv(pixel, hit, s.uv);
#endif
#ifdef AOV_NEAREST
    keep_nearest(pixel, hit, s.position);
#endif
}
