// eye_hit.glsl: distance along a pixel's ray to the primitive in the eye buffer.
// Needs:  object_intersect.glsl, surface_at.glsl, camera.glsl
//
// In the buffer, all rays start at the eye. For a distant eye, t has the rounding error of that distance, 6e-4
// scene units at 10,000. It is therefore recomputed from eye_origin, ahead of the eye. Parallel rays start at
// eye_origin in the buffer, too, so their t is kept.
const float EYE_ROUNDING = 2e-6;  // maximum difference of the recomputed t, as a fraction of t

float eye_hit(int primitive, ivec2 pixel, vec3 origin, vec3 direction, float t)
{
#if !defined(EYE_ORTHOGRAPHIC) && !defined(EYE_PANORAMA)
    if (eye_ahead > 0.0 && primitive >= 0)
    {
        float expected = t - eye_ahead / dot(direction, eye_forward);
        float again = intersect_seen(primitive, pixel, origin, direction, max(expected - EYE_ROUNDING * t, 0.0));
        // The recomputed ray may miss a primitive at its edge.
        return abs(again - expected) < EYE_ROUNDING * t ? again : max(expected, 0.0);
    }
#endif
    return t;
}
