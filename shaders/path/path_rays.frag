// path_rays.frag: see path_rays.glsl.
// Runs over: the pixels of the window. Output: the sums, see accumulate.glsl
#include "path/path_rays.glsl"
#include "film/accumulate.glsl"

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    accumulate(pixel, trace_path(pixel));
}
