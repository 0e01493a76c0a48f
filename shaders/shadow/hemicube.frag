// hemicube.frag: writes for each texel the number + 1 of the triangle that the light sample sees there; 0 for none.
// Depth is linear, because the near plane must be so near that a lamp's shade is beyond it. A perspective depth
// would then have no precision left.
// Blended surfaces are sampled stochastically, texel by texel.
#include "gl/texels.glsl"
#include <SCENE>
#include "scene/opacity.glsl"
uniform vec2 light_range;
#ifdef STREAMED_CHUNK
uniform int chunk_first;  // index of the chunk's first triangle
#else
const int chunk_first = 0;
#endif
#ifdef HAS_ALPHA
in vec3 world;
uniform vec3 light_position;
#endif

layout(location = 0) out uint seen;

void main()
{
#ifdef HAS_ALPHA
    new_opacity_key(ivec2(gl_FragCoord.xy), 0u);
    if (lets_through(gl_PrimitiveID, world, light_position - world)) discard;
#endif
    gl_FragDepth = 1.0 / (gl_FragCoord.w * light_range.y);
    seen = uint(gl_PrimitiveID + chunk_first) + 1u;
}
