// hemicube.glsl: the frame of a light point and the faces of its hemicube in the atlas.
// Frame: light_tangent, light_bitangent, light_normal right-handed and unit; the light leaves along the normal.
uniform vec3 light_position;
uniform vec3 light_normal;
uniform vec3 light_tangent;
uniform vec3 light_bitangent;

void hemicube_face(int face, out vec3 right, out vec3 up, out vec3 axis)
{
    up = light_normal;
    if (face == 0) { right = light_tangent; up = light_bitangent; axis = light_normal; }
    else if (face == 1) { right = light_bitangent; axis = light_tangent; }
    else if (face == 2) { right = light_bitangent; axis = -light_tangent; }
    else if (face == 3) { right = light_tangent; axis = light_bitangent; }
    else { right = light_tangent; axis = -light_bitangent; }
}

// Lower corner and size in the atlas, which is 1 x 1 here and 2 R x 1.5 R in texels.
vec4 hemicube_rectangle(int face)
{
    const float third = 1.0 / 3.0;
    if (face == 0) return vec4(0.0, 0.0, 0.5, 2.0 * third);
    if (face == 1) return vec4(0.5, 0.0, 0.5, third);
    if (face == 2) return vec4(0.5, third, 0.5, third);
    if (face == 3) return vec4(0.0, 2.0 * third, 0.5, third);
    return vec4(0.5, 2.0 * third, 0.5, third);
}
