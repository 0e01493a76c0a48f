// opacity.glsl: tests if light passes through a surface at a ray's hit. A mask lets light through if its opacity is
// below the cutoff. A blended surface is hit at random with a probability equal to its opacity, so that surfaces
// need no sorting by depth (Enderton et al. 2010, Stochastic Transparency). All of this is for scenes with opacity
// (HAS_ALPHA).
// A surface with a culled back (`Material.culled`) lets a ray through if the ray, followed from the eye to the
// light, hits the back. Shadow rays are followed in this direction, too, so culled backs cast no shadow on surfaces
// behind them.
// Needs:  <SCENE>; HAS_TEXTURES, HAS_VERTEX_COLOURS, HAS_CULLING
#include "sampling/random.glsl"
#include "scene/instances.glsl"
#ifdef HAS_TEXTURES
#include "scene/texture.glsl"
#endif

#ifdef HAS_ALPHA
uniform uint opacity_seed;  // seed of a render, or of one light of a path set; hashed on the CPU
uniform uint opacity_set;   // index of the path set
// Key of a ray's random numbers, set before the ray is cast. Each surface that the ray hits adds a key of its own.
uint opacity_key = 0u;
// Sequence point of the path set, for rays that every set casts through the same pixel. It is permuted by the keys
// of the ray and of the surface.
uint opacity_point = 0u;

bool is_see_through(int shape) { return shape_texel(shape, SHAPE_MATERIAL).z != 0u; }

// Sets a new key for the next rays of an image pixel. Of 8 successive path sets, a surface of
// opacity a stops the rays of 8a, within one.
void new_opacity_key(ivec2 pixel_of_image, uint use)
{
    opacity_key = pcg(uint(pixel_of_image.x) + (uint(pixel_of_image.y) << 16u) + pcg(opacity_seed + use));
    opacity_point = bitfieldReverse(opacity_set);
}

// Returns a number uniform in [0, 1), independent for two surfaces that a ray may hit. It is the radical inverse of
// the path set's number, shuffled by the keys: each bit of that number changes by the bits above it [Burley 2020,
// Practical Hash-based Owen Scrambling, with the hash of Laine & Karras 2011].
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
// front: true if the ray, followed from the eye to the light, hits the front.
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

// Returns true if light passes through a triangle. weight: barycentric weights of the triangle's corners.
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

// position: point of the triangle's plane; direction: of the ray, followed from the eye to the light, of any
// length.
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
