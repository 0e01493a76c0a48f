// stream_cull.comp: the triangles of a chunk that any path of a scan may meet, as indices to draw.
// A vertex costs a scan thirty times what it costs here, and of small triangles nearly all miss every path's position.
// Runs over: triangles. Output: three indices for each that stays, in no order; how many, in the draw's command.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "path/path_view.glsl"

layout(local_size_x = 64) in;

TEXELS(rgba32f, cell_z0);
UINT_TEXELS(rgba32ui, cell_position);
layout(std430, binding = 0) buffer Command { uint count; };
layout(std430, binding = 1) writeonly buffer Kept { uint kept[]; };
uniform int path_views;
uniform int chunk_count;

// Cells across that are looked into; a wider triangle stays.
const int WIDEST = 3;

bool may_meet(int number, uint corner)
{
    PathView view = path_view(number);
    vec2 a = cell_space(view, path_space(number, vertex_position(corner))).xy;
    vec2 b = cell_space(view, path_space(number, vertex_position(corner + 1u))).xy;
    vec2 c = cell_space(view, path_space(number, vertex_position(corner + 2u))).xy;
    vec2 ab = b - a, ac = c - a, bc = c - b;
    float longest = max(dot(ab, ab), max(dot(ac, ac), dot(bc, bc)));
    float twice_area = abs(ab.x * ac.y - ab.y * ac.x);
    // Edges have a tolerance of 1.4e-4 cells (path_scan.frag), which reaches beyond a corner by that over the sine of
    // half its angle; and corners are rounded, more so far from the view.
    float beyond = 2e-3 + 3e-4 * longest / max(twice_area, 1e-30);
    vec2 low = min(a, min(b, c)), high = max(a, max(b, c));
    beyond += 1e-5 * max(max(abs(low.x), abs(low.y)), max(abs(high.x), abs(high.y)));
    if (any(greaterThan(low - beyond, view_cells)) || any(lessThan(high + beyond, vec2(0.0)))) return false;
    ivec2 first = ivec2(floor(max(low - beyond, 0.0))), last = ivec2(floor(min(high + beyond, view_cells - 1.0)));
    if (any(greaterThanEqual(last - first, ivec2(WIDEST)))) return true;
    for (int y = first.y; y <= last.y; ++y)
        for (int x = first.x; x <= last.x; ++x) {
            ivec2 cell = ivec2(x + int(view.first_column), y);
            uvec4 position = texel(cell_position, cell);
            vec4 px = float(x) + vec4(position & 0xffffu) * (1.0 / 65535.0);
            vec4 py = float(y) + vec4((position >> 16u) & 0x7fffu) * (1.0 / 32767.0);
            vec4 outside = max(max(low.x - px, px - high.x), max(low.y - py, py - high.y));
            if (any(lessThan(mix(outside, vec4(INFINITE_DEPTH), greaterThanEqual(texel(cell_z0, cell), vec4(INFINITE_DEPTH))),
                             vec4(beyond))))
                return true;
        }
    return false;
}

void main()
{
    int triangle = int(gl_GlobalInvocationID.x);
    if (triangle >= chunk_count) return;
    uint corner = 3u * uint(triangle);
    bool stays = false;
    for (int view = 0; view < path_views; ++view) stays = stays || may_meet(view, corner);
    if (!stays) return;
    uint at = atomicAdd(count, 3u);
    for (uint k = 0u; k < 3u; ++k) kept[at + k] = corner + k;
}
