// eye_hit.glsl: where the ray of a pixel meets what the eye buffer has of it.
// Needs:  object_intersect.glsl, surface_at.glsl, camera.glsl
//
// The buffer's rays all start at the eye. Of one far away, t has the rounding of the distance, 6e-4 scene units of
// 10,000: so t is found again from where eye_origin is, ahead of the eye. Parallel rays start there for the buffer, too.
const float EYE_ROUNDING = 2e-6;  // of t: what is found again is nowhere else

float eye_hit(int primitive, ivec2 pixel, vec3 origin, vec3 direction, float t)
{
#if !defined(EYE_ORTHOGRAPHIC) && !defined(EYE_PANORAMA)
    if (eye_ahead > 0.0 && primitive >= 0)
    {
        float expected = t - eye_ahead / dot(direction, eye_forward);
        float again = intersect_seen(primitive, pixel, origin, direction, max(expected - EYE_ROUNDING * t, 0.0));
        // A ray along an edge may pass beside it now.
        return abs(again - expected) < EYE_ROUNDING * t ? again : max(expected, 0.0);
    }
#endif
    return t;
}
