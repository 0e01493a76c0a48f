// start_points.glsl: points where paths start, each as if a white Lambertian surface were there, lit on one side.
// Needs:  <CONSTANTS>; START_SHADING: normals to shade with. For start_vertex: path_vertex.glsl
// Frame:  world.
TEXELS(rgba32f, start_positions);  // a: is there a point?
TEXELS(rgba32f, start_normals);    // unit, on the side that is lit
#ifdef START_SHADING
TEXELS(rgba32f, start_shading);    // unit
#endif
uniform float start_extent;        // of the scene about the origin of the world

// Cosine from which on a point's normal is that of the surface that it lies on.
const float SAME_NORMAL = 0.99999;

// By how much a point is lifted off its surface, over RAY_ROUNDING.
float start_distance(vec3 position)
{
    vec3 far = abs(position);
    return start_extent + max(far.x, max(far.y, far.z));
}

#ifdef START_VERTEX
// triangle: that the point lies on, -1 for none.
PathVertex start_vertex(ivec2 pixel, int triangle)
{
    vec3 position = texel(start_positions, pixel).xyz, normal = texel(start_normals, pixel).xyz;
    vec4 plane = vec4(normal, dot(normal, position));
    bool front = true;
    // What is askew to its surface is lit past it, and lies on none.
    if (triangle >= 0) {
        vec4 found = facet_texel(triangle, FACET_PLANE);
        float cosine = dot(found.xyz, normal);
        if (abs(cosine) >= SAME_NORMAL) {
            plane = found;
            front = cosine > 0.0;
            normal = front ? found.xyz : -found.xyz;
        } else {
            triangle = -1;
        }
    }
    Surface s;
    s.position = position;
    s.normal = s.smooth_normal = plane.xyz;
    s.triangle = triangle;
#ifdef START_SHADING
    vec3 n = texel(start_shading, pixel).xyz;
#else
    vec3 n = normal;
#endif
    return PathVertex(s, triangle, plane, front, normal, normal, n, dot(n, normal), lambertian(vec3(1.0)));
}
#endif
