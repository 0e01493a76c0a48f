// direct_sums.frag: adds the direct light of one path set, in quanta, to the sums of direct light.
// Runs over: the pixels of the window. Output: the sums, see accumulate.glsl
#include "gl/texels.glsl"
#include "film/accumulate.glsl"

TEXELS(rgba32f, direct_light);

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    accumulate(pixel, vec4(texel(direct_light, pixel).rgb, 0.0));
}
