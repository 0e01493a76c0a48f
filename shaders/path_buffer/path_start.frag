// path_start.frag: first vertex of every path, at the surface that the eye sees [PB InitializeImagePositions], or at a given
// point with START_POINTS.
// Runs over: the pixels of the window. Output: see path_state.glsl
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "camera/camera.glsl"
#include "sampling/random.glsl"
#include "lights/direct.glsl"
#if defined(HAS_SKY) || defined(HAS_BACKGROUND)
#include "lights/background.glsl"
#endif
#include "path/direction_code.glsl"
#include "path/path_vertex.glsl"
#include "path/path_next.glsl"
#include "path/path_state.glsl"
#ifdef START_POINTS
#define START_VERTEX
#include "camera/start_points.glsl"
#endif

UINT_TEXELS(r32ui, eye_buffer);

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
#ifdef START_POINTS
    if (texel(start_positions, pixel).w == 0.0) {
        leave(pixel, ended(vec3(0.0)), 0.0);
        return;
    }
    PathVertex v = start_vertex(pixel, triangle);
    // The given point may have the rounding error of coordinates far from the origin. Scans begin at it, so it is
    // moved off its surface.
    v.surface.position += RAY_ROUNDING * start_distance(v.surface.position) * v.normal;
    vec3 Le = vec3(0.0);
#else
    if (triangle < 0) {
#if defined(HAS_SKY) || defined(HAS_BACKGROUND)
#ifdef SPLIT_LIGHT
        direct_part = seen_behind(eye_direction(pixel));
#endif
        leave(pixel, ended(seen_behind(eye_direction(pixel))), 0.0);
#else
        leave(pixel, ended(vec3(0.0)), 0.0);
#endif
        return;
    }
    vec4 plane = hit_plane(triangle, pixel);
    vec3 d = eye_direction(pixel), o = eye_origin(pixel);
    vec3 x = o + d * ((plane.w - dot(plane.xyz, o)) / dot(plane.xyz, d));
    Surface s = hit_surface(triangle, pixel, x, plane);
    bool front = front_hit(plane.xyz, d);
    float pdf_area;
    vec3 Le = emitted(s, front, pdf_area);
    PathVertex v = path_vertex(s, triangle, plane, front, -d);
#endif
    PathState next = lit_and_gone_on(v, path_in_image(pixel), vec3(1.0), Le);
#ifdef SPLIT_LIGHT
    direct_part = next.radiance;
#ifdef LAST_VERTEX
    // next.radiance includes ambient light, which replaces indirect light, so it is not used here.
    direct_part = Le + last_lit;
#endif
#endif
    leave(pixel, next, 0.0);
}
