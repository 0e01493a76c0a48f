// stream_shadows.glsl: which shadow rays of a pixel's first surface streamed triangles block, a bit each, by the numbers
// of shadow_rays.glsl. Where the pixel sees no surface, the first bit is of the ground's ray.
// Needs:  camera.glsl; STREAM_SHADOWS: streamed triangles are asked
// A texture has a picture of words of 32 bits for each 32 rays, side by side and one above the other.
#ifdef STREAM_SHADOWS
#include "gl/texels.glsl"
UINT_TEXELS(r32ui, stream_shadows);
uniform int stream_shadow_columns;  // pictures side by side

bool blocked_by_stream(ivec2 pixel, int ray)
{
    int word = ray >> 5;
    ivec2 picture = ivec2(word % stream_shadow_columns, word / stream_shadow_columns);
    return (texel(stream_shadows, pixel + eye_size * picture).r >> uint(ray & 31) & 1u) != 0u;
}
#else
#define blocked_by_stream(pixel, ray) false
#endif
