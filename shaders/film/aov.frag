// aov.frag: AOVs (see aov.glsl) for engines that only support triangles.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "camera/camera.glsl"
#include "lights/sky.glsl"
#include "lights/background.glsl"
#ifdef FOLLOWS_MIRRORS
#include "scene/ray_bvh.glsl"
#include "film/followed.glsl"
#endif

UINT_TEXELS(r32ui, eye_buffer);  // number of the triangle + 1

// Finds the surface that the ray of a pixel hits. Returns false if the ray hits none, and so sees the sky. d:
// direction of the ray.
bool seen(ivec2 pixel, out vec3 d, out bool front, out Surface s)
{
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
    d = eye_direction(pixel);
    if (triangle < 0) return false;
    vec3 o = eye_origin(pixel);
    vec4 plane = hit_plane(triangle, pixel);
    vec3 x = o + d * ((plane.w - dot(plane.xyz, o)) / dot(plane.xyz, d));
    s = hit_surface(triangle, pixel, x, plane);
    front = front_hit(plane.xyz, d);
    return true;
}

#include "film/aov.glsl"
