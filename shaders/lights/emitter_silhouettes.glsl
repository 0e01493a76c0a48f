// emitter_silhouettes.glsl: radiance of lamps in the pixels at their edges, from several subsamples; see
// `glpath.integrators.emitter_silhouettes`.
// A texel's position is packed into one number: x + (y << 16) + 1; 0 for none.
UINT_TEXELS(r32ui, lamp_texel);  // for each pixel, packed position of its texel in lamp_light
TEXELS(rgba32f, lamp_light);

ivec2 unpacked_texel(uint number)
{
    return ivec2((number - 1u) & 0xffffu, (number - 1u) >> 16u);
}

// Sets the radiance of lamps and sky that a pixel sees. Returns false if it is not stored, because the pixel's path
// computes it.
bool lamps_seen(ivec2 pixel, out vec3 light)
{
    uint packed_texel = texel(lamp_texel, pixel).r;
    light = packed_texel == 0u ? vec3(0.0) : texel(lamp_light, unpacked_texel(packed_texel)).rgb;
    return packed_texel != 0u;
}
