// t_buffer_ray.glsl: intersects rays of the T-buffer with primitives of one kind (KIND_...). All rays start at the
// eye, so the terms that they have in common are computed once for each primitive.
// Needs:  <SCENE>, object_intersect.glsl, camera.glsl, object_bounds.glsl; STREAMED_CHUNK: the primitives are a chunk of
//         streamed triangles
#include <SCENE>
#include "scene/object_intersect.glsl"
#include "scene/object_opacity.glsl"
#include "camera/camera.glsl"
#include "t_buffer/object_bounds.glsl"

#if defined(KIND_SPHERE)
struct Target { vec4 from; float radius; };

Target target(int primitive)
{
    vec4 sphere = sphere_texel(primitive, SPHERE_BALL);
    return Target(sphere_from(eye_position, sphere.xyz, abs(sphere.w)), sphere.w);
}

int bounds(int primitive, out ivec2 low, out ivec2 high)
{
    vec4 sphere = sphere_texel(primitive, SPHERE_BALL);
    return sphere_bounds(sphere.xyz, abs(sphere.w), low, high);
}

float shoot_from(Target aim, vec3 direction, float tmin) { return sphere_hit(aim.from, aim.radius, direction, tmin); }

#elif defined(KIND_ELLIPSOID)
struct Target { mat3 rows; vec4 from; };

Target target(int primitive)
{
    UnitSpace space = ellipsoid_from(
        eye_position, unit_texel(primitive, UNIT_ROW0), unit_texel(primitive, UNIT_ROW1),
        unit_texel(primitive, UNIT_ROW2));
    return Target(space.rows, space.from);
}

int bounds(int primitive, out ivec2 low, out ivec2 high)
{
    int ellipsoid = primitive - first_ellipsoid;
    vec4 axis0 = ellipsoid_texel(ellipsoid, ELLIPSOID_AXIS0), axis1 = ellipsoid_texel(ellipsoid, ELLIPSOID_AXIS1);
    vec4 axis2 = ellipsoid_texel(ellipsoid, ELLIPSOID_AXIS2);
    // For a flat, distant ellipsoid, the rounding error in the space of its unit sphere is larger than in pixels,
    // so its axes are lengthened.
    float grown = 1.0 + 1e-6 * length(target(primitive).from.xyz);
    mat3 axes = grown * mat3(axis0.xyz, axis1.xyz, axis2.xyz);
    return ellipsoid_bounds(vec3(axis0.w, axis1.w, axis2.w), axes[0], axes[1], axes[2], low, high);
}

float shoot_from(Target aim, vec3 direction, float tmin) { return ellipsoid_hit(UnitSpace(aim.rows, aim.from), direction, tmin); }

#elif defined(KIND_TRIANGLE)
struct Target { vec3 corner0; vec3 corner1; vec3 corner2; vec4 plane; };

Target target(int primitive)
{
    TriangleFrom from = triangle_of(primitive, eye_position);
    return Target(from.corner0, from.corner1, from.corner2, from.plane);
}

int bounds(int primitive, out ivec2 low, out ivec2 high)
{
    uvec3 face = corners_of(primitive);
    return triangle_bounds(vertex_position(face.x), vertex_position(face.y), vertex_position(face.z), low, high);
}

float shoot_from(Target aim, vec3 direction, float tmin)
{
    return triangle_hit(TriangleFrom(aim.corner0, aim.corner1, aim.corner2, aim.plane), direction, tmin);
}

#elif defined(KIND_PLANE)
struct Target { vec4 plane; };

Target target(int primitive)
{
    int plane = primitive - first_plane;
    vec3 normal = plane_texel(plane, PLANE_NORMAL).xyz;
    return Target(vec4(normal, plane_from(eye_position, normal, plane_texel(plane, PLANE_POINT).xyz)));
}

float shoot_from(Target aim, vec3 direction, float tmin) { return plane_hit(aim.plane.w, aim.plane.xyz, direction, tmin); }
#endif

#ifdef EYE_ORTHOGRAPHIC
// Parallel rays have different starts, and no common terms.
#if defined(KIND_SPHERE)
#define INTERSECT intersect_sphere
#elif defined(KIND_ELLIPSOID)
#define INTERSECT intersect_ellipsoid
#elif defined(KIND_TRIANGLE)
#define INTERSECT intersect_triangle
#elif defined(KIND_PLANE)
#define INTERSECT intersect_plane
#endif
#define SHOOT(aim, direction, tmin) INTERSECT(primitive, origin, direction, tmin, -1)
#else
#define SHOOT(aim, direction, tmin) shoot_from(aim, direction, tmin)
#endif

#if defined(KIND_SPHERE) || defined(KIND_ELLIPSOID) || defined(KIND_TRIANGLE) || defined(KIND_PLANE)
// Returns the distance at which the ray through a pixel of the window hits the primitive.
float shoot(int primitive, Target aim, ivec2 pixel)
{
    vec3 origin = eye_origin(pixel), direction = eye_direction(pixel);
    float t = SHOOT(aim, direction, 0.0);
#ifdef HAS_ALPHA
    new_opacity_key(pixel + eye_corner, 0u);
    for (int k = 0; k < 2 && t < NO_HIT && primitive_lets_through(primitive, origin, direction, t, false); ++k)
        t = SHOOT(aim, direction, t);
#endif
    return t;
}
#endif
