// path_scan.vert: transforms a triangle to the cells of a view, and enlarges it to cover every cell that it touches.
// The number of the instance selects the view.
// The fragment shader does the exact test; here no cell may be missed. The triangle's edges are moved outwards by half a cell
// (Hasselgren et al. 2005, Conservative Rasterization). A triangle seen nearly edge-on, whose corners would move too far, is
// replaced by a right triangle that covers a rectangle along its longest edge.
#include <SCENE>
#include "path/path_view.glsl"
#include "path_buffer/scan_triangle.glsl"

flat out vec4 corner_ab;
flat out vec2 corner_c;
flat out vec3 depth_plane;
flat out uint triangle_id;
#ifdef HAS_ALPHA
flat out uint see_through;
#endif

#ifdef SKIPS_NEAR
flat out float skipped;
#endif

uniform int cell_columns;
#ifdef LISTED
// Number of triangles. An entry of the list is a triangle's index, plus listed_of for the second view.
uniform int listed_of;
#endif

// Half a cell plus a margin for the rasteriser's fixed-point corners (1/256 of a pixel).
const float HALF_CELL_MARGIN = 0.52;

vec2 meet(vec2 n1, float c1, vec2 n2, float c2)
{
    return vec2(c1 * n2.y - c2 * n1.y, n1.x * c2 - n2.x * c1) / (n1.x * n2.y - n1.y * n2.x);
}

// Line through p along e, moved outwards (to the right of e) by the cell's half width in that direction.
void outer_line(vec2 p, vec2 e, out vec2 n, out float c)
{
    n = vec2(e.y, -e.x);
    c = dot(n, p) + HALF_CELL_MARGIN * (abs(n.x) + abs(n.y));
}

vec2 grown_corner(vec2 before, vec2 here, vec2 after)
{
    vec2 n1, n2;
    float c1, c2;
    // The lines are relative to the corner itself, because large coordinates would lose digits.
    outer_line(vec2(0.0), here - before, n1, c1);
    outer_line(vec2(0.0), after - here, n2, c2);
    return here + meet(n1, c1, n2, c2);
}

vec2 around_sliver(vec2 a, vec2 b, vec2 c, int k)
{
    vec2 ab = b - a, bc = c - b, ca = a - c;
    vec2 p = a, along = ab;
    if (dot(bc, bc) > dot(along, along)) { p = b; along = bc; }
    if (dot(ca, ca) > dot(along, along)) { p = c; along = ca; }
    vec2 x = along / max(length(along), 1e-20);
    if (dot(along, along) < 1e-30) x = vec2(1.0, 0.0);
    vec2 y = vec2(-x.y, x.x);
    float margin = HALF_CELL_MARGIN * (abs(x.x) + abs(x.y));  // the same for y, because cells are square
    vec3 s = vec3(dot(a - p, x), dot(b - p, x), dot(c - p, x));
    vec3 t = vec3(dot(a - p, y), dot(b - p, y), dot(c - p, y));
    vec2 low = vec2(min(s.x, min(s.y, s.z)), min(t.x, min(t.y, t.z))) - margin;
    vec2 high = vec2(max(s.x, max(s.y, s.z)), max(t.x, max(t.y, t.z))) + margin;
    vec2 q = low + 2.0 * (high - low) * vec2(k == 1, k == 2);
    return p + q.x * x + q.y * y;
}

void main()
{
    int triangle = gl_VertexID / 3, number = gl_InstanceID;
    int k = gl_VertexID - 3 * triangle;
#ifdef LISTED
    if (triangle >= listed_of) {
        number = 1;
        triangle -= listed_of;
    }
#endif
    PathView view = path_view(number);
    ScanTriangle s;
    float longest, twice_area;
    bool seen = scan_triangle(triangle, number, view, s, longest, twice_area);
    triangle_id = s.number;
#ifdef HAS_ALPHA
    see_through = s.see_through;
#endif
#ifdef SKIPS_NEAR
    skipped = s.skipped;
#endif
    vec2 first = vec2(view.first_column, 0.0);
    corner_ab = vec4(s.a + first, s.b + first);
    corner_c = s.c + first;
    depth_plane = s.depth_plane;

    vec2 p;
    if (twice_area < longest)  // the triangle's altitude is less than a cell
        p = around_sliver(s.a, s.b, s.c, k);
    else if (k == 0)
        p = grown_corner(s.c, s.a, s.b);
    else if (k == 1)
        p = grown_corner(s.a, s.b, s.c);
    else
        p = grown_corner(s.b, s.c, s.a);
    if (!seen) p = vec2(-10.0);
    // Views lie side by side, and neither may draw into the other.
    gl_ClipDistance[0] = p.x;
    gl_ClipDistance[1] = view_cells.x - p.x;
    gl_Position = vec4(2.0 * (p + first) / vec2(cell_columns, view_cells.y) - 1.0, 0.0, 1.0);
}
