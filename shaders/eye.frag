// eye.frag: which triangle the eye sees; its number + 1, 0 for none.
// Depth is linear: a perspective depth with so near a near plane has no digits left.
uniform vec2 eye_range;

layout(location = 0) out uint seen;

void main()
{
    gl_FragDepth = 1.0 / (gl_FragCoord.w * eye_range.y);
    seen = uint(gl_PrimitiveID) + 1u;
}
