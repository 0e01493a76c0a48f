// hemicube.glsl: frame of a light sample, and the faces of its hemicube, or cube, in the atlas.
// Frame: light_tangent, light_bitangent, light_normal right-handed and unit; light is emitted to the side of the
//        normal.
// FULL_CUBE: sides include their lower halves, and there is a bottom face, for a light that emits to all sides.
uniform vec3 light_position;
uniform vec3 light_normal;
uniform vec3 light_tangent;
uniform vec3 light_bitangent;

// Returns the face through which a direction in the light sample's frame leaves the hemicube.
int hemicube_face_of(vec3 p)
{
    vec2 a = abs(p.xy);
    if (p.z >= max(a.x, a.y)) return 0;
#ifdef FULL_CUBE
    if (-p.z >= max(a.x, a.y)) return 5;
#endif
    return a.x >= a.y ? (p.x > 0.0 ? 1 : 2) : (p.y > 0.0 ? 3 : 4);
}

// Converts from the light sample's frame to that of a face: x and y across the face, z along its axis. On a side
// face, y is along the light's normal.
vec3 hemicube_to_face(int face, vec3 p)
{
    if (face == 0) return p;
#ifdef FULL_CUBE
    if (face == 5) return vec3(p.xy, -p.z);
#endif
    return face <= 2 ? vec3(p.y, p.z, face == 1 ? p.x : -p.x) : vec3(p.x, p.z, face == 3 ? p.y : -p.y);
}

vec3 hemicube_from_face(int face, vec3 f)
{
    if (face == 0) return f;
#ifdef FULL_CUBE
    if (face == 5) return vec3(f.xy, -f.z);
#endif
    return face <= 2 ? vec3(face == 1 ? f.z : -f.z, f.x, f.y) : vec3(f.x, face == 3 ? f.z : -f.z, f.y);
}

// Lowest y of a face; the highest is 1. A side of a hemicube only has its upper half.
float hemicube_low(int face)
{
#ifdef FULL_CUBE
    return -1.0;
#else
    return face == 0 ? -1.0 : 0.0;
#endif
}

// Size of the atlas in texels; resolution: texels along an edge of the top face.
vec2 hemicube_atlas(float resolution)
{
#ifdef FULL_CUBE
    return vec2(3.0, 2.0) * resolution;
#else
    return vec2(2.0, 1.5) * resolution;
#endif
}

// Returns lower corner and size of a face in the atlas, which has size 1 x 1.
vec4 hemicube_rectangle(int face)
{
#ifdef FULL_CUBE
    return vec4(float(face % 3) / 3.0, float(face / 3) * 0.5, 1.0 / 3.0, 0.5);
#else
    const float third = 1.0 / 3.0;
    if (face == 0) return vec4(0.0, 0.0, 0.5, 2.0 * third);
    if (face == 1) return vec4(0.5, 0.0, 0.5, third);
    if (face == 2) return vec4(0.5, third, 0.5, third);
    if (face == 3) return vec4(0.0, 2.0 * third, 0.5, third);
    return vec4(0.5, 2.0 * third, 0.5, third);
#endif
}
