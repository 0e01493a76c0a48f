// aov.frag: what the eye sees of the surfaces themselves, for a denoiser or a compositor.
// Needs:  <SCENE>; AOV_QUANTA: of the sums, per unit
// Runs over: the pixels of the window. Output: the sums of albedo and normal, whole numbers of quanta, which add up to
//         the same in any order: (albedo, normal.x), (normal.yz, 0, normals that were dropped as not finite)
// Frame:  world. Units: none; a normal's coordinates are 1 more than they are, as sums cannot be negative.
//
//   albedo: diffuse reflectance, and where light comes from the surface itself or from the sky, its radiance too: cut
//           at 1, as Open Image Denoise wants it, lamps and a bright sky are white
//   normal: unit, to shade with, on the side that is seen; 0 where nothing is
#include "texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "surface.glsl"
#include "camera.glsl"
#include "sky.glsl"

UINT_TEXELS(r32ui, eye_buffer);
UINT_TEXELS(rgba32ui, sum_first);
UINT_TEXELS(rgba32ui, sum_second);
layout(location = 0) out uvec4 first;
layout(location = 1) out uvec4 second;

void look(ivec2 pixel, out vec3 albedo, out vec3 normal)
{
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
    vec3 d = eye_direction(pixel), o = eye_origin(pixel);
    albedo = sky(d);
    normal = vec3(0.0);
    if (triangle >= 0) {
        vec4 plane = plane_met(triangle, pixel);
        vec3 x = o + d * ((plane.w - dot(plane.xyz, o)) / dot(plane.xyz, d));
        Surface s = surface_met(triangle, pixel, x, plane);
        bool front = front_hit(plane.xyz, d);
        float light_point;
        albedo = bsdf_albedo(bsdf_at(s, front)) + emitted(s, front, light_point);
        normal = shading_normal(s, front, -d);
    }
}

// Asked of the bits, as a compiler may turn a comparison around, which is not the same for a NaN.
bool is_finite(vec3 value)
{
    return all(notEqual(floatBitsToUint(value) & 0x7f800000u, uvec3(0x7f800000u)));
}

uvec3 quanta(vec3 value)
{
    return is_finite(value) ? uvec3(value * AOV_QUANTA + 0.5) : uvec3(0u);
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 albedo, normal;
    look(pixel, albedo, normal);
    uvec3 a = quanta(min(albedo, 1.0)), n = quanta(1.0 + normal);
    first = texel(sum_first, pixel) + uvec4(a, n.x);
    second = texel(sum_second, pixel) + uvec4(n.yz, 0u, is_finite(normal) ? 0u : 1u);
}
