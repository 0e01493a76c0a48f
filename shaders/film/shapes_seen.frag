// shapes_seen.frag: writes the shape that every pixel sees in one path set.
// Needs:  <SCENE>
// Runs over: the pixels of the window. Output: index of the shape + 1, 0 for none
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"

UINT_TEXELS(EYE_FORMAT, eye_buffer);  // number of the primitive + 1
layout(location = 0) out uint shape;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int primitive = int(texel(eye_buffer, pixel).r) - 1;
    shape = primitive < 0 ? 0u : uint(hit_shape(primitive, pixel) + 1);
}
