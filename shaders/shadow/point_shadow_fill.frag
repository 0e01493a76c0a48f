// point_shadow_fill.frag: shoots the ray of one cell of a point light's shadow-buffer at one object [TB III.E].
// The depth test keeps the nearest entry. Depth is t times a power of two, so it has the order of t to the bit.
// Needs:  <SCENE>; KIND_SPHERE, KIND_ELLIPSOID, KIND_TRIANGLE or KIND_PLANE
#include <SCENE>
#include "scene/object_intersect.glsl"
#include "scene/object_opacity.glsl"
#include "shadow/point_shadow_map.glsl"

flat in ivec4 own_cells;
flat in ivec2 face_corner;
flat in int face;
flat in uint primitive;

#if defined(KIND_SPHERE)
flat in vec4 from;
flat in float radius;
#elif defined(KIND_ELLIPSOID)
flat in mat3 rows;
flat in vec4 from;
#elif defined(KIND_TRIANGLE)
flat in vec3 corner0;
flat in vec3 corner1;
flat in vec3 corner2;
flat in vec4 plane;
#else
flat in vec4 plane;
#endif

layout(location = 0) out uvec4 entry;  // entry in the format of point_shadow.glsl

// Returns the distance at which the ray along d hits the object beyond tmin.
float meet(vec3 d, float tmin)
{
#if defined(KIND_SPHERE)
    return sphere_hit(from, radius, d, tmin);
#elif defined(KIND_ELLIPSOID)
    return ellipsoid_hit(UnitSpace(rows, from), d, tmin);
#elif defined(KIND_TRIANGLE)
    return triangle_hit(TriangleFrom(corner0, corner1, corner2, plane), d, tmin);
#else
    return plane_hit(plane.w, plane.xyz, d, tmin);
#endif
}

#ifdef HAS_ALPHA
uniform vec3 light_position;
#endif

void main()
{
    vec2 cell = gl_FragCoord.xy - vec2(face_corner);
    if (any(lessThan(cell, vec2(own_cells.xy))) || any(greaterThan(cell, vec2(own_cells.zw + 1)))) discard;
    vec3 d = normalize(shadow_direction(face, cell));
    float t = meet(d, 0.0);
#ifdef HAS_ALPHA
    for (int k = 0; k < 2 && t < NO_HIT && primitive_lets_through(int(primitive), light_position, d, t, true); ++k)
        t = meet(d, t);
#endif
#if defined(KIND_SPHERE)
    vec3 normal = from.xyz + t * d;
    vec3 seen = normal / (t * dot(normal, d));
#elif defined(KIND_ELLIPSOID)
    vec3 normal = rows * (from.xyz + t * to_unit(rows, d));
    vec3 seen = normal / (t * dot(normal, d));
#else
    vec3 seen = plane.xyz / plane.w;
#endif
    if (t >= NO_HIT) discard;
    gl_FragDepth = t * DEPTH_SCALE;
    entry = uvec4(floatBitsToUint(seen), primitive + 1u);
}
