// eye.vert: a triangle as the eye sees it.
#include <TRIANGLE>
#include "eye.glsl"

flat out uint triangle_id;

void main()
{
    int triangle = gl_VertexID / 3;
    triangle_id = uint(triangle);
    vec3 r = triangle_texel(triangle, TRIANGLE_VERTEX0 + gl_VertexID - 3 * triangle).xyz - eye_position;
    vec3 p = vec3(dot(r, eye_right), dot(r, eye_up), dot(r, eye_forward));
    float n = eye_range.x, f = eye_range.y;
    gl_Position = vec4(p.xy * eye_window.xy + p.z * eye_window.zw, ((f + n) * p.z - 2.0 * f * n) / (f - n), p.z);
}
