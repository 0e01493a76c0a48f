// eye.frag: which triangle the eye sees; its number + 1, 0 for none.
// Depth is linear and taken from the plane: a perspective depth with so near a near plane would have no digits left.
#include <TRIANGLE>
#include "eye.glsl"

flat in uint triangle_id;
layout(location = 0) out float seen;

void main()
{
    vec4 plane = triangle_texel(int(triangle_id), TRIANGLE_PLANE);
    vec3 d = eye_direction(gl_FragCoord.xy);
    gl_FragDepth = (plane.w - dot(plane.xyz, eye_position)) / (dot(plane.xyz, d) * eye_range.y);
    seen = float(triangle_id + 1u);
}
