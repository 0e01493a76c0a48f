// hemicube.vert: projects the scene from a light sample on the five faces of a hemicube (Cohen & Greenberg 1985).
// One instanced draw, with an instance for each face. Each face has its own rectangle of one atlas; clip distances
// separate them.
//   face 0     the top, R x R, looks along light_normal
//   faces 1-4  the upper halves of the sides, R x R/2, along +t, -t, +b, -b
// FULL_CUBE: six faces R x R; face 5 looks against light_normal.
#include <SCENE>
#include "shadow/hemicube.glsl"

#ifdef HAS_ALPHA
out vec3 world;
#endif
uniform vec2 light_range;  // near and far distance along a face's axis
#ifdef STREAMED_CHUNK
uniform int cube_face;  // index of the cube's face, because a chunk is drawn on a few faces only
#else
#define cube_face gl_InstanceID
#endif
#ifdef FULL_CUBE
uniform bool light_one_sided;  // true if the light emits only to the side of light_normal
#endif

void main()
{
    vec3 position = vertex_position(uint(gl_VertexID)), r = position - light_position;
#ifdef HAS_ALPHA
    world = position;
#endif
    vec3 l = vec3(dot(r, light_tangent), dot(r, light_bitangent), dot(r, light_normal));
    vec3 p = hemicube_to_face(cube_face, l);
    bool top = cube_face == 0;

    gl_ClipDistance[0] = p.z - p.x;
    gl_ClipDistance[1] = p.z + p.x;
    gl_ClipDistance[2] = p.z - p.y;
    // A side ends just above the light's plane, at the distance of the top's near plane. Surfaces in the light's
    // plane, such as the light itself, pass through the centre of projection, and rounding would scatter them over
    // the texels.
#ifdef FULL_CUBE
    gl_ClipDistance[3] = p.z + p.y;
    gl_ClipDistance[4] = light_one_sided ? l.z - light_range.x : 1.0;
#else
    gl_ClipDistance[3] = top ? p.z + p.y : p.y - light_range.x;
#endif

    vec4 rectangle = hemicube_rectangle(cube_face);
    float low = hemicube_low(cube_face);
    // Homogeneous transform from the face's plane to its rectangle of the atlas.
    vec2 q = vec2((p.x + p.z) * 0.5 * rectangle.z + rectangle.x * p.z,
                  (p.y - low * p.z) / (1.0 - low) * rectangle.w + rectangle.y * p.z);
    float n = light_range.x, f = light_range.y;
    gl_Position = vec4(2.0 * q - p.z, ((f + n) * p.z - 2.0 * f * n) / (f - n), p.z);
}
