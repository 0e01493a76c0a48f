// scan_merge.frag: outputs the hits of small triangles (scan_small.comp), to be blended with those of drawn triangles.
// Runs over: cells. The words are reset to empty, for the next scan.
//   AT_NEAREST   blended by MAX; words are stored as complements, because atomicMin() then finds the maximum
#include <CONSTANTS>

layout(std430, binding = 2) buffer Words { uint words[]; };
uniform int cell_columns;

layout(location = 0) out vec4 found;

const uint EMPTY = 0xffffffffu;

void main()
{
    int at = 4 * (int(gl_FragCoord.y) * cell_columns + int(gl_FragCoord.x));
    uvec4 word = uvec4(words[at], words[at + 1], words[at + 2], words[at + 3]);
    if (word == uvec4(EMPTY)) discard;
    for (int k = 0; k < 4; ++k) words[at + k] = EMPTY;
#ifdef AT_NEAREST
    found = uintBitsToFloat(~word);
#else
    found = mix(uintBitsToFloat(word), vec4(NOTHING_FOUND), equal(word, uvec4(EMPTY)));
#endif
}
