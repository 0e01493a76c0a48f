// scan_small.comp: scans triangles that touch few cells, one triangle for each invocation; lists the other
// triangles, to be drawn.
// A rasteriser spends most of its time on triangle setup, which llvmpipe does on one thread. For a small triangle
// the setup costs more than testing the paths of its cells.
// Runs over: triangles. Output: minimum word that each path found; three vertices for each triangle to draw, in any
//            order; the number of these vertices, in the draw command.
#include <SCENE>
#include "path/path_view.glsl"
#include "path_buffer/scan_triangle.glsl"
#include "path_buffer/scan_cell.glsl"

layout(local_size_x = 64) in;

layout(std430, binding = 0) buffer Command { uint count; };
layout(std430, binding = 1) writeonly buffer Listed { uint listed[]; };
layout(std430, binding = 2) buffer Words { uint words[]; };  // four words for each cell, see scan_merge.frag
uniform int path_views;
uniform int cell_columns;
uniform int listed_of;  // number of triangles

const int MAX_CELLS = 256;
// Margin in cells for the tolerance of edges (scan_cell.glsl, 1.4e-4 cells) and for the rounding of corners.
const float MARGIN = 2e-3;

void list(int triangle, int number)
{
    uint at = atomicAdd(count, 3u), corner = 3u * uint(triangle + number * listed_of);
    for (uint k = 0u; k < 3u; ++k) listed[at + k] = corner + k;
}

// Extends `range` by the x interval that an edge covers between two heights. per_height: inverse of the edge's
// height.
void add_edge(vec2 p, vec2 q, float per_height, vec2 heights, inout vec2 range)
{
    if (max(p.y, q.y) < heights.x || min(p.y, q.y) > heights.y) return;
    vec2 x = p.x + (q.x - p.x) * clamp((heights - p.y) * per_height, 0.0, 1.0);
    range = vec2(min(range.x, min(x.x, x.y)), max(range.y, max(x.x, x.y)));
}

// Returns the first and last cell of a row that the triangle touches; at least one cell.
ivec2 row_span(ScanTriangle s, vec3 per_height, int row, ivec2 low, ivec2 high)
{
    vec2 heights = vec2(float(row) - MARGIN, float(row) + 1.0 + MARGIN);
    vec2 range = vec2(INFINITE_DEPTH, -INFINITE_DEPTH);
    add_edge(s.a, s.b, per_height.x, heights, range);
    add_edge(s.b, s.c, per_height.y, heights, range);
    add_edge(s.c, s.a, per_height.z, heights, range);
    return clamp(ivec2(floor(range + vec2(-MARGIN, MARGIN))), low.x, high.x);
}

void scan_cells(ScanTriangle s, ivec2 low, ivec2 high)
{
    // A horizontal edge has no inverse. It needs none, because its ends are ends of the other two edges.
    vec3 heights = vec3(s.b.y - s.a.y, s.c.y - s.b.y, s.a.y - s.c.y);
    vec3 per_height = mix(1.0 / heights, vec3(0.0), lessThan(abs(heights), vec3(1e-6)));
    ivec2 cell = low, span = row_span(s, per_height, low.y, low, high);
    cell.x = span.x;
    do {
        bvec4 hit;
        uvec4 word = floatBitsToUint(scan_cell(cell, s, hit));
#ifdef AT_NEAREST
        word = ~word;
#endif
        int at = 4 * (cell.y * cell_columns + cell.x);
        // Loops once for each hit, because all lanes of llvmpipe go through an atomic one by one.
        uint hits = uint(hit.x) | uint(hit.y) << 1u | uint(hit.z) << 2u | uint(hit.w) << 3u;
        do {
            int k = findLSB(hits);
            if (hits != 0u) atomicMin(words[at + k], k == 0 ? word.x : k == 1 ? word.y : k == 2 ? word.z : word.w);
            hits &= hits - 1u;
        } while (hits != 0u);
        ++cell.x;
        if (cell.x > span.y) {
            ++cell.y;
            span = row_span(s, per_height, cell.y, low, high);
            cell.x = span.x;
        }
    } while (cell.y <= high.y);
}

void main()
{
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    int triangle = int(group * gl_WorkGroupSize.x + gl_LocalInvocationID.x);
    if (triangle >= listed_of) return;
    for (int number = 0; number < path_views; ++number) {
        PathView view = path_view(number);
        ScanTriangle s;
        float longest, twice_area;
        if (!scan_triangle(triangle, number, view, s, longest, twice_area)) continue;
        vec2 low = min(s.a, min(s.b, s.c)) - MARGIN, high = max(s.a, max(s.b, s.c)) + MARGIN;
        if (any(greaterThan(low, view_cells)) || any(lessThan(high, vec2(0.0)))) continue;
        ivec2 first = ivec2(max(low, 0.0)), last = ivec2(min(high, view_cells - 1.0)), size = last - first + 1;
        if (size.x * size.y > MAX_CELLS) {
            list(triangle, number);
            continue;
        }
        vec2 offset = vec2(view.first_column, 0.0);  // views lie side by side
        s.a += offset;
        s.b += offset;
        s.c += offset;
        scan_cells(s, first + ivec2(offset), last + ivec2(offset));
    }
}
