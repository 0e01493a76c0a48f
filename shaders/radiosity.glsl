// radiosity.glsl: a radiosity solution, looked up at a point [PB A.4].
// Needs:  <RADIOSITY>
// Units:  irradiance W m^-2, linear Rec. 709; a: how much of the direct light there is in it, 0 to 1.
// A triangle's edges are in n parts. The cell (i, j) of its lattice has a lower element, (i, j) (i + 1, j) (i, j + 1),
// and an upper one beyond the diagonal, (i + 1, j + 1) (i, j + 1) (i + 1, j), but for the last cell of a row.
#include <RADIOSITY>

vec4 irradiance_value(int first, int place, int back)
{
    return radiosity_texel(2 * (first + place) + back, RADIOSITY_IRRADIANCE);
}

// How wide the triangle's elements are.
float element_width(int triangle)
{
    return lattice_texel(triangle, LATTICE_RANGE).z;
}

// front: of the triangle, or its back.
vec4 irradiance_at(int triangle, vec3 position, bool front)
{
    vec4 along_x = lattice_texel(triangle, LATTICE_X), along_y = lattice_texel(triangle, LATTICE_Y);
    vec2 range = lattice_texel(triangle, LATTICE_RANGE).xy;
    float n = range.x;
    int last = int(n) - 1, first = int(range.y), back = int(!front);

    // Rounding may put a point just outside of its triangle.
    vec2 p = clamp(vec2(dot(along_x.xyz, position) + along_x.w, dot(along_y.xyz, position) + along_y.w), 0.0, n);
    int i = min(int(p.x), last);
    int j = min(int(p.y), last - i);
    vec2 f = clamp(p - vec2(i, j), 0.0, 1.0);
    bool upper = f.x + f.y > 1.0 && i + j < last;
    if (!upper) f -= 0.5 * max(f.x + f.y - 1.0, 0.0);
#ifdef INTERPOLATED
    // Rows j and j + 1 of vertices; the three around the point, the one off the diagonal first.
    int row = j * (last + 2) - (j * (j - 1)) / 2 + i, next = row + last + 2 - j;
    vec2 w = upper ? 1.0 - f.yx : f;
    return (1.0 - w.x - w.y) * irradiance_value(first, upper ? next + 1 : row, back)
         + w.x * irradiance_value(first, row + 1, back)
         + w.y * irradiance_value(first, next, back);
#else
    return irradiance_value(first, j * (2 * (last + 1) - j) + 2 * i + int(upper), back);
#endif
}
