// path_light.frag: light from infinitely far, for the paths whose scan along its direction hit nothing.
// Runs over: the pixels of the window. Output: what is added to a path's radiance, or, after the last vertex, the sums.
#include "texels.glsl"
#include "path_flight.glsl"
#include "path_result.glsl"
#ifdef LAST_VERTEX
#include "accumulate.glsl"
TEXELS(rgba32f, path_radiance);
#else
layout(location = 0) out vec4 radiance;
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
#ifdef LAST_VERTEX
    accumulate(pixel, texel(path_radiance, pixel) + lit);
#else
    radiance = lit;
#endif
}
