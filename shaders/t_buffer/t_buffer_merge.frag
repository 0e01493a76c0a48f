// t_buffer_merge.frag: chooses for each pixel between the drawn and the small primitive: the nearer, or at the same
// t the one with the lower number. If two programs of this device compute different last bits of t, these bits
// decide instead.
// Needs:  <T_BUFFER>
#include <T_BUFFER>
#include "gl/texels.glsl"

UINT_TEXELS(rg32ui, drawn);  // number of the primitive + 1, and bits of t
uniform ivec2 eye_size;

layout(std430, binding = 2) buffer Nearest { uint min_t[]; };
layout(std430, binding = 3) buffer Numbers { uint lowest[]; };

layout(location = 0) out uvec2 found;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int at = pixel.y * eye_size.x + pixel.x;
    found = texel(drawn, pixel).rg;
    uint number = lowest[at];
    if (number != NOTHING)
    {
        // Bits of positive floats have the order of the floats.
        uvec2 small = uvec2((number & NUMBER) + 1u, min_t[at]);
        if (found.x == 0u || small.y < found.y || (small.y == found.y && small.x < found.x)) found = small;
    }
}
