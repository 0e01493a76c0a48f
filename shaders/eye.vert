// eye.vert: a vertex as the eye sees it.
#include <SCENE>
#include "camera.glsl"

uniform vec2 eye_range;  // near and far distance

void main()
{
    gl_Position = clip_from_eye(eye_from_world(vertex_position(uint(gl_VertexID))), eye_range);
}
