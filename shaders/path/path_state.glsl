// path_state.glsl: output of a shader that shades one vertex of each path: the paths' new states, or, with TO_SUMS,
// the sums.
// Needs: path_next.glsl
#include "film/split_light.glsl"
#ifdef TO_SUMS
#include "film/accumulate.glsl"

void leave(ivec2 pixel, PathState state, float events)
{
    accumulate(pixel, vec4(state.radiance, events));
}
#else
layout(location = 0) out vec4 position;
layout(location = 1) out vec4 beta;
layout(location = 2) out vec4 radiance;
#ifdef HAS_DISTANT_LIGHTS
layout(location = 3) out vec4 start;
layout(location = 4) out vec4 light;
#endif
#ifdef SPLIT_LIGHT
#ifdef HAS_DISTANT_LIGHTS
layout(location = 5) out vec4 direct;
#else
layout(location = 3) out vec4 direct;
#endif
#endif

void leave(ivec2 pixel, PathState state, float events)
{
    position = state.position;
    beta = vec4(state.beta, 0.0);
    radiance = vec4(state.radiance, events);
#ifdef HAS_DISTANT_LIGHTS
    start = pending_start;
    light = vec4(pending_light, 0.0);
#endif
#ifdef SPLIT_LIGHT
    direct = vec4(direct_part, 0.0);
#endif
}
#endif
