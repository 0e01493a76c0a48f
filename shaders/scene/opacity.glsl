// opacity.glsl: tests if light passes through a surface at a ray's hit. A mask lets light through if its opacity is below the
// cutoff. Blended surfaces are hit at random with the probability of their opacity, so that surfaces behind them need no order
// (Enderton et al. 2010, Stochastic Transparency). All of this is for scenes with opacity (HAS_ALPHA).
// Culled backs (`Material.culled`) let through all rays that hit the back in the direction from the eye to the light. Light is
// tested in this direction, too, so surfaces behind such a back are lit through it.
// Needs:  <SCENE>; HAS_TEXTURES, HAS_VERTEX_COLOURS, HAS_CULLING
#include "sampling/random.glsl"
#include "scene/instances.glsl"
#ifdef HAS_TEXTURES
#include "scene/texture.glsl"
#endif

#ifdef HAS_ALPHA
uniform uint opacity_seed;  // seed of a render, or of one light of a path set; folded on the CPU
uniform uint opacity_set;   // number of the path set
// Key of the random numbers for a ray, set before it is cast; surfaces have further keys.
uint opacity_key = 0u;
// Sequence point of the path set, for rays that every set casts through the same pixel; each key and surface permutes it.
uint opacity_point = 0u;

bool is_see_through(int shape) { return shape_texel(shape, SHAPE_MATERIAL).z != 0u; }

// Sets a new key for the next rays of an image pixel. Of 8 successive sets, the fraction that hits a surface is its opacity, up
// to one set.
void new_opacity_key(ivec2 pixel_of_image, uint use)
{
    opacity_key = pcg(uint(pixel_of_image.x) + (uint(pixel_of_image.y) << 16u) + pcg(opacity_seed + use));
    opacity_point = bitfieldReverse(opacity_set);
}

// Uniform in [0, 1), and independent for two surfaces that a ray may hit [Burley 2020, Practical Hash-based Owen Scrambling,
// with the hash of Laine & Karras 2011]: each bit of the set's number changes by the bits above it.
float opacity_chance(uint number)
{
    uint key = pcg(opacity_key + pcg(number)), x = opacity_point + key;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return float((x ^ pcg(key)) >> 8u) * (1.0 / 16777216.0);
}

// alpha: alpha of the texture and vertices; number: key of the surface, such as the triangle's number.
// front: true if a ray that travels as rays of an eye hits the front.
bool alpha_lets_through(int material, float alpha, uint number, bool front)
{
#ifdef HAS_CULLING
    uvec4 says = slots_texel(material, SLOTS_SECOND);
    if (says.w != 0u && !front) return true;
    if (says.y == ALPHA_OPAQUE) return false;
#endif
    vec4 cover = cover_texel(material, COVER_OPACITY);
    float opacity = cover.x * alpha;
    bool mask = slots_texel(material, SLOTS_SECOND).y == ALPHA_MASK;
    return mask ? opacity < cover.y : opacity_chance(number) >= opacity;
}

// weight: barycentric weights of the triangle's corners.
bool triangle_lets_through(int triangle, uvec4 face, vec3 weight, bool front)
{
    int material = int(shape_texel(int(face.w), SHAPE_MATERIAL).x);
    float alpha = 1.0;
#ifdef HAS_TEXTURES
    int slot = int(slots_texel(material, SLOTS_FIRST).x) - 1;
    if (slot >= 0) {
        vec4 uv = weight.x * uv_texel(int(face.x), UV_BOTH) + weight.y * uv_texel(int(face.y), UV_BOTH)
                + weight.z * uv_texel(int(face.z), UV_BOTH);
        alpha = slot_value(slot, uv.xy, uv.zw, false).a;
    }
#endif
#ifdef HAS_VERTEX_COLOURS
    alpha *= weight.x * colour_texel(int(face.x), COLOUR_LINEAR).a + weight.y * colour_texel(int(face.y), COLOUR_LINEAR).a
           + weight.z * colour_texel(int(face.z), COLOUR_LINEAR).a;
#endif
    return alpha_lets_through(material, alpha, uint(triangle), front);
}

// position: point of the triangle's plane; direction: of a ray from an eye, of any length.
bool lets_through(int triangle, vec3 position, vec3 direction)
{
    uvec4 face = triangle_face(triangle);
    if (!is_see_through(int(face.w))) return false;
    vec3 a = vertex_position(face.x), ab = vertex_position(face.y) - a, ac = vertex_position(face.z) - a;
    edges_in_world(triangle, a, ab, ac);
    vec3 n = cross(ab, ac), d = position - a;
    vec2 bc = vec2(dot(cross(d, ac), n), dot(cross(ab, d), n)) / dot(n, n);
    return triangle_lets_through(triangle, face, vec3(1.0 - bc.x - bc.y, bc), dot(n, direction) < 0.0);
}
#endif
