// radiosity.glsl: a radiosity solution, looked up at a point [PB A.4].
// Needs:  <RADIOSITY>
// Units:  irradiance W m^-2, linear Rec. 709; a: fraction of direct light that is included, 0 to 1.
// Each edge of a triangle has n parts. Cell (i, j) of its lattice has a lower element with the corners (i, j),
// (i + 1, j), (i, j + 1). Except in a row's last cell, it also has an upper one: (i + 1, j + 1), (i, j + 1), (i + 1, j).
#include <RADIOSITY>

// Position of a point in its triangle's lattice.
struct LatticePosition
{
    int element;  // index of the element in the tables
    bool upper;   // true if the element is the upper one of its cell
    vec2 f;       // position in the cell, 0 to 1
};

LatticePosition lattice_position(int triangle, vec3 position)
{
    vec4 along_x = lattice_texel(triangle, LATTICE_X), along_y = lattice_texel(triangle, LATTICE_Y);
    vec4 range = lattice_texel(triangle, LATTICE_RANGE);
    float n = range.x;
    int last = int(n) - 1;
    // Rounding may put a point just outside its triangle.
    vec2 p = clamp(vec2(dot(along_x.xyz, position) + along_x.w, dot(along_y.xyz, position) + along_y.w), 0.0, n);
    int i = min(int(p.x), last);
    int j = min(int(p.y), last - i);
    vec2 f = clamp(p - vec2(i, j), 0.0, 1.0);
    bool upper = f.x + f.y > 1.0 && i + j < last;
    return LatticePosition(int(range.y) + j * (2 * (last + 1) - j) + 2 * i + int(upper), upper, f);
}

// Minimum length of a ray that may look up the element, on the triangle's front or back, in scene units.
float min_lookup_distance(LatticePosition p, bool front)
{
    vec4 distance = element_texel(p.element, ELEMENT_MIN_DISTANCE);
    return front ? distance.r : distance.g;
}

// Irradiance on the triangle's front or back, interpolated in the element.
vec4 irradiance_at(LatticePosition p, bool front)
{
    int side = 2 * p.element + int(!front);
    vec2 w = p.upper ? 1.0 - p.f : p.f - 0.5 * max(p.f.x + p.f.y - 1.0, 0.0);
    return (1.0 - w.x - w.y) * radiosity_texel(side, RADIOSITY_FIRST)
         + w.x * radiosity_texel(side, RADIOSITY_SECOND)
         + w.y * radiosity_texel(side, RADIOSITY_THIRD);
}

#ifdef ALL_LIGHT
// Irradiance on an element's front or back, from all light.
vec3 all_light(LatticePosition p, bool front)
{
    return all_light_texel(2 * p.element + int(!front), ALL_LIGHT_IRRADIANCE).rgb;
}
#endif
