// path_vertex.glsl: vertex of a path: a surface, seen from one side and along a direction.
// Needs:  surface.glsl
// Frame:  world.
uniform vec3 ambient;        // radiance assumed beyond the last vertex [PB A.2]
uniform ivec4 image_window;  // x, y of the window's lower left pixel in the image, and the image's size

// Returns true if a light sample of this kind is from the sky and ambient radiance replaces it. Ambient radiance
// stands for all light from beyond the last vertex.
bool ambient_instead(uint light_kind)
{
    return light_kind == LIGHT_SKY && max(ambient.r, max(ambient.g, ambient.b)) > 0.0;
}

// Index of a pixel's path in the whole image, for random_number.
uint path_in_image(ivec2 pixel)
{
    ivec2 whole = pixel + image_window.xy;
    return uint(whole.y * image_window.z + whole.x);
}

struct PathVertex
{
    Surface surface;
    int triangle;
    vec4 plane;    // plane of the triangle
    bool front;    // true if the triangle's front is visible from wo
    vec3 wo;       // unit direction back along the path
    vec3 normal;   // geometric normal on the visible side
    vec3 n;        // shading normal
    float vertex_cosine;
    Bsdf bsdf;
};

PathVertex path_vertex(Surface s, int triangle, vec4 plane, bool front, vec3 wo)
{
    vec3 normal = front ? s.normal : -s.normal;
    return PathVertex(s, triangle, plane, front, wo, normal, shading_normal(s, front, wo), vertex_cosine(s, front, wo),
                      bsdf_seen(s, front, wo));
}

// Vertex at the point where a ray hits a triangle; t: distance along the ray's unit direction.
PathVertex vertex_on(int triangle, vec3 origin, vec3 direction, out float t)
{
    vec4 plane = triangle_plane(triangle);
    t = max(0.0, (plane.w - dot(plane.xyz, origin)) / dot(plane.xyz, direction));
    Surface s = surface_of_triangle(triangle, origin + t * direction, plane);
    return path_vertex(s, triangle, plane, front_hit(plane.xyz, direction), -direction);
}
