// path_launch.frag: ScanConvertPositions [PB table 4], first half: every live path joins the list of its cell.
// Runs over: paths. Output: see ray_record.glsl.
// The order of a list depends on the order of execution; the result of path_cells.frag does not depend on it.
#include "gl/texels.glsl"
#include "path/path_view.glsl"
#include "path/direction_code.glsl"
#include "path/ray_record.glsl"

TEXELS(rgba32f, path_position);

// Head of each cell's list: number of the path that joined last, and in the bits above it the epoch of that scan. A
// head with another epoch means an empty list, so heads need no clearing.
layout(r32ui) uniform uimage2D cell_heads;
uniform uint scan_epoch;

layout(location = 0) out uvec4 ray_record;

void main()
{
    ivec2 path = ivec2(gl_FragCoord.xy);
    vec4 position = texel(path_position, path);
    ray_record = uvec4(NO_RAY);
    if (position.w == 0.0) return;

    int own = coded_view(position.w);
    PathView view = path_view(own);
    vec3 c = cell_space(view, path_space(own, position.xyz));
    ivec2 cell = clamp(ivec2(floor(c.xy)), ivec2(0), ivec2(view_cells) - 1);
    ray_record.z = pack_position(c.xy - vec2(cell), position.w < 0.0);
    ray_record.w = floatBitsToUint(c.z);
    cell.x += int(view.first_column);
    ray_record.x = uint(cell.y << 16 | cell.x);

    uint before = imageAtomicExchange(cell_heads, cell, (scan_epoch << NUMBER_BITS) | path_number(path));
    if ((before >> NUMBER_BITS) == scan_epoch) ray_record.y = before & NUMBER_MASK;
}
