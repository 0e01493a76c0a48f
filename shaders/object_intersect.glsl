// object_intersect.glsl: where a ray meets a primitive; one routine per kind, shared by every engine [TB V].
// Needs:  <OBJECTS>
// Frame:  world; directions are unit, so t is a distance in scene units.
//
// Each routine has two halves: what follows from the ray's start alone, which a buffer works out once per primitive,
// and what is left for every ray. Everything is `precise`: the same start and direction give the same bits of t in
// every program, so that engines can be compared by equality.
//
// `own` is the primitive that a ray starts on, -1 for none. It is left out where it is flat; of a sphere the root
// at the start itself is taken to be exactly 0, so that the far side is still met from inside, without any bias.
const float NO_HIT = 3e38;

// f: start relative to the centre; w: |f|^2 - r^2, as a product, which keeps its digits near the surface.
vec4 sphere_from(vec3 origin, vec3 centre, float radius)
{
    precise vec3 f = origin - centre;
    precise float distance = sqrt(dot(f, f));
    precise float c = (distance - radius) * (distance + radius);
    return vec4(f, c);
}

// The first root beyond tmin. The discriminant is taken from the ray's closest point, for spheres that are small and
// far away. Source: Haines, Günther & Akenine-Möller 2019, Precision Improvements for Ray/Sphere Intersection.
float sphere_hit(vec4 from, float radius, vec3 direction, float tmin)
{
    precise float b = -dot(from.xyz, direction);
    precise vec3 closest = from.xyz + b * direction;
    precise float square = radius * radius - dot(closest, closest);
    precise float root = sqrt(max(square, 0.0));
    precise float q = b < 0.0 ? b - root : b + root;
    precise float other = from.w / q;
    float t = min(q, other);
    t = t > tmin ? t : max(q, other);
    return square >= 0.0 && t > tmin ? t : NO_HIT;
}

// A sphere under an affine map is met in the space of its unit sphere.
struct UnitSpace
{
    mat3 rows;  // unit_from_world, its rows as columns
    vec4 from;  // of the unit sphere
};

vec3 to_unit(mat3 rows, vec3 v)
{
    precise vec3 u = vec3(dot(rows[0], v), dot(rows[1], v), dot(rows[2], v));
    return u;
}

UnitSpace ellipsoid_from(vec3 origin, vec4 row0, vec4 row1, vec4 row2)
{
    UnitSpace space;
    space.rows = mat3(row0.xyz, row1.xyz, row2.xyz);
    precise vec3 f = origin - vec3(row0.w, row1.w, row2.w);
    space.from = sphere_from(to_unit(space.rows, f), vec3(0.0), 1.0);
    return space;
}

float ellipsoid_hit(UnitSpace space, vec3 direction, float tmin)
{
    precise vec3 d = to_unit(space.rows, direction);
    precise float scale = sqrt(dot(d, d));
    precise vec3 unit = d / scale;
    precise float t = sphere_hit(space.from, 1.0, unit, tmin * scale) / scale;
    return t < NO_HIT / max(scale, 1.0) ? t : NO_HIT;
}

// edge*: normals of the planes through the start and an edge; plane: a normal and its product with the way to the plane.
struct TriangleFrom
{
    vec3 edge0;  // from corner 0 to 1, so its product with a direction is the weight of corner 2
    vec3 edge1;
    vec3 edge2;
    vec4 plane;
};

// Two triangles that share an edge find the same number for it, with the other sign, so no ray slips through.
// Source: the sign test by Plücker coordinates, as in Embree's robust mode (Wald et al. 2014).
TriangleFrom triangle_from(vec3 origin, vec3 corner0, vec3 corner1, vec3 corner2)
{
    precise vec3 a = corner0 - origin, b = corner1 - origin, c = corner2 - origin;
    precise vec3 ab = b - a, bc = c - b, ca = a - c;
    precise vec3 edge0 = cross(ab, a + b), edge1 = cross(bc, b + c), edge2 = cross(ca, c + a);
    precise vec3 normal = cross(ab, bc);
    precise float offset = dot(normal, a);
    return TriangleFrom(edge0, edge1, edge2, vec4(normal, offset));
}

float triangle_hit(TriangleFrom from, vec3 direction, float tmin)
{
    precise vec3 weight = vec3(dot(from.edge1, direction), dot(from.edge2, direction), dot(from.edge0, direction));
    precise float t = from.plane.w / dot(from.plane.xyz, direction);
    float least = min(weight.x, min(weight.y, weight.z)), most = max(weight.x, max(weight.y, weight.z));
    bool inside = least >= 0.0 || most <= 0.0;
    // An edge-on triangle divides 0 by 0: neither comparison holds for that.
    return inside && t > tmin && t < NO_HIT ? t : NO_HIT;
}

float plane_from(vec3 origin, vec3 normal, vec3 point)
{
    precise vec3 way = point - origin;
    precise float height = dot(normal, way);
    return height;
}

float plane_hit(float height, vec3 normal, vec3 direction, float tmin)
{
    precise float t = height / dot(normal, direction);
    return t > tmin && t < NO_HIT ? t : NO_HIT;
}

// The same by a primitive's number.

float intersect_sphere(int primitive, vec3 origin, vec3 direction, float tmin, int own)
{
    vec4 sphere = sphere_texel(primitive, SPHERE_BALL);
    vec4 from = sphere_from(origin, sphere.xyz, abs(sphere.w));
    if (primitive == own) from.w = 0.0;
    return sphere_hit(from, sphere.w, direction, tmin);
}

float intersect_ellipsoid(int primitive, vec3 origin, vec3 direction, float tmin, int own)
{
    UnitSpace space = ellipsoid_from(
        origin, unit_texel(primitive, UNIT_ROW0), unit_texel(primitive, UNIT_ROW1), unit_texel(primitive, UNIT_ROW2));
    if (primitive == own) space.from.w = 0.0;
    return ellipsoid_hit(space, direction, tmin);
}

TriangleFrom triangle_of(int primitive, vec3 origin)
{
    int triangle = primitive - first_triangle;
    return triangle_from(
        origin,
        triangle_texel(triangle, TRIANGLE_VERTEX0).xyz,
        triangle_texel(triangle, TRIANGLE_VERTEX1).xyz,
        triangle_texel(triangle, TRIANGLE_VERTEX2).xyz);
}

float intersect_triangle(int primitive, vec3 origin, vec3 direction, float tmin, int own)
{
    return primitive == own ? NO_HIT : triangle_hit(triangle_of(primitive, origin), direction, tmin);
}

float intersect_plane(int primitive, vec3 origin, vec3 direction, float tmin, int own)
{
    int plane = primitive - first_plane;
    vec3 normal = plane_texel(plane, PLANE_NORMAL).xyz;
    float height = plane_from(origin, normal, plane_texel(plane, PLANE_POINT).xyz);
    return primitive == own ? NO_HIT : plane_hit(height, normal, direction, tmin);
}

// Any primitive. llvmpipe runs the routines of all kinds for it, so kinds that the scene lacks are left out.
float intersect(int primitive, vec3 origin, vec3 direction, float tmin, int own)
{
    float t = NO_HIT;
#ifdef HAS_SPHERES
    if (primitive < first_ellipsoid) t = intersect_sphere(primitive, origin, direction, tmin, own);
#endif
#ifdef HAS_ELLIPSOIDS
    if (primitive >= first_ellipsoid && primitive < first_triangle)
        t = intersect_ellipsoid(primitive, origin, direction, tmin, own);
#endif
#ifdef HAS_TRIANGLES
    if (primitive >= first_triangle && primitive < first_plane)
        t = intersect_triangle(primitive, origin, direction, tmin, own);
#endif
#ifdef HAS_PLANES
    if (primitive >= first_plane) t = intersect_plane(primitive, origin, direction, tmin, own);
#endif
    return t;
}
