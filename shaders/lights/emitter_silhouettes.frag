// emitter_silhouettes.frag: radiance of the lamps and sky that a pixel sees, averaged over subsamples of the pixel.
// Needs:  <SCENE>, <RAY_BVH>; SUBSAMPLES: number of subsamples; HAS_SKY
// Runs over: texels, one for each pixel of the window at an edge of a lamp. Output: W sr^-1 m^-2, linear Rec. 709
// Frame:  world
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "camera/camera.glsl"
#include "lights/sky.glsl"
#include "lights/background.glsl"
#include "path/path_vertex.glsl"
#include "scene/ray_bvh.glsl"
#include "lights/emitter_silhouettes.glsl"

UINT_TEXELS(r32ui, lamp_pixels);  // for each texel, its pixel as a packed number; 0 for none
uniform vec2 subsamples[SUBSAMPLES];  // offsets from the set's own sample, in pixels, y up

layout(location = 0) out vec4 light;

vec3 seen(vec3 origin, vec3 direction)
{
    int triangle = nearest_triangle(origin, direction, -1);
#if defined(HAS_SKY) || defined(HAS_BACKGROUND)
    if (triangle < 0) return seen_behind(direction);
#else
    if (triangle < 0) return vec3(0.0);
#endif
    float t, pdf_area;
    PathVertex v = vertex_on(triangle, origin, direction, t);
    return emitted(v.surface, v.front, pdf_area);
}

void main()
{
    uint number = texel(lamp_pixels, ivec2(gl_FragCoord.xy)).r;
    vec3 sum = vec3(0.0);
    if (number != 0u) {
        ivec2 pixel = unpacked_texel(number);
        for (int k = 0; k < SUBSAMPLES; ++k) {
#ifdef HAS_ALPHA
            new_opacity_key(pixel + eye_corner, 1u + uint(k));
#endif
            sum += seen(eye_origin(pixel, subsamples[k]), eye_direction(pixel, subsamples[k]));
        }
    }
    light = vec4(sum / float(SUBSAMPLES), 1.0);
}
