// texture.glsl: the colour of a texture. Every one repeats endlessly and has its own size and filter, so the texels of
// all lie in one store, read one by one.
// Needs:  <SCENE>

vec3 texture_texel(ivec4 image, ivec2 at)
{
    // A coordinate that rounds to the far edge is the near one.
    at = ivec2(at.x - (at.x >= image.y ? image.y : 0), at.y - (at.y >= image.z ? image.z : 0));
    int i = at.y * image.y + at.x;
    return texel(texture_texels, ivec2(i % TEXTURE_WIDTH, image.x + i / TEXTURE_WIDTH)).rgb;
}

vec3 texture_colour(int number, vec2 uv)
{
    ivec4 image = ivec4(image_texel(number, IMAGE_SIZE));  // first row of the store, width, height, is filtered
    vec2 repeat = fract(uv * repeats_texel(number, REPEATS_UV).xy), size = vec2(image.yz);
    // Row 0 is the top, where v = 1.
    vec2 position = vec2(repeat.x, 1.0 - repeat.y) * size;
    if (image.w == 0) return texture_texel(image, ivec2(position));
    vec2 low = position - 0.5;
    low += vec2(lessThan(low, vec2(0.0))) * size;
    ivec2 corner = ivec2(low);
    vec2 part = low - vec2(corner);
    vec3 upper = mix(texture_texel(image, corner), texture_texel(image, corner + ivec2(1, 0)), part.x);
    vec3 lower = mix(texture_texel(image, corner + ivec2(0, 1)), texture_texel(image, corner + ivec2(1, 1)), part.x);
    return mix(upper, lower, part.y);
}
