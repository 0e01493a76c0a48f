// hemicube.frag: which triangle the light point sees; its number + 1, 0 for none.
// Depth is linear: a perspective depth with so near a near plane, for a shade close to a lamp, has no digits left.
uniform vec2 light_range;

layout(location = 0) out uint seen;

void main()
{
    gl_FragDepth = 1.0 / (gl_FragCoord.w * light_range.y);
    seen = uint(gl_PrimitiveID) + 1u;
}
