// path_cells.frag: ScanConvertPositions [PB table 4], second half: z0 and position of the paths in each cell.
// Runs over: cells. Each channel is a slot for one path, so that one fragment of the scene tests four paths. In a
//            cell with more than four paths, the four with the smallest permuted numbers get the slots. The others
//            are lost, and the four represent them.
//   slots  permuted number of the path in each slot. The upper bits of x hold the low 12 bits of the number of lost
//          paths, those of y the remaining bits
#include "gl/texels.glsl"
#include <CONSTANTS>
#include "path/ray_record.glsl"

UINT_TEXELS(rgba32ui, ray_records);
UINT_TEXELS(r32ui, cell_heads);
uniform uint scan_epoch;

layout(location = 0) out vec4 z0;
layout(location = 1) out uvec4 position;
layout(location = 2) out uvec4 slots;

// Chooses each component by `which`. In GLSL 4.3, mix() with booleans is only for floats.
uvec4 choose(uvec4 otherwise, uvec4 chosen, bvec4 which)
{
    return uvec4(which.x ? chosen.x : otherwise.x, which.y ? chosen.y : otherwise.y,
                 which.z ? chosen.z : otherwise.z, which.w ? chosen.w : otherwise.w);
}

void main()
{
    // The z0 of an empty slot is behind everything, so that nothing is hit beyond it.
    z0 = vec4(INFINITE_DEPTH);
    position = uvec4(0u);
    slots = uvec4(NO_RAY);
    uint count = 0u;
    uint first = texel(cell_heads, ivec2(gl_FragCoord.xy)).r;
    uint next = (first >> NUMBER_BITS) == scan_epoch ? first & NUMBER_MASK : NO_RAY;
    // A do loop, because llvmpipe runs a `while` one more time with all lanes off.
    if (next != NO_RAY) do {
        uvec4 ray_record = texel(ray_records, path_of(next));
        uint key = permute(next);
        float z = uintBitsToFloat(ray_record.w);
        // Insertion sort: from the first slot with a larger number on, all slots move up by one.
        bvec4 here = lessThan(uvec4(key), slots);
        bvec4 moved = bvec4(false, here.xyz);
        slots = choose(choose(slots, uvec4(key), here), slots.xxyz, moved);
        position = choose(choose(position, uvec4(ray_record.z), here), position.xxyz, moved);
        z0 = mix(mix(z0, vec4(z), here), z0.xxyz, moved);
        count++;
        next = ray_record.y;
    } while (next != NO_RAY);
    slots &= NUMBER_MASK;
    if (count > 4u) slots.xy |= uvec2(count - 4u, (count - 4u) >> 12u) << NUMBER_BITS;
}
