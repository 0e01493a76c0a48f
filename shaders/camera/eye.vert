// eye.vert: projects a vertex to the eye's window.
#include <SCENE>
#include "camera/camera.glsl"

uniform vec2 eye_range;  // near and far distance of the eye's clip planes
#ifdef HAS_ALPHA
out vec3 world;
#endif

void main()
{
    vec3 position = vertex_position(uint(gl_VertexID));
#ifdef HAS_ALPHA
    world = position;
#endif
    gl_Position = clip_from_eye(eye_from_world(position), eye_range);
}
