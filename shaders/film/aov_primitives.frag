// aov_primitives.frag: AOVs (see aov.glsl) for engines that support every kind of primitive.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface_at.glsl"
#include "camera/camera.glsl"
#include "t_buffer/eye_hit.glsl"
#include "lights/sky.glsl"
#include "lights/background.glsl"

UINT_TEXELS(rg32ui, eye_buffer);  // number of the primitive + 1, and bits of t

// Finds the surface that the ray of a pixel hits. Returns false if the ray hits none, and so sees the sky. d:
// direction of the ray.
bool seen(ivec2 pixel, out vec3 d, out bool front, out Surface s)
{
    uvec2 found = texel(eye_buffer, pixel).rg;
    int primitive = int(found.x) - 1;
    d = eye_direction(pixel);
    if (primitive < 0) return false;
    vec3 origin = eye_origin(pixel);
    s = surface_seen(primitive, pixel, origin, d, eye_hit(primitive, pixel, origin, d, uintBitsToFloat(found.y)));
    front = front_hit(s.normal, d);
    return true;
}

#include "film/aov.glsl"
