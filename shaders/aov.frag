// aov.frag: what the eye sees of the surfaces themselves, for a denoiser or a compositor.
// Needs:  <SCENE>; ALBEDO or NORMAL, the one that is asked for
// Runs over: the pixels of the window. Output: the sums of this AOV, see accumulate.glsl
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
#include "accumulate.glsl"

UINT_TEXELS(r32ui, eye_buffer);

vec3 seen(ivec2 pixel)
{
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
    vec3 d = eye_direction(pixel);
#ifdef ALBEDO
    if (triangle < 0) return clamp(sky(d), 0.0, 1.0);
#else
    if (triangle < 0) return vec3(1.0);
#endif
    vec4 plane = facet_texel(triangle, FACET_PLANE);
    vec3 x = eye_position + d * ((plane.w - dot(plane.xyz, eye_position)) / dot(plane.xyz, d));
    Surface s = surface_of_triangle(triangle, x, plane);
    bool front = front_hit(plane.xyz, d);
#ifdef ALBEDO
    float light_point;
    return clamp(bsdf_at(s, front).diffuse + emitted(s, front, light_point), 0.0, 1.0);
#else
    return 1.0 + shading_normal(s, front, -d);
#endif
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    accumulate(pixel, vec4(seen(pixel), 0.0));
}
