// eye.frag: writes the number + 1 of the triangle that the eye sees; 0 for none.
// Depth is linear, because the near plane is so near that a perspective depth would have no precision left. For a
// distant eye the near plane is near the scene, and perspective depth is kept.
#include "gl/texels.glsl"
#include <SCENE>
#include "camera/camera.glsl"
#include "scene/opacity.glsl"
uniform vec2 eye_range;
#ifdef STREAMED_CHUNK
uniform int chunk_first;  // index of the chunk's first triangle
#else
const int chunk_first = 0;
#endif
#ifdef HAS_ALPHA
in vec3 world;
#endif

layout(location = 0) out uint seen;

void main()
{
#ifdef HAS_ALPHA
    new_opacity_key(ivec2(gl_FragCoord.xy) + eye_corner, 0u);
    if (lets_through(gl_PrimitiveID, world, eye_direction(ivec2(gl_FragCoord.xy)))) discard;
#endif
#ifdef EYE_ORTHOGRAPHIC
    gl_FragDepth = gl_FragCoord.z;
#else
    gl_FragDepth = eye_ahead > 0.0 ? gl_FragCoord.z : 1.0 / (gl_FragCoord.w * eye_range.y);
#endif
    seen = uint(gl_PrimitiveID + chunk_first) + 1u;
}
