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
#include "path_state.glsl"

UINT_TEXELS(r32ui, eye_buffer);
uniform ivec4 image_window;  // x, y of the window's lower left pixel in the image, and the image's size

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
    if (triangle < 0) {
#ifdef HAS_SKY
        leave(pixel, ended(sky(eye_direction(pixel))), 0.0);
#else
        leave(pixel, ended(vec3(0.0)), 0.0);
#endif
        return;
    }
    vec4 plane = facet_texel(triangle, FACET_PLANE);
    vec3 d = eye_direction(pixel);
    vec3 x = eye_position + d * ((plane.w - dot(plane.xyz, eye_position)) / dot(plane.xyz, d));
    Surface s = surface_of_triangle(triangle, x, plane);
    bool front = front_hit(plane.xyz, d);
    float light_point;
    vec3 Le = emitted(s, front, light_point);
    ivec2 whole = pixel + image_window.xy;
    uint path = uint(whole.y * image_window.z + whole.x);
    leave(pixel, path_vertex(path, s, triangle, plane, front, -d, vec3(1.0), Le), 0.0);
}
