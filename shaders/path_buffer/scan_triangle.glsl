// scan_triangle.glsl: transforms a triangle to the cell space of a view, for a scan.
// Needs:  <SCENE>, path_view.glsl; SKIPS_NEAR, STREAMED_CHUNK
#ifdef SKIPS_NEAR
uniform float skipped_share;  // fraction of a simplified shape's deviation; nearer hits on the shape are skipped
#endif
#ifdef STREAMED_CHUNK
uniform int chunk_first;  // index of the chunk's first triangle; the chunk's triangles share no vertices
#endif

struct ScanTriangle
{
    vec2 a, b, c;      // corners in cells of the view, counterclockwise
    vec3 depth_plane;  // slope per cell in x and y, depth at corner a
    uint number;
    uint see_through;  // 0 if opaque everywhere; otherwise 1, or 2 if corners b and c are exchanged
    float skipped;     // minimum distance of a hit, in scene diameters
};

// Transforms triangle `index` to view `number`. Returns false if the view sees it edge-on, so that no ray can hit
// it. longest: longest edge in cells; twice_area: twice the area in square cells.
bool scan_triangle(int index, int number, PathView view, out ScanTriangle s, out float longest, out float twice_area)
{
#ifdef STREAMED_CHUNK
    uvec3 face = uvec3(0u, 1u, 2u) + 3u * uint(index);
    s.number = uint(index + chunk_first);
#else
    uvec4 face = face_texel(index, FACE_CORNERS);
    s.number = uint(index);
#endif
    vec3 a = cell_space(view, path_space(number, vertex_position(face.x)));
    vec3 b = cell_space(view, path_space(number, vertex_position(face.y)));
    vec3 c = cell_space(view, path_space(number, vertex_position(face.z)));
    vec2 ab = b.xy - a.xy, ac = c.xy - a.xy, bc = c.xy - b.xy;
    twice_area = ab.x * ac.y - ab.y * ac.x;
    bool exchanged = twice_area < 0.0;
    if (exchanged) {
        vec3 swap = b; b = c; c = swap;
        swap.xy = ab; ab = ac; ac = swap.xy;
        twice_area = -twice_area;
    }
    s.a = a.xy;
    s.b = b.xy;
    s.c = c.xy;
    vec2 dz = vec2(b.z - a.z, c.z - a.z);
    s.depth_plane = vec3(vec2(dz.x * ac.y - dz.y * ab.y, dz.y * ab.x - dz.x * ac.x) / twice_area, a.z);
    s.see_through = 0u;
#ifdef HAS_ALPHA
    if (shape_texel(int(face.w), SHAPE_MATERIAL).z != 0u) s.see_through = exchanged ? 2u : 1u;
#endif
    s.skipped = 0.0;
#ifdef SKIPS_NEAR
    s.skipped = skipped_share * uintBitsToFloat(shape_texel(int(face.w), SHAPE_MATERIAL).w) / scene_diameter;
#endif
    longest = sqrt(max(dot(ab, ab), max(dot(ac, ac), dot(bc, bc))));
    return twice_area > 1e-9 * longest;
}
