// object_opacity.glsl: the test of opacity.glsl for any kind of primitive.
// Needs:  <SCENE>
#include "scene/surface_at.glsl"
#include "scene/opacity.glsl"

#ifdef HAS_ALPHA
// Returns true if the primitive lets the ray through at its hit. to_eye: true if the ray travels from a light
// towards an eye.
bool primitive_lets_through(int primitive, vec3 origin, vec3 direction, float t, bool to_eye)
{
    if (!is_see_through(shape_of(primitive))) return false;
    Surface s = surface_at(primitive, origin, direction, t);
    // A ray can hit a sphere twice, and the two hits need different keys.
    bool front = front_hit(s.normal, direction);
    uint number = 2u * uint(primitive) + uint(front);
    return alpha_lets_through(s.material, base_colour(s).a, number, front != to_eye);
}
#endif
