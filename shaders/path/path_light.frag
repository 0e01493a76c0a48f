// path_light.frag: adds the light of a source at infinity to each path for which a scan towards that source hit
// nothing.
// Runs over: the pixels of the window. Output: radiance to be added to each path, or, with LAST_VERTEX, the sums.
#include "gl/texels.glsl"
#include "path/ray_record.glsl"
#include "path/path_result.glsl"
#ifdef LAST_VERTEX
#include "film/accumulate.glsl"
TEXELS(rgba32f, path_radiance);
#ifdef SPLIT_LIGHT
TEXELS(rgba32f, path_direct);
#endif
#else
layout(location = 0) out vec4 radiance;
#ifdef SPLIT_LIGHT
layout(location = 1) out vec4 direct;
#endif
#endif
#ifdef SPLIT_LIGHT
// True if the light is reflected at the path's first vertex, so that it counts as direct light.
uniform bool first_vertex;
#endif

TEXELS(rgba32f, distant_start);
TEXELS(rgba32f, distant_light);

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 lit = vec4(0.0);
    if (texel(distant_start, pixel).w != 0.0) {
        float weight;
        int found = path_result(pixel, weight);
        if (found == PATH_MISSED) lit.rgb = texel(distant_light, pixel).rgb * weight;
        lit.a = scan_events(found);
    }
#ifdef SPLIT_LIGHT
    vec4 found = first_vertex ? vec4(lit.rgb, 0.0) : vec4(0.0);
#endif
#ifdef LAST_VERTEX
#ifdef SPLIT_LIGHT
    direct_part = texel(path_direct, pixel).rgb + found.rgb;
#endif
    accumulate(pixel, texel(path_radiance, pixel) + lit);
#else
    radiance = lit;
#ifdef SPLIT_LIGHT
    direct = found;
#endif
#endif
}
