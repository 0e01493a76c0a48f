// texture.glsl: value of a material's texture slot at texture coordinates. Every texture has its own size, filter and wrap
// modes. The texels of all textures therefore lie in two stores, of floats and of bytes, and are read and filtered one by one.
// Needs:  <SCENE>; HAS_FLOAT_IMAGES, HAS_BYTE_IMAGES, HAS_WRAPS (modes other than repeat), HAS_UV1,
//         HAS_SRGB_NUMBERS (sRGB images in slots that hold numbers instead of colours)
// Units:  colours linear Rec. 709, decoded before filtering; alpha in w, 1 if a texture has none.

#ifdef HAS_BYTE_IMAGES
// Decodes sRGB (IEC 61966-2-1). For the 256 byte values the error is below 7e-7, and the result is the same on all devices with
// fma. pow() differs between drivers in the fourth digit, and a texture is decoded at every vertex of every path.
vec3 from_srgb(vec3 encoded)
{
    vec3 power = vec3(-0.07614018);
    power = fma(power, encoded, vec3(0.37265375));
    power = fma(power, encoded, vec3(-0.79606014));
    power = fma(power, encoded, vec3(1.0009507));
    power = fma(power, encoded, vec3(-0.8909903));
    power = fma(power, encoded, vec3(0.86879396));
    power = fma(power, encoded, vec3(0.48459777));
    power = fma(power, encoded, vec3(0.03533994));
    power = fma(power, encoded, vec3(0.00085403136));
    return mix(power, encoded * (1.0 / 12.92), lessThanEqual(encoded, vec3(0.04045)));
}
#endif

// Returns texel i of the store that has the image, decoded if it is sRGB.
vec4 stored_texel(uvec4 image, int i, const bool colours)
{
#ifdef HAS_BYTE_IMAGES
#ifdef HAS_FLOAT_IMAGES
    if ((image.w & IMAGE_BYTES) == 0u) return image_texel(i, IMAGE_COLOUR);
#endif
    vec4 stored = texel(texture_bytes, ivec2(i & ((1 << BYTES_SHIFT) - 1), i >> BYTES_SHIFT));
#ifdef HAS_SRGB_NUMBERS
    const bool decoded = true;
#else
    bool decoded = colours;
#endif
    if (decoded && (image.w & IMAGE_SRGB) != 0u) stored.rgb = from_srgb(stored.rgb);
    return stored;
#else
    return image_texel(i, IMAGE_COLOUR);
#endif
}

// Returns texture coordinates transformed by the affine map of a slot, before wrapping.
vec2 slot_uv(int slot, vec2 uv, vec2 uv1)
{
    vec4 row_u = slot_map_texel(slot, SLOT_MAP_U), row_v = slot_map_texel(slot, SLOT_MAP_V);
#ifdef HAS_UV1
    if ((slot_texel(slot, SLOT_IMAGE).w & IMAGE_UV1) != 0u) uv = uv1;
#endif
    return vec2(row_u.x * uv.x + row_u.y * uv.y + row_u.z, row_v.x * uv.x + row_v.y * uv.y + row_v.z);
}

// Returns the filtered value of a slot. colours: true if the slot holds colours, whose texels may be sRGB. It is
// false for slots of numbers, because llvmpipe would otherwise decode their texels and discard the result.
vec4 slot_value(int slot, vec2 uv, vec2 uv1, const bool colours)
{
    uvec4 image = slot_texel(slot, SLOT_IMAGE);
    vec2 at = slot_uv(slot, uv, uv1), size = vec2(image.yz), inside = fract(at);
#ifdef HAS_WRAPS
    uvec2 wrap = (image.ww >> uvec2(IMAGE_WRAP_U, IMAGE_WRAP_V)) & 3u;
    inside = mix(inside, clamp(at, 0.0, 1.0), equal(wrap, uvec2(WRAP_CLAMP)));
    inside = mix(inside, 1.0 - abs(2.0 * fract(0.5 * at) - 1.0), equal(wrap, uvec2(WRAP_MIRROR)));
#endif
    // Row 0 is the top, where v = 1.
    vec2 position = vec2(inside.x, 1.0 - inside.y) * size;
#ifdef HAS_WRAPS
    position = mix(clamp(position, vec2(0.5), size - 0.5), position, equal(wrap, uvec2(WRAP_REPEAT)));
#endif
    // A coordinate that rounds to the far edge wraps to the near edge, and so does the texel after the last.
    ivec2 extent = ivec2(image.yz);
    bool filtered = (image.w & IMAGE_FILTERED) != 0u;
    vec2 low = filtered ? position - 0.5 : position;
    low += mix(vec2(0.0), size, lessThan(low, vec2(0.0)));
    ivec2 corner = ivec2(low);
    vec2 part = low - vec2(corner);
    corner -= ivec2(greaterThanEqual(corner, extent)) * extent;
    int first = int(image.x) + corner.y * extent.x;
    vec4 nearest = stored_texel(image, first + corner.x, colours);
    if (!filtered) return nearest;
    ivec2 next = (corner + 1) * ivec2(lessThan(corner + 1, extent));
    int second = int(image.x) + next.y * extent.x;
    vec4 upper = mix(nearest, stored_texel(image, first + next.x, colours), part.x);
    vec4 lower = mix(stored_texel(image, second + corner.x, colours), stored_texel(image, second + next.x, colours), part.x);
    return mix(upper, lower, part.y);
}
