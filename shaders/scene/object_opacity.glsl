// object_opacity.glsl: the same question as in opacity.glsl of any kind of primitive.
// Needs:  <SCENE>
#include "scene/surface_at.glsl"
#include "scene/opacity.glsl"

#ifdef HAS_ALPHA
bool primitive_lets_through(int primitive, vec3 origin, vec3 direction, float t)
{
    if (!is_see_through(shape_of(primitive))) return false;
    Surface s = surface_at(primitive, origin, direction, t);
    // A sphere is hit twice.
    uint number = 2u * uint(primitive) + uint(front_hit(s.normal, direction));
    return alpha_lets_through(s.material, base_colour(s).a, number);
}
#endif
