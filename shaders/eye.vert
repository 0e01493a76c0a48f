// eye.vert: a vertex as the eye sees it.
#include "camera.glsl"

layout(location = 0) in vec3 position;

uniform vec2 eye_range;  // near and far distance

void main()
{
    gl_Position = clip_from_eye(eye_from_world(position), eye_range);
}
