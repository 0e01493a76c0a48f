// surface_at.glsl: surface at a ray's hit, for any kind of primitive.
// Needs:  <SCENE>, object_intersect.glsl
// Frame:  world; the normal points out of the front.
#include "scene/object_intersect.glsl"
#include "scene/surface.glsl"

// Texture coordinates of a direction on the unit sphere: u with the longitude, v from the south pole to the north.
vec2 sphere_uv(vec3 unit)
{
    float longitude = atan(unit.y, unit.x) * (0.5 / PI);
    // Not acos, which drivers approximate to four digits only.
    return vec2(longitude < 0.0 ? longitude + 1.0 : longitude, 0.5 + atan(unit.z, length(unit.xy)) / PI);
}

#ifdef HAS_NORMAL_MAPS
// Applies the normal map of a slot. along_u, along_v: vectors along which only the surface's u or only its v grows;
// the slot's affine map converts them to vectors for the slot's u and v.
vec3 mapped_by(Surface s, vec3 n, int slot, vec3 along_u, vec3 along_v)
{
    vec2 u = slot_map_texel(slot, SLOT_MAP_U).xy, v = slot_map_texel(slot, SLOT_MAP_V).xy;
    float side = u.x * v.y - u.y * v.x < 0.0 ? -1.0 : 1.0;
    return mapped_normal(s, n, slot, side * (v.y * along_u - v.x * along_v), side * (u.x * along_v - u.y * along_u));
}

void map_normals(inout Surface s, vec3 along_u, vec3 along_v)
{
    int slot = normal_slot(s.material);
    if (slot >= 0) s.smooth_normal = mapped_by(s, s.smooth_normal, slot, along_u, along_v);
#ifdef HAS_COAT_NORMALS
    slot = coat_normal_slot(s.material);
    if (slot >= 0) s.coat_normal = mapped_by(s, s.coat_normal, slot, along_u, along_v);
#endif
}

// Applies the normal maps of a sphere or ellipsoid. linear: world_from_unit, of any scale; unit: point on the unit
// sphere.
void map_normal_of_sphere(inout Surface s, mat3 linear, vec3 unit)
{
    float across = max(dot(unit.xy, unit.xy), 1e-12);
    vec3 along_u = vec3(-unit.y, unit.x, 0.0) * (2.0 * PI);
    vec3 along_v = vec3(-unit.z * unit.xy / sqrt(across), sqrt(across)) * PI;
    map_normals(s, linear * along_u, linear * along_v);
}
#endif

#ifdef HAS_SPHERES
void complete_sphere(inout Surface s, int sphere)
{
    vec4 ball = sphere_texel(sphere, SPHERE_BALL);
    vec3 out_of = normalize(s.position - ball.xyz);
    // Project the position back onto the sphere, because it has lost its last digits if the sphere is distant and t
    // is large.
    s.position = ball.xyz + abs(ball.w) * out_of;
    set_normal(s, ball.w < 0.0 ? -out_of : out_of);
    mat3 rows = mat3(
        unit_texel(sphere, UNIT_ROW0).xyz, unit_texel(sphere, UNIT_ROW1).xyz, unit_texel(sphere, UNIT_ROW2).xyz);
    vec3 unit = normalize(to_unit(rows, out_of));
    s.uv = sphere_uv(unit);
#ifdef HAS_NORMAL_MAPS
    map_normal_of_sphere(s, rows, unit);
#endif
}
#endif

#ifdef HAS_ELLIPSOIDS
void complete_ellipsoid(inout Surface s, int primitive)
{
    vec4 row0 = unit_texel(primitive, UNIT_ROW0), row1 = unit_texel(primitive, UNIT_ROW1);
    vec4 row2 = unit_texel(primitive, UNIT_ROW2);
    mat3 rows = mat3(row0.xyz, row1.xyz, row2.xyz);
    vec3 unit = normalize(to_unit(rows, s.position - vec3(row0.w, row1.w, row2.w)));
    set_normal(s, normalize(rows * unit) * sign(determinant(rows)));
    s.uv = sphere_uv(unit);
#ifdef HAS_NORMAL_MAPS
    map_normal_of_sphere(s, inverse(transpose(rows)), unit);
#endif
}
#endif

#ifdef HAS_TRIANGLES
void complete_triangle(inout Surface s, int primitive, vec3 origin, vec3 direction)
{
    TriangleFrom from = triangle_of(primitive, origin);
    float extent;
    vec3 weight = triangle_weights(from, direction, extent);
    weight /= weight.x + weight.y + weight.z;
    set_normal(s, normalize(from.plane.xyz));
    s.triangle = primitive - first_triangle;
    interpolate(s, face_texel(s.triangle, FACE_CORNERS), weight, from.corner1 - from.corner0, from.corner2 - from.corner0);
}
#endif

#ifdef HAS_PLANES
void complete_plane(inout Surface s, int plane)
{
    set_normal(s, plane_texel(plane, PLANE_NORMAL).xyz);
    vec3 from_point = s.position - plane_texel(plane, PLANE_POINT).xyz;
    vec3 along_u = plane_texel(plane, PLANE_U).xyz, along_v = plane_texel(plane, PLANE_V).xyz;
    s.uv = vec2(dot(from_point, along_u), dot(from_point, along_v));
#ifdef HAS_NORMAL_MAPS
    map_normals(s, along_u / dot(along_u, along_u), along_v / dot(along_v, along_v));
#endif
}
#endif

Surface surface_at(int primitive, vec3 origin, vec3 direction, float t)
{
    Surface s = surface_of_shape(shape_of(primitive), origin + t * direction, vec3(0.0));
#ifdef HAS_SPHERES
    if (primitive < first_ellipsoid) complete_sphere(s, primitive);
#endif
#ifdef HAS_ELLIPSOIDS
    if (primitive >= first_ellipsoid && primitive < first_triangle) complete_ellipsoid(s, primitive);
#endif
#ifdef HAS_TRIANGLES
    if (primitive >= first_triangle && primitive < first_plane) complete_triangle(s, primitive, origin, direction);
#endif
#ifdef HAS_PLANES
    if (primitive >= first_plane) complete_plane(s, primitive - first_plane);
#endif
    return s;
}

// Variants for the hit of the eye's ray through a pixel, which may be a streamed triangle with a record.
#ifdef STREAMED
TriangleFrom triangle_seen(ivec2 pixel, vec3 origin)
{
    return triangle_from(origin, texel(hit_records, record_texel(pixel, RECORD_CORNER_A)).xyz,
                         texel(hit_records, record_texel(pixel, RECORD_CORNER_B)).xyz,
                         texel(hit_records, record_texel(pixel, RECORD_CORNER_C)).xyz);
}

float intersect_seen(int primitive, ivec2 pixel, vec3 origin, vec3 direction, float tmin)
{
    if (primitive < first_streamed) return intersect(primitive, origin, direction, tmin, -1);
    return triangle_hit(triangle_seen(pixel, origin), direction, tmin);
}

Surface surface_seen(int primitive, ivec2 pixel, vec3 origin, vec3 direction, float t)
{
    if (primitive < first_streamed) return surface_at(primitive, origin, direction, t);
    Surface s = surface_of_shape(hit_shape(primitive, pixel), origin + t * direction, vec3(0.0));
    set_normal(s, normalize(triangle_seen(pixel, origin).plane.xyz));
    return s;
}
#else
#define intersect_seen(primitive, pixel, origin, direction, tmin) intersect(primitive, origin, direction, tmin, -1)
#define surface_seen(primitive, pixel, origin, direction, t) surface_at(primitive, origin, direction, t)
#endif
