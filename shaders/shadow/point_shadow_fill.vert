// point_shadow_fill.vert: draws the rectangles of cells whose rays may hit an object [TB III.E]. A rectangle is
// drawn as two triangles, or a small one as a point, which needs one vertex instead of six. Rectangles end at
// borders of cells, so one ray is shot for every cell inside. The fragment shader discards cells of a point that
// are outside its rectangle.
// Needs:  <SCENE>; KIND_SPHERE, KIND_ELLIPSOID, KIND_TRIANGLE or KIND_PLANE
#include <SCENE>
#include "scene/object_intersect.glsl"

uniform usampler2D rectangles;  // first column | row << 16, last column | row << 16, primitive, face
uniform vec3 light_position;
uniform ivec2 tile_corner;      // lower corner of the tile in the texture of all lights
uniform ivec2 tile_faces;       // columns and rows of faces in a tile
uniform ivec2 tile_size;
uniform vec2 shadow_cells;
uniform bool as_points;

flat out ivec4 own_cells;  // first and last cell of the rectangle on its face
flat out ivec2 face_corner;
flat out int face;
flat out uint primitive;

// Terms that only depend on the light and the primitive, see object_intersect.glsl.
#if defined(KIND_SPHERE)
flat out vec4 from;
flat out float radius;
#elif defined(KIND_ELLIPSOID)
flat out mat3 rows;
flat out vec4 from;
#elif defined(KIND_TRIANGLE)
flat out vec3 corner0;
flat out vec3 corner1;
flat out vec3 corner2;
flat out vec4 plane;
#else
flat out vec4 plane;
#endif

void main()
{
    int vertices = as_points ? 1 : 6;
    int i = gl_VertexID / vertices, vertex = gl_VertexID - vertices * i;
    uvec4 rectangle = texelFetch(rectangles, ivec2(i % RECTANGLES_WIDTH, i / RECTANGLES_WIDTH), 0);
    face = int(rectangle.w);
    int number = int(rectangle.z);
    primitive = uint(number);
    ivec2 in_tile = ivec2(face % tile_faces.x, face / tile_faces.x) * ivec2(shadow_cells);
    face_corner = tile_corner + in_tile;

#if defined(KIND_SPHERE)
    vec4 ball = sphere_texel(number, SPHERE_BALL);
    from = sphere_from(light_position, ball.xyz, abs(ball.w));
    radius = ball.w;
#elif defined(KIND_ELLIPSOID)
    UnitSpace space = ellipsoid_from(light_position, unit_texel(number, UNIT_ROW0), unit_texel(number, UNIT_ROW1),
                                     unit_texel(number, UNIT_ROW2));
    rows = space.rows;
    from = space.from;
#elif defined(KIND_TRIANGLE)
    TriangleFrom triangle = triangle_of(number, light_position);
    corner0 = triangle.corner0;
    corner1 = triangle.corner1;
    corner2 = triangle.corner2;
    plane = triangle.plane;
#else
    vec3 normal = plane_texel(number - first_plane, PLANE_NORMAL).xyz;
    plane = vec4(normal, plane_from(light_position, normal, plane_texel(number - first_plane, PLANE_POINT).xyz));
#endif

    ivec2 low = ivec2(rectangle.x & 0xffffu, rectangle.x >> 16u);
    ivec2 high = ivec2(rectangle.y & 0xffffu, rectangle.y >> 16u);
    own_cells = ivec4(low, high);
    // The two triangles have the corners 0 1 2 and 2 1 3.
    int corner = vertex < 3 ? vertex : vertex == 5 ? 3 : 5 - vertex;
    vec2 at = vec2((corner & 1) == 0 ? low.x : high.x + 1, (corner & 2) == 0 ? low.y : high.y + 1);
    int side = max(high.x - low.x, high.y - low.y) + 1;
    // A point is drawn only if its centre is inside the face's tile, so the point is moved inside.
    if (as_points) at = vec2(min(low, ivec2(shadow_cells) - side)) + 0.5 * float(side);
    gl_PointSize = float(side);
    gl_Position = vec4(2.0 * (vec2(in_tile) + at) / vec2(tile_size) - 1.0, 0.0, 1.0);
}
