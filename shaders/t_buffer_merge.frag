// t_buffer_merge.frag: of what was drawn and what the small primitives gave, the nearer; at the same t the lower
// number. Where this device's programs differ in the last bits of t, those decide instead.
// Needs:  <T_BUFFER>
#include <T_BUFFER>
#include "texels.glsl"

TEXELS(rg32f, drawn);
uniform ivec2 eye_size;

layout(std430, binding = 2) buffer Nearest { uint least_t[]; };
layout(std430, binding = 3) buffer Numbers { uint lowest[]; };

layout(location = 0) out vec2 found;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    int at = pixel.y * eye_size.x + pixel.x;
    found = texel(drawn, pixel).rg;
    uint number = lowest[at];
    if (number != NOTHING)
    {
        float t = uintBitsToFloat(least_t[at]), primitive = float(number & NUMBER) + 1.0;
        if (found.x == 0.0 || t < found.y || (t == found.y && primitive < found.x)) found = vec2(primitive, t);
    }
}
