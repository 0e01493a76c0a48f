// path_launch.frag: ScanConvertPositions [PB table 4], first half: every live path claims a slot of its cell.
// Runs over: paths. Output: flights and starts, see path_flight.glsl.
// A cell has four slots. Each path carries its key along them with atomicMin; what it displaces it carries on. Whatever
// the order of execution, the four least keys stay, sorted; those carried past the end are counted: they lost the
// roulette, and the survivors stand for them.
#include "texels.glsl"
#include "path_view.glsl"
#include "path_course.glsl"
#include "path_flight.glsl"

TEXELS(rgba32f, path_position);
// 4. Not a constant, or the loop is unrolled, and llvmpipe runs all of it for a path that needs one turn.
uniform int slots_per_cell;

layout(std430, binding = 0) buffer Slots { uint slot[]; };
layout(std430, binding = 1) buffer Overflow { uint overflow[]; };

layout(location = 0) out uvec2 flight;
layout(location = 1) out uvec2 start;

void main()
{
    ivec2 path = ivec2(gl_FragCoord.xy);
    vec4 position = texel(path_position, path);
    flight = uvec2(NO_FLIGHT, 0u);
    start = uvec2(0u);
    if (position.w == 0.0) return;

    int own = course_view(position.w);
    PathView view = path_view(own);
    vec3 c = cell_space(view, path_space(own, position.xyz));
    ivec2 cell = clamp(ivec2(floor(c.xy)), ivec2(0), ivec2(view_cells) - 1);
    uint key = (scan_epoch << KEY_BITS) | permute(path_number(path));
    start = uvec2(pack_place(c.xy - vec2(cell), position.w < 0.0), floatBitsToUint(c.z));
    cell.x += int(view.first_column);
    flight = uvec2(uint(cell.y << 16 | cell.x), key);

    int number = cell.y * (VIEWS * int(view_cells.x)) + cell.x;
    for (int s = 0; s < slots_per_cell; s++) {
        uint old = atomicMin(slot[4 * number + s], key);
        key = max(key, old);
        if ((key >> KEY_BITS) != scan_epoch) return;
    }
    atomicMax(overflow[number], (4095u - scan_epoch) << KEY_BITS);
    atomicAdd(overflow[number], 1u);
}
