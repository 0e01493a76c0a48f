// path_cells.frag: ScanConvertPositions [PB table 4], second half: z0 and place of the paths in each cell.
// Runs over: cells. A channel is a slot, so that one fragment of the scene serves four paths.
#include "texels.glsl"
#include "constants.glsl"
#include "path_flight.glsl"

UINT_TEXELS(rgba32ui, cell_slots);
UINT_TEXELS(rg32ui, path_starts);

layout(location = 0) out vec4 z0;
layout(location = 1) out uvec4 place;

void fill(uint key, out float z, out uint where)
{
    bool taken = (key >> KEY_BITS) == scan_epoch;
    ivec2 path = path_of(taken ? unpermute(key & KEY_MASK) : 0u);
    uvec2 start = texel(path_starts, path).rg;
    // An empty slot starts behind everything: nothing is beyond it.
    z = taken ? uintBitsToFloat(start.y) : INFINITE_DEPTH;
    where = taken ? start.x : 0u;
}

void main()
{
    uvec4 keys = texel(cell_slots, ivec2(gl_FragCoord.xy));
    fill(keys.x, z0.x, place.x);
    fill(keys.y, z0.y, place.y);
    fill(keys.z, z0.z, place.z);
    fill(keys.w, z0.w, place.w);
}
