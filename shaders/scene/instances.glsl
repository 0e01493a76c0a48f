// instances.glsl: looks up a triangle by the number of a hit. Numbers from first_instanced on are triangles of mesh
// instances; lower numbers are the scene's own triangles.
// Needs:  <SCENE>; HAS_INSTANCES: the scene has instances, see `glpath.scene.instances`
// Frame:  world; data of an instance's mesh are in the mesh's own space.
#ifdef HAS_INSTANCES
// Placement of an instance's mesh in the world; the identity for the scene's own triangles.
struct Placing
{
    int first;  // offset to subtract from a hit's number, which gives the triangle's index in <SCENE>
    int shape;  // index of the instance's shape; -1: the shape is that of the triangle
    vec4 x;     // first row of the affine transform world_from_mesh; y and z are the other rows
    vec4 y;
    vec4 z;
};

Placing placing_of(int triangle)
{
    int block = triangle < first_instanced ? 0 : 1 + ((triangle - first_instanced) >> instance_shift);
    uvec4 of = instance_block_texel(block, INSTANCE_BLOCK_OF);
    int instance = int(of.x);
    return Placing(int(of.z), int(of.y) - 1, instance_texel(instance, INSTANCE_ROW0), instance_texel(instance, INSTANCE_ROW1),
                   instance_texel(instance, INSTANCE_ROW2));
}

vec3 placed_direction(Placing p, vec3 v) { return vec3(dot(p.x.xyz, v), dot(p.y.xyz, v), dot(p.z.xyz, v)); }

vec3 placed_position(Placing p, vec3 v) { return placed_direction(p, v) + vec3(p.x.w, p.y.w, p.z.w); }

// Transforms a normal by the map's cofactor matrix, as cross products of edges transform; a zero vector stays zero.
vec3 placed_normal(Placing p, vec3 n)
{
    vec3 turned = vec3(dot(cross(p.y.xyz, p.z.xyz), n), dot(cross(p.z.xyz, p.x.xyz), n), dot(cross(p.x.xyz, p.y.xyz), n));
    float square = dot(turned, turned);
    return square > 0.0 ? turned * inversesqrt(square) : vec3(0.0);
}

uvec4 triangle_face(int triangle)
{
    Placing p = placing_of(triangle);
    uvec4 face = face_texel(triangle - p.first, FACE_CORNERS);
    return uvec4(face.xyz, p.shape < 0 ? face.w : uint(p.shape));
}

vec4 triangle_plane(int triangle)
{
    Placing p = placing_of(triangle);
    vec4 plane = facet_texel(triangle - p.first, FACET_PLANE);
    vec3 n = placed_normal(p, plane.xyz);
    return vec4(n, dot(n, placed_position(p, plane.w * plane.xyz)));
}

// Transforms a corner of a triangle and its edges to the world.
void edges_in_world(int triangle, inout vec3 a, inout vec3 ab, inout vec3 ac)
{
    Placing p = placing_of(triangle);
    a = placed_position(p, a);
    ab = placed_direction(p, ab);
    ac = placed_direction(p, ac);
}
#else
#define triangle_face(triangle) face_texel(triangle, FACE_CORNERS)
#define triangle_plane(triangle) facet_texel(triangle, FACET_PLANE)
#define edges_in_world(triangle, a, ab, ac)
#endif
