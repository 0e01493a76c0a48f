// path_state.glsl: where a vertex pass leaves its paths: their states, or, after the last vertex, the sums.
// Needs: path_vertex.glsl
#ifdef LAST_VERTEX
#include "accumulate.glsl"

void leave(ivec2 pixel, PathState state, float events)
{
    accumulate(pixel, vec4(state.radiance, events));
}
#else
layout(location = 0) out vec4 position;
layout(location = 1) out vec4 beta;
layout(location = 2) out vec4 radiance;

void leave(ivec2 pixel, PathState state, float events)
{
    position = state.position;
    beta = vec4(state.beta, 0.0);
    radiance = vec4(state.radiance, events);
}
#endif
