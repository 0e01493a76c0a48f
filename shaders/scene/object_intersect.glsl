// object_intersect.glsl: intersection of a ray with a primitive; one routine for each kind, shared by all engines [TB V].
// Needs:  <SCENE>
// Frame:  world; directions are unit, so t is a distance in scene units.
//
// Each routine has two halves: terms that only depend on the ray's start, which a buffer computes once for each primitive, and
// the rest for each ray. Everything is `precise`: the same start and direction give the same bits of t in every program, so
// that engines can be compared by equality.
//
// `exclude` is the primitive that a ray starts on, -1 for none. A flat primitive is then skipped. For a sphere, the
// root at the start is taken as exactly 0, so that the far side is still hit from inside, without an offset of the
// start.
#include "sampling/directions.glsl"
const float NO_HIT = 3e38;

// Returns f, the ray's start relative to the sphere's centre; w: |f|^2 - r^2, computed without cancellation if the
// start is near the surface. This matters most for huge spheres used as ground or sky.
vec4 sphere_from(vec3 origin, vec3 centre, float radius)
{
    precise vec3 f = origin - centre;
    vec3 size = abs(f);
    float longest = max(size.x, max(size.y, size.z));
    vec2 rest = size.x == longest ? f.yz : size.y == longest ? f.xz : f.xy;
    precise float c = (longest - radius) * (longest + radius) + dot(rest, rest);
    return vec4(f, c);
}

// Returns the first root of |f + t direction|^2 = r^2 beyond tmin. Far from the sphere the discriminant is computed from the
// ray's closest point, because b^2 and c are then large and similar.
// Source: Haines, Günther & Akenine-Möller 2019, Precision Improvements for Ray/Sphere Intersection.
float sphere_hit(vec4 from, float radius, vec3 direction, float tmin)
{
    precise float b = -dot(from.xyz, direction);
    precise vec3 closest = from.xyz + b * direction;
    precise float square2 = radius * radius;
    precise float afar = square2 - dot(closest, closest);
    precise float near = b * b - from.w;
    float square = from.w > 3.0 * square2 ? afar : near;
    precise float root = sqrt(max(square, 0.0));
    precise float q = b < 0.0 ? b - root : b + root;
    precise float other = from.w / q;
    float t = min(q, other);
    t = t > tmin ? t : max(q, other);
    return square >= 0.0 && t > tmin ? t : NO_HIT;
}

// A sphere under an affine map is intersected in the space of its unit sphere.
struct UnitSpace
{
    mat3 rows;  // rows of unit_from_world, stored as columns
    vec4 from;  // result of sphere_from() in the space of the unit sphere
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
    float at = sphere_hit(space.from, 1.0, unit, tmin * scale);
    precise float t = at / scale;
    // A miss is tested before the division, because a graphics card may round two equal divisions differently.
    return at < NO_HIT && t < NO_HIT ? t : NO_HIT;
}

// corner0 to corner2: relative to the ray's start. plane: normal, not unit; w: its dot product with a vector from
// the start to the plane.
struct TriangleFrom
{
    vec3 corner0;
    vec3 corner1;
    vec3 corner2;
    vec4 plane;
};

TriangleFrom triangle_from(vec3 origin, vec3 corner0, vec3 corner1, vec3 corner2)
{
    precise vec3 a = corner0 - origin, b = corner1 - origin, c = corner2 - origin;
    precise vec3 ab = b - a, bc = c - b;
    precise vec3 normal = cross(ab, bc);
    precise float offset = dot(normal, a);
    return TriangleFrom(a, b, c, vec4(normal, offset));
}

// Returns the barycentric weights of the corners at the ray, not divided by their sum. All have one sign if the ray
// passes inside. Each corner is projected separately, so triangles that share it use the same projection. The
// difference of two products is 0 or has the correct sign, so no ray slips through between triangles. extent:
// maximum absolute coordinate of the projected corners.
// Source: Woop, Benthin & Wald 2013, Watertight Ray/Triangle Intersection, with a rotation instead of the shear. Zeros count as
//         inside for both triangles, instead of a second test in double precision.
vec3 triangle_weights(TriangleFrom from, vec3 direction, out float extent)
{
    vec3 x, y;
    axes_across(direction, x, y);
    precise vec2 a = vec2(dot(from.corner0, x), dot(from.corner0, y));
    precise vec2 b = vec2(dot(from.corner1, x), dot(from.corner1, y));
    precise vec2 c = vec2(dot(from.corner2, x), dot(from.corner2, y));
    precise vec3 first = vec3(b.x * c.y, c.x * a.y, a.x * b.y), second = vec3(b.y * c.x, c.y * a.x, a.y * b.x);
    precise vec3 weights = first - second;
    vec2 max_abs = max(abs(a), max(abs(b), abs(c)));
    extent = max(max_abs.x, max_abs.y);
    return weights;
}

float triangle_hit(TriangleFrom from, vec3 direction, float tmin)
{
    float extent;
    vec3 weight = triangle_weights(from, direction, extent);
    precise float sum = weight.x + weight.y + weight.z;
    precise float t = from.plane.w / dot(from.plane.xyz, direction);
    float min_weight = min(weight.x, min(weight.y, weight.z)), max_weight = max(weight.x, max(weight.y, weight.z));
    // If the ray sees the triangle edge-on, all weights are rounding errors, even outside the triangle. It is then
    // not hit.
    bool inside = (min_weight >= 0.0 || max_weight <= 0.0) && abs(sum) > 5e-7 * extent * extent;
    return inside && t > tmin && t < NO_HIT ? t : NO_HIT;
}

float plane_from(vec3 origin, vec3 normal, vec3 point)
{
    precise vec3 to_point = point - origin;
    precise float height = dot(normal, to_point);
    return height;
}

float plane_hit(float height, vec3 normal, vec3 direction, float tmin)
{
    precise float t = height / dot(normal, direction);
    return t > tmin && t < NO_HIT ? t : NO_HIT;
}

// The functions below read a primitive by its number and intersect it.

float intersect_sphere(int primitive, vec3 origin, vec3 direction, float tmin, int exclude)
{
    vec4 sphere = sphere_texel(primitive, SPHERE_BALL);
    vec4 from = sphere_from(origin, sphere.xyz, abs(sphere.w));
    if (primitive == exclude) from.w = 0.0;
    return sphere_hit(from, sphere.w, direction, tmin);
}

float intersect_ellipsoid(int primitive, vec3 origin, vec3 direction, float tmin, int exclude)
{
    UnitSpace space = ellipsoid_from(
        origin, unit_texel(primitive, UNIT_ROW0), unit_texel(primitive, UNIT_ROW1), unit_texel(primitive, UNIT_ROW2));
    if (primitive == exclude) space.from.w = 0.0;
    return ellipsoid_hit(space, direction, tmin);
}

// Indices of a triangle's vertices. STREAMED_CHUNK: <SCENE> only has the vertices of a chunk's triangles.
#ifdef STREAMED_CHUNK
uniform int chunk_first;  // index of the chunk's first triangle; the chunk's triangles share no vertices
uvec3 corners_of(int primitive) { return 3u * uint(primitive - chunk_first) + uvec3(0u, 1u, 2u); }
#else
uvec3 corners_of(int primitive) { return face_texel(primitive - first_triangle, FACE_CORNERS).xyz; }
#endif

TriangleFrom triangle_of(int primitive, vec3 origin)
{
    uvec3 face = corners_of(primitive);
    return triangle_from(origin, vertex_position(face.x), vertex_position(face.y), vertex_position(face.z));
}

float intersect_triangle(int primitive, vec3 origin, vec3 direction, float tmin, int exclude)
{
    return primitive == exclude ? NO_HIT : triangle_hit(triangle_of(primitive, origin), direction, tmin);
}

float intersect_plane(int primitive, vec3 origin, vec3 direction, float tmin, int exclude)
{
    int plane = primitive - first_plane;
    vec3 normal = plane_texel(plane, PLANE_NORMAL).xyz;
    float height = plane_from(origin, normal, plane_texel(plane, PLANE_POINT).xyz);
    return primitive == exclude ? NO_HIT : plane_hit(height, normal, direction, tmin);
}

// Intersects any primitive. llvmpipe executes the routines of all kinds, so kinds that the scene lacks are left out.
float intersect(int primitive, vec3 origin, vec3 direction, float tmin, int exclude)
{
    float t = NO_HIT;
#ifdef HAS_SPHERES
    if (primitive < first_ellipsoid) t = intersect_sphere(primitive, origin, direction, tmin, exclude);
#endif
#ifdef HAS_ELLIPSOIDS
    if (primitive >= first_ellipsoid && primitive < first_triangle)
        t = intersect_ellipsoid(primitive, origin, direction, tmin, exclude);
#endif
#ifdef HAS_TRIANGLES
    if (primitive >= first_triangle && primitive < first_plane)
        t = intersect_triangle(primitive, origin, direction, tmin, exclude);
#endif
#ifdef HAS_PLANES
    if (primitive >= first_plane) t = intersect_plane(primitive, origin, direction, tmin, exclude);
#endif
    return t;
}
