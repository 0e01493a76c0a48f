// path_rays.comp: compute shader of path_rays.glsl, for graphics cards; many of them run fragment shaders on few
// cores only.
// Needs:  COMPUTE
// Runs over: the pixels of an area of the window, 8 x 8 in a group. Output: the sums, see accumulate.glsl
#include "path/path_rays.glsl"
#include "film/accumulate.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

uniform ivec4 area;  // x, y, width and height of the area

void main()
{
    ivec2 offset = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(offset, area.zw))) return;
    ivec2 pixel = area.xy + offset;
    accumulate(pixel, trace_path(pixel));
}
