// stream_shadows.glsl: one bit for each shadow ray from a pixel's first surface, set if streamed triangles block
// the ray. A bit's index is the ray's number in shadow_rays.glsl. If the pixel sees no surface, the first bit is
// that of the ground's ray.
// Needs:  camera.glsl; STREAM_SHADOWS: streamed triangles are tested
// A texture holds the words of all pixels as images, one image for each 32 rays, arranged in columns and rows.
#ifdef STREAM_SHADOWS
#include "gl/texels.glsl"
UINT_TEXELS(r32ui, stream_shadows);
uniform int stream_shadow_columns;  // number of images in a row

bool blocked_by_stream(ivec2 pixel, int ray)
{
    int word = ray >> 5;
    ivec2 picture = ivec2(word % stream_shadow_columns, word / stream_shadow_columns);
    return (texel(stream_shadows, pixel + eye_size * picture).r >> uint(ray & 31) & 1u) != 0u;
}
#else
#define blocked_by_stream(pixel, ray) false
#endif
