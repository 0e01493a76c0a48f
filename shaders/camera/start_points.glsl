// start_points.glsl: points at which paths start, each as if on a white Lambertian surface lit from one side.
// Needs:  <CONSTANTS>; START_SHADING: points have shading normals. For start_vertex: path_vertex.glsl
// Frame:  world.
TEXELS(rgba32f, start_positions);  // position; alpha is 0 for a pixel without a point
TEXELS(rgba32f, start_normals);    // unit normal on the lit side
#ifdef START_SHADING
TEXELS(rgba32f, start_shading);    // unit shading normal
#endif
uniform float start_extent;        // radius of a ball around the world's origin that contains the scene

// Minimum cosine for which a point's normal counts as that of its surface.
const float SAME_NORMAL = 0.99999;

// Distance by which a point is lifted off its surface, divided by RAY_ROUNDING.
float start_distance(vec3 position)
{
    vec3 far = abs(position);
    return start_extent + max(far.x, max(far.y, far.z));
}

#ifdef START_VERTEX
// Returns the vertex at which the path of a pixel starts. triangle: index of the triangle that the point lies on,
// -1 for none.
PathVertex start_vertex(ivec2 pixel, int triangle)
{
    vec3 position = texel(start_positions, pixel).xyz, normal = texel(start_normals, pixel).xyz;
    vec4 plane = vec4(normal, dot(normal, position));
    bool front = true;
    // A point whose normal differs from that of its triangle counts as on no triangle, and keeps its own normal.
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
