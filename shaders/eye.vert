// eye.vert: a vertex as the eye sees it.
#include "eye.glsl"

layout(location = 0) in vec3 position;

void main()
{
    vec3 r = position - eye_position;
    vec3 p = vec3(dot(r, eye_right), dot(r, eye_up), dot(r, eye_forward));
    float n = eye_range.x, f = eye_range.y;
    gl_Position = vec4(p.xy * eye_window.xy + p.z * eye_window.zw, ((f + n) * p.z - 2.0 * f * n) / (f - n), p.z);
}
