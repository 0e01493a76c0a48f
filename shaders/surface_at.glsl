// surface_at.glsl: the surface that a ray has met, of any kind of primitive.
// Needs:  <SCENE>, object_intersect.glsl
// Frame:  world; the normal leaves the front.
#include "object_intersect.glsl"
#include "surface.glsl"

// Where a direction of the unit sphere lies on it: u with the longitude, v from the south pole to the north.
vec2 sphere_uv(vec3 unit)
{
    float longitude = atan(unit.y, unit.x) * (0.5 / PI);
    // Not acos: drivers approximate it to four digits only.
    return vec2(longitude < 0.0 ? longitude + 1.0 : longitude, 0.5 + atan(unit.z, length(unit.xy)) / PI);
}

Surface surface_at(int primitive, vec3 origin, vec3 direction, float t)
{
    Surface s = surface_of_shape(shape_of(primitive), origin + t * direction, vec3(0.0));
#ifdef HAS_SPHERES
    if (primitive < first_ellipsoid)
    {
        vec4 sphere = sphere_texel(primitive, SPHERE_BALL);
        vec3 out_of = normalize(s.position - sphere.xyz);
        // Back onto the sphere, as t of a far one has lost the last digits of the place.
        s.position = sphere.xyz + abs(sphere.w) * out_of;
        s.normal = s.smooth_normal = sphere.w < 0.0 ? -out_of : out_of;
        mat3 rows = mat3(
            unit_texel(primitive, UNIT_ROW0).xyz, unit_texel(primitive, UNIT_ROW1).xyz,
            unit_texel(primitive, UNIT_ROW2).xyz);
        s.uv = sphere_uv(normalize(to_unit(rows, out_of)));
    }
#endif
#ifdef HAS_ELLIPSOIDS
    if (primitive >= first_ellipsoid && primitive < first_triangle)
    {
        vec4 row0 = unit_texel(primitive, UNIT_ROW0), row1 = unit_texel(primitive, UNIT_ROW1);
        vec4 row2 = unit_texel(primitive, UNIT_ROW2);
        mat3 rows = mat3(row0.xyz, row1.xyz, row2.xyz);
        vec3 unit = normalize(to_unit(rows, s.position - vec3(row0.w, row1.w, row2.w)));
        s.normal = s.smooth_normal = normalize(rows * unit) * sign(determinant(rows));
        s.uv = sphere_uv(unit);
    }
#endif
#ifdef HAS_TRIANGLES
    if (primitive >= first_triangle && primitive < first_plane)
    {
        TriangleFrom from = triangle_of(primitive, origin);
        float extent;
        vec3 weight = triangle_weights(from, direction, extent);
        weight /= weight.x + weight.y + weight.z;
        s.normal = s.smooth_normal = normalize(from.plane.xyz);
        interpolate(s, face_texel(primitive - first_triangle, FACE_CORNERS), weight);
    }
#endif
#ifdef HAS_PLANES
    if (primitive >= first_plane)
    {
        int plane = primitive - first_plane;
        s.normal = s.smooth_normal = plane_texel(plane, PLANE_NORMAL).xyz;
        vec3 from_point = s.position - plane_texel(plane, PLANE_POINT).xyz;
        s.uv = vec2(dot(from_point, plane_texel(plane, PLANE_U).xyz), dot(from_point, plane_texel(plane, PLANE_V).xyz));
    }
#endif
    return s;
}
