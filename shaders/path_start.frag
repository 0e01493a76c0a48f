// path_start.frag: the first vertex of every path, where the eye sees it [PB InitializeImagePositions].
// Runs over: the pixels of the window. Output: see path_state.glsl
#include "texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "surface.glsl"
#include "camera.glsl"
#include "random.glsl"
#include "direct.glsl"
#include "path_course.glsl"
#include "path_vertex.glsl"
#include "path_next.glsl"
#include "path_state.glsl"

UINT_TEXELS(r32ui, eye_buffer);

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
    if (triangle < 0) {
#ifdef HAS_SKY
#ifdef SPLIT_LIGHT
        direct_part = sky(eye_direction(pixel));
#endif
        leave(pixel, ended(sky(eye_direction(pixel))), 0.0);
#else
        leave(pixel, ended(vec3(0.0)), 0.0);
#endif
        return;
    }
    vec4 plane = plane_met(triangle, pixel);
    vec3 d = eye_direction(pixel), o = eye_origin(pixel);
    vec3 x = o + d * ((plane.w - dot(plane.xyz, o)) / dot(plane.xyz, d));
    Surface s = surface_met(triangle, pixel, x, plane);
    bool front = front_hit(plane.xyz, d);
    float light_point;
    vec3 Le = emitted(s, front, light_point);
    PathVertex v = path_vertex(s, triangle, plane, front, -d);
    PathState next = lit_and_gone_on(v, path_in_image(pixel), vec3(1.0), Le);
#ifdef SPLIT_LIGHT
    direct_part = next.radiance;
#ifdef LAST_VERTEX
    // Ambient light stands for what comes by way of other surfaces.
    direct_part = Le + last_lit;
#endif
#endif
    leave(pixel, next, 0.0);
}
