// texture.glsl: what a material's texture slot has at texture coordinates. Every texture has its own size, filter and wrap
// modes, so the texels of all lie in two stores, of floats and of bytes, and are read and filtered one by one.
// Needs:  <SCENE>; HAS_FLOAT_IMAGES, HAS_BYTE_IMAGES, HAS_WRAPS (other modes than repeat), HAS_UV1
// Units:  colours linear Rec. 709, decoded before they are filtered; alpha in w, 1 where a texture has none.

#ifdef HAS_BYTE_IMAGES
// From sRGB (IEC 61966-2-1), within 9e-7 of the truth, and the same wherever sums, products and square roots are:
// t^2.4 = t^2 (t^(1/4))^1.6, of which the last is nearly a line. Asked of pow(), drivers differ in the fourth digit.
vec3 from_srgb(vec3 encoded)
{
    vec3 t = (encoded + 0.055) * (1.0 / 1.055), s = sqrt(sqrt(t));
    vec3 power = ((((-0.02698354236781597 * s + 0.14721211791038513) * s - 0.3856969475746155) * s + 1.0233317613601685) * s
        + 0.25648143887519836) * s - 0.014344984665513039;
    return mix(power * t * t, encoded * (1.0 / 12.92), lessThanEqual(encoded, vec3(0.04045)));
}
#endif

vec4 image_at(uvec4 image, ivec2 at)
{
    // A coordinate that rounds to the far edge is the near one.
    ivec2 size = ivec2(image.yz);
    at -= ivec2(greaterThanEqual(at, size)) * size;
    int i = int(image.x) + at.y * size.x + at.x;
#ifdef HAS_BYTE_IMAGES
#ifdef HAS_FLOAT_IMAGES
    if ((image.w & IMAGE_BYTES) == 0u) return image_texel(i, IMAGE_COLOUR);
#endif
    vec4 stored = texel(texture_bytes, ivec2(i & ((1 << BYTES_SHIFT) - 1), i >> BYTES_SHIFT));
    if ((image.w & IMAGE_SRGB) != 0u) stored.rgb = from_srgb(stored.rgb);
    return stored;
#else
    return image_texel(i, IMAGE_COLOUR);
#endif
}

// Texture coordinates as a slot has them, before they are wrapped.
vec2 slot_uv(int slot, vec2 uv, vec2 uv1)
{
    vec4 row_u = slot_map_texel(slot, SLOT_MAP_U), row_v = slot_map_texel(slot, SLOT_MAP_V);
#ifdef HAS_UV1
    if ((slot_texel(slot, SLOT_IMAGE).w & IMAGE_UV1) != 0u) uv = uv1;
#endif
    return vec2(row_u.x * uv.x + row_u.y * uv.y + row_u.z, row_v.x * uv.x + row_v.y * uv.y + row_v.z);
}

vec4 slot_value(int slot, vec2 uv, vec2 uv1)
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
    if ((image.w & IMAGE_FILTERED) == 0u) return image_at(image, ivec2(position));
    vec2 low = position - 0.5;
    low += vec2(lessThan(low, vec2(0.0))) * size;
    ivec2 corner = ivec2(low);
    vec2 part = low - vec2(corner);
    vec4 upper = mix(image_at(image, corner), image_at(image, corner + ivec2(1, 0)), part.x);
    vec4 lower = mix(image_at(image, corner + ivec2(0, 1)), image_at(image, corner + ivec2(1, 1)), part.x);
    return mix(upper, lower, part.y);
}
