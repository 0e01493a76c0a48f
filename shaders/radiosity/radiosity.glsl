// radiosity.glsl: a radiosity solution, looked up at a point [PB A.4].
// Needs:  <RADIOSITY>
// Units:  irradiance W m^-2, linear Rec. 709; a: how much of the direct light there is in it, 0 to 1.
// A triangle's edges are in n parts. The cell (i, j) of its lattice has a lower element, (i, j) (i + 1, j) (i, j + 1),
// and an upper one beyond the diagonal, (i + 1, j + 1) (i, j + 1) (i + 1, j), but for the last cell of a row.
#include <RADIOSITY>

vec4 irradiance_value(int first, int number, int back)
{
#ifdef ALL_LIGHT
    return all_light_texel(2 * (first + number) + back, ALL_LIGHT_IRRADIANCE);
#else
    return radiosity_texel(2 * (first + number) + back, RADIOSITY_IRRADIANCE);
#endif
}

// Where a point lies in its triangle's lattice.
struct LatticePosition
{
    int first_value, first_element;  // numbers of the triangle's first value and element in the tables
    int last;     // number of the last cell of the first row
    int i, j;     // the cell
    bool upper;   // in its upper element?
    vec2 f;       // position in the cell, 0 to 1
};

LatticePosition lattice_position(int triangle, vec3 position)
{
    vec4 along_x = lattice_texel(triangle, LATTICE_X), along_y = lattice_texel(triangle, LATTICE_Y);
    vec4 range = lattice_texel(triangle, LATTICE_RANGE);
    float n = range.x;
    int last = int(n) - 1;
    // Rounding may put a point just outside of its triangle.
    vec2 p = clamp(vec2(dot(along_x.xyz, position) + along_x.w, dot(along_y.xyz, position) + along_y.w), 0.0, n);
    int i = min(int(p.x), last);
    int j = min(int(p.y), last - i);
    vec2 f = clamp(p - vec2(i, j), 0.0, 1.0);
    return LatticePosition(int(range.y), int(range.w), last, i, j, f.x + f.y > 1.0 && i + j < last, f);
}

// The number of the element in its triangle.
int element_in(LatticePosition p)
{
    return p.j * (2 * (p.last + 1) - p.j) + 2 * p.i + int(p.upper);
}

// How the element at a position is looked up, on the triangle's front or back.
struct ElementLookup
{
    float min_distance;  // of a ray that looks the element up, scene units
    bool constant;       // values are not interpolated
};

ElementLookup element_lookup(LatticePosition p, bool front)
{
    vec4 lookup = element_texel(p.first_element + element_in(p), ELEMENT_LOOKUP);
    return ElementLookup(front ? lookup.r : lookup.g, (front ? lookup.b : lookup.a) > 0.0);
}

// Irradiance on the triangle's front or back.
vec4 irradiance_at(LatticePosition p, bool front, bool constant)
{
    int first = p.first_value, back = int(!front);
#ifdef INTERPOLATED
#ifndef ALL_LIGHT
    if (constant) return element_value_texel(2 * (p.first_element + element_in(p)) + back, ELEMENT_VALUE_IRRADIANCE);
#endif
    vec2 f = p.f;
    if (!p.upper) f -= 0.5 * max(f.x + f.y - 1.0, 0.0);
    // Numbers of the vertices in rows j and j + 1. The first of the three vertices is the one off the diagonal.
    int row = p.j * (p.last + 2) - (p.j * (p.j - 1)) / 2 + p.i, next = row + p.last + 2 - p.j;
    vec2 w = p.upper ? 1.0 - f.yx : f;
    return (1.0 - w.x - w.y) * irradiance_value(first, p.upper ? next + 1 : row, back)
         + w.x * irradiance_value(first, row + 1, back)
         + w.y * irradiance_value(first, next, back);
#else
    return irradiance_value(first, element_in(p), back);
#endif
}
