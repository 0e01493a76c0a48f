// lamp_edges.glsl: lamps that a pixel sees by several of its places; see `glpath.integrators.lamp_edges`.
// Places of textures are packed into a number: x + (y << 16) + 1; 0 for none.
UINT_TEXELS(r32ui, lamp_place);  // of a pixel: where its light is
TEXELS(rgba32f, lamp_light);

ivec2 unpacked_place(uint number)
{
    return ivec2((number - 1u) & 0xffffu, (number - 1u) >> 16u);
}

// Radiance of lamps and sky; false where the pixel's path has that as all else.
bool lamps_seen(ivec2 pixel, out vec3 light)
{
    uint place = texel(lamp_place, pixel).r;
    light = place == 0u ? vec3(0.0) : texel(lamp_light, unpacked_place(place)).rgb;
    return place != 0u;
}
