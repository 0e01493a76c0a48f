// surface.glsl: hit surfaces and their scattering; the only file that reads materials and textures.
// Needs:  <SCENE>; the following, if the scene has the feature:
//         HAS_NORMALS             shading normals other than the triangle's; HAS_VERTEX_NORMALS, HAS_NORMAL_MAPS
//         HAS_MULTIPLE_SCATTERING microfacets with energy compensation
//         HAS_COAT_NORMALS        clearcoats with normals other than their base's
//         HAS_TEXTURES            textures of any slot; HAS_EMISSION_TEXTURES, HAS_SURFACE_TEXTURES, HAS_TRANSMISSION_TEXTURES,
//                                 HAS_COAT_TEXTURES, HAS_SPECULAR_TEXTURES, HAS_IRIDESCENCE_TEXTURES,
//                                 HAS_DIFFUSE_TRANSMISSION_TEXTURES, HAS_SHEEN_TEXTURES, HAS_SHEEN_ROUGHNESS_TEXTURES; see also
//                                 texture.glsl
//         HAS_ANISOTROPY          microfacets with two roughnesses; HAS_ANISOTROPY_TEXTURES
//         HAS_UV                  texture coordinates of vertices
//         HAS_VERTEX_COLOURS      colours of vertices; HAS_COLOURED_LIGHT: colours that multiply the emission
//         HAS_TRIANGLE_DENSITIES  shapes whose triangles have light samples of different densities
// Frame:  world; wo and wi are unit and point away from the surface; `n` is unit and on wo's side.
// Units:  radiance W sr^-1 m^-2, linear Rec. 709. BRDFs are relative to that of a white Lambertian surface, 1 / pi.
//         The outgoing radiance is thus beta * bsdf_eval * cos * E / pi.
#include <CONSTANTS>
#include "bsdf/bsdf.glsl"
#include "scene/instances.glsl"
#ifdef HAS_TEXTURES
#include "scene/texture.glsl"
#endif

struct Surface
{
    vec3 position;
    vec3 normal;   // geometric unit normal on the front side
    vec3 smooth_normal;  // unit shading normal on the front side, by vertex normals and a normal map if any
#ifdef HAS_NORMAL_MAPS
    vec3 vertex_normal;  // smooth normal without the normal map
#endif
#ifdef HAS_COAT_NORMALS
    vec3 coat_normal;    // shading normal of the clearcoat, on the front side
#endif
    vec2 uv;
    vec2 uv1;      // second texture coordinates
#ifdef HAS_ANISOTROPY
    // Unit vector in the triangle's plane towards growing u of the normal map, else of the anisotropy texture, else of the first
    // texture coordinates; along_v: perpendicular, towards growing v. Both are 0 if the coordinates are constant.
    vec3 along_u;
    vec3 along_v;
#endif
    vec4 colour;   // colour of the vertices, linear Rec. 709, and alpha
    int triangle;  // index of the triangle; -1 for other primitives
    int shape;
    int material;
    bool emits_back;  // true if a surface that emits also emits from its back
};

// Returns true if a ray along `direction` hits the front.
bool front_hit(vec3 normal, vec3 direction)
{
    return dot(normal, direction) < 0.0;
}

// Sets the geometric normal, and all shading normals to the same. Vertex normals and normal maps may change these
// later. normal: unit, on the front side.
void set_normal(inout Surface s, vec3 normal)
{
    s.normal = s.smooth_normal = normal;
#ifdef HAS_NORMAL_MAPS
    s.vertex_normal = normal;
#endif
#ifdef HAS_COAT_NORMALS
    s.coat_normal = normal;
#endif
}

// Returns a surface with the properties that its shape determines, and defaults for all others.
Surface surface_of_shape(int shape, vec3 position, vec3 normal)
{
    uvec2 of_shape = shape_texel(shape, SHAPE_MATERIAL).xy;
    Surface s;
    s.position = position;
    set_normal(s, normal);
    s.uv = s.uv1 = vec2(0.0);
#ifdef HAS_ANISOTROPY
    s.along_u = s.along_v = vec3(0.0);
#endif
    s.colour = vec4(1.0);
    s.triangle = -1;
    s.shape = shape;
    s.material = int(of_shape.x);
    s.emits_back = of_shape.y != 0u;
    return s;
}

#ifdef HAS_NORMAL_MAPS
// Applies a normal map to the smooth normal `n` [glTF 2.0, 3.9.3]. along_u: vector on the surface, of any length,
// along which the slot's u grows and its v is constant; along_v: the converse. Mirrored vectors mirror the map.
vec3 mapped_normal(Surface s, vec3 n, int slot, vec3 along_u, vec3 along_v)
{
    vec3 t = along_u - dot(along_u, n) * n;
    float square = dot(t, t);
    if (!(square > 0.0)) return n;
    t *= inversesqrt(square);
    vec3 b = cross(n, t);
    if (dot(b, along_v) < 0.0) b = -b;
    vec3 stored = 2.0 * slot_value(slot, s.uv, s.uv1, false).xyz - 1.0;
    stored.xy *= slot_map_texel(slot, SLOT_MAP_U).w;
    vec3 mapped = stored.x * t + stored.y * b + stored.z * n;
    float length2 = dot(mapped, mapped);
    return length2 > 0.0 ? mapped * inversesqrt(length2) : n;
}

int normal_slot(int material) { return int(slots_texel(material, SLOTS_FIRST).z) - 1; }
#ifdef HAS_COAT_NORMALS
int coat_normal_slot(int material) { return int(slots_texel(material, SLOTS_COAT).z) - 1; }
#endif

// Applies a normal map on a triangle. uv_a, uv_b, uv_c: texture coordinates of its corners, (u, v) of both sets;
// ab, ac: edges from its first corner.
vec3 mapped_on_triangle(Surface s, vec3 n, int slot, vec4 uv_a, vec4 uv_b, vec4 uv_c, vec3 ab, vec3 ac)
{
    vec2 p = slot_uv(slot, uv_a.xy, uv_a.zw);
    vec2 to_b = slot_uv(slot, uv_b.xy, uv_b.zw) - p, to_c = slot_uv(slot, uv_c.xy, uv_c.zw) - p;
    float turn = to_b.x * to_c.y - to_b.y * to_c.x < 0.0 ? -1.0 : 1.0;
    return mapped_normal(s, n, slot, turn * (to_c.y * ab - to_b.y * ac), turn * (to_b.x * ac - to_c.x * ab));
}
#endif

// Interpolates vertex attributes by the barycentric weights of a triangle's corners; ab, ac: edges from the first
// corner.
void interpolate(inout Surface s, uvec4 face, vec3 weight, vec3 ab, vec3 ac)
{
#ifdef HAS_UV
    vec4 uv_a = uv_texel(int(face.x), UV_BOTH), uv_b = uv_texel(int(face.y), UV_BOTH), uv_c = uv_texel(int(face.z), UV_BOTH);
    s.uv = weight.x * uv_a.xy + weight.y * uv_b.xy + weight.z * uv_c.xy;
#ifdef HAS_UV1
    s.uv1 = weight.x * uv_a.zw + weight.y * uv_b.zw + weight.z * uv_c.zw;
#endif
#endif
#ifdef HAS_ANISOTROPY
    vec2 q = uv_b.xy - uv_a.xy, r = uv_c.xy - uv_a.xy;
#if defined(HAS_ANISOTROPY_TEXTURES) || defined(HAS_NORMAL_MAPS)
    int tangent_slot = -1;
#ifdef HAS_ANISOTROPY_TEXTURES
    tangent_slot = int(slots_texel(s.material, SLOTS_COAT).w) - 1;
#endif
#ifdef HAS_NORMAL_MAPS
    if (normal_slot(s.material) >= 0) tangent_slot = normal_slot(s.material);
#endif
    if (tangent_slot >= 0) {
        vec2 uv_first = slot_uv(tangent_slot, uv_a.xy, uv_a.zw);
        q = slot_uv(tangent_slot, uv_b.xy, uv_b.zw) - uv_first;
        r = slot_uv(tangent_slot, uv_c.xy, uv_c.zw) - uv_first;
    }
#endif
    float side = q.x * r.y - q.y * r.x < 0.0 ? -1.0 : 1.0;
    vec3 along = side * (r.y * ab - q.y * ac);
    if (dot(along, along) > 0.0) {
        s.along_u = normalize(along);
        s.along_v = side * cross(s.normal, s.along_u);
    }
#endif
#ifdef HAS_VERTEX_COLOURS
    s.colour = weight.x * colour_texel(int(face.x), COLOUR_LINEAR) + weight.y * colour_texel(int(face.y), COLOUR_LINEAR)
             + weight.z * colour_texel(int(face.z), COLOUR_LINEAR);
#endif
#ifdef HAS_VERTEX_NORMALS
    vec3 n_a = shading_texel(int(face.x), SHADING_NORMAL).xyz, n_b = shading_texel(int(face.y), SHADING_NORMAL).xyz;
    vec3 n_c = shading_texel(int(face.z), SHADING_NORMAL).xyz;
#ifdef HAS_INSTANCES
    Placing p = placing_of(s.triangle);
    n_a = placed_normal(p, n_a);
    n_b = placed_normal(p, n_b);
    n_c = placed_normal(p, n_c);
#endif
    vec3 n = weight.x * n_a + weight.y * n_b + weight.z * n_c;
    // Meshes without vertex normals store zeros. They are shaded flat, and so are points whose normal is on the
    // wrong side.
    if (dot(n, s.normal) > 0.0) s.smooth_normal = normalize(n);
#endif
#ifdef HAS_COAT_NORMALS
    s.coat_normal = s.smooth_normal;
    int coat_slot = coat_normal_slot(s.material);
    if (coat_slot >= 0) s.coat_normal = mapped_on_triangle(s, s.coat_normal, coat_slot, uv_a, uv_b, uv_c, ab, ac);
#endif
#ifdef HAS_NORMAL_MAPS
    s.vertex_normal = s.smooth_normal;
    int slot = normal_slot(s.material);
    if (slot >= 0) s.smooth_normal = mapped_on_triangle(s, s.smooth_normal, slot, uv_a, uv_b, uv_c, ab, ac);
#endif
}

// Returns the shading normal `n`, tilted towards the eye if it points away from the eye. Without the tilt, the
// outline of a smooth object would be black.
vec3 facing_normal(vec3 n, vec3 wo)
{
#ifdef HAS_NORMALS
    float away = dot(n, wo);
    if (away < 1e-3) n = normalize(n + (1e-3 - away) * wo);
#endif
    return n;
}

vec3 shading_normal(Surface s, bool front, vec3 wo)
{
    return facing_normal(front ? s.smooth_normal : -s.smooth_normal, wo);
}

// Returns the normal for mirror reflection, in general the shading normal `n`. If `n` reflects wo below the
// surface, the mirror direction is lifted to just above the surface, and the half vector of that direction and wo
// is returned. The result changes continuously with `n`. It depends on wo, so reflection by it is not reciprocal.
// `normal`: geometric, on wo's side.
// Source: Keller et al. 2017, The Iray light transport simulation and rendering system, A.3 (bent normals). The height above
//         the surface is that of Cycles' ensure_valid_specular_reflection, which leaves a flat surface unchanged.
vec3 mirroring_normal(vec3 n, vec3 normal, vec3 wo)
{
#ifdef HAS_NORMALS
    vec3 mirrored = reflect(-wo, n);
    float height = dot(mirrored, normal), min_height = min(0.9 * dot(normal, wo), 0.01);
    if (height < min_height) n = normalize(wo + normalize(mirrored + (min_height - height) * normal));
#endif
    return n;
}

// Cosine between the interpolated vertex normal and the geometric normal. It shows how far a coarse mesh is from
// the smooth surface that it approximates.
float vertex_cosine(Surface s, bool front, vec3 wo)
{
#ifdef HAS_NORMAL_MAPS
    vec3 n = front ? s.vertex_normal : -s.vertex_normal;
#else
    vec3 n = front ? s.smooth_normal : -s.smooth_normal;
#endif
    return dot(facing_normal(n, wo), front ? s.normal : -s.normal);
}

// Ratio of the light that a surface receives from wi with shading normal `n` to that with the geometric normal
// `normal`, which faces wi. A coarse mesh loses light from directions that are above the triangle's plane but below
// the plane of its vertex normal. Of uniform light, the fraction (1 + vertex_cosine) / 2 is left. The ratio is
// divided by this fraction, so that a white furnace stays uniform. Normal maps are not compensated, because their
// bumps do shade each other, and glTF weights light only by the cosine.
float shading_cosine(vec3 n, vec3 normal, float vertex_cosine, vec3 wi)
{
#ifdef HAS_NORMALS
    return max(dot(n, wi), 0.0) / max(dot(normal, wi), 1e-6) * (2.0 / (1.0 + max(vertex_cosine, 0.0)));
#else
    return 1.0;
#endif
}

#ifdef HAS_MICROFACETS
// BRDF of microfacets and clearcoat, relative to the cosine of wi with the geometric normal: each lobe's BRDF is
// multiplied by wi's cosine with the lobe's own normal, and divided by wi's cosine with the geometric normal.
vec3 mirroring_eval(Bsdf b, vec3 n, vec3 normal, vec3 wo, vec3 wi)
{
    mat3 axes = surface_axes(b, mirroring_normal(n, normal, wo));
    vec3 o = wo * axes, i = wi * axes;
#ifdef HAS_COAT_NORMALS
    mat3 over = coat_axes(b, axes);
    vec3 coat_i = wi * over;
    vec3 f = microfacet_lobe(b, o, i).f * max(i.z, 0.0) + coat_lobe(b, wo * over, coat_i).f * max(coat_i.z, 0.0);
    return f / max(dot(normal, wi), 1e-6);
#else
    return (microfacet_lobe(b, o, i).f + coat_lobe(b, o, i).f) * (max(i.z, 0.0) / max(dot(normal, wi), 1e-6));
#endif
}
#endif

// Surface at a point of a triangle with a known plane (see FACET_PLANE).
Surface surface_of_triangle(int triangle, vec3 position, vec4 plane)
{
    uvec4 face = triangle_face(triangle);
    Surface s = surface_of_shape(int(face.w), position, plane.xyz);
    s.triangle = triangle;
#if defined(HAS_UV) || defined(HAS_NORMALS) || defined(HAS_VERTEX_COLOURS)
    vec3 a = vertex_position(face.x), ab = vertex_position(face.y) - a, ac = vertex_position(face.z) - a;
    edges_in_world(triangle, a, ab, ac);
    vec3 n = cross(ab, ac), d = position - a;
    vec2 bc = vec2(dot(cross(d, ac), n), dot(cross(ab, d), n)) / dot(n, n);
    interpolate(s, face, vec3(1.0 - bc.x - bc.y, bc), ab, ac);
#endif
    return s;
}

// Variants of the functions above for the triangle that a pixel's ray has hit. It may be streamed; its data are then in
// the pixel's record.
#ifdef STREAMED
#include "scene/stream_records.glsl"
TEXELS(rgba32f, hit_records);

vec4 hit_plane(int triangle, ivec2 pixel)
{
    if (triangle < first_streamed) return facet_texel(triangle, FACET_PLANE);
    return texel(hit_records, record_texel(pixel, RECORD_PLANE));
}

// Index of the triangle's shape. A streamed triangle has no vertex attributes, so hit_surface() shades it flat.
int hit_shape(int triangle, ivec2 pixel)
{
    if (triangle < first_streamed) return shape_of(triangle);
    return int(texel(hit_records, record_texel(pixel, RECORD_CORNER_A)).w);
}

Surface hit_surface(int triangle, ivec2 pixel, vec3 position, vec4 plane)
{
    if (triangle < first_streamed) return surface_of_triangle(triangle, position, plane);
    Surface s = surface_of_shape(hit_shape(triangle, pixel), position, plane.xyz);
    s.triangle = triangle;
    return s;
}
#else
#ifdef HAS_INSTANCES
#define hit_shape(primitive, pixel) int(triangle_face(primitive).w)
#else
#define hit_shape(primitive, pixel) shape_of(primitive)
#endif
#define hit_plane(triangle, pixel) triangle_plane(triangle)
#define hit_surface(triangle, pixel, position, plane) surface_of_triangle(triangle, position, plane)
#endif

// The functions below return factors on a material's values, from textures and vertex colours; 1 if there are none.

#ifdef HAS_TEXTURES
vec4 slot_or_one(uint slot, Surface s, const bool colours)
{
    return slot == 0u ? vec4(1.0) : slot_value(int(slot) - 1, s.uv, s.uv1, colours);
}
#define COLOURS(slot) slot_or_one(slot, s, true)
#define NUMBERS(slot) slot_or_one(slot, s, false)
#endif

// Returns factors: rgb on the reflectance, a on the opacity.
vec4 base_colour(Surface s)
{
    vec4 colour = vec4(1.0);
#ifdef HAS_TEXTURES
    colour = COLOURS(slots_texel(s.material, SLOTS_FIRST).x);
#endif
#ifdef HAS_VERTEX_COLOURS
    colour *= s.colour;
#endif
    return colour;
}

// Returns factors: x on the roughness, y on metallic.
vec2 roughness_metallic(Surface s)
{
#ifdef HAS_SURFACE_TEXTURES
    return NUMBERS(slots_texel(s.material, SLOTS_FIRST).y).yz;
#else
    return vec2(1.0);
#endif
}

float transmission_factor(Surface s)
{
#ifdef HAS_TRANSMISSION_TEXTURES
    return NUMBERS(slots_texel(s.material, SLOTS_SECOND).x).x;
#else
    return 1.0;
#endif
}

#ifdef HAS_ANISOTROPY
// Sets the tangent of the microfacets. surface: MATERIAL_SURFACE; a texture multiplies its anisotropy, in z.
void set_tangent(inout Bsdf b, Surface s, inout vec4 surface)
{
    vec2 tangent = vec2(cos(surface.w), sin(surface.w));
#ifdef HAS_ANISOTROPY_TEXTURES
    uint anisotropy_slot = slots_texel(s.material, SLOTS_COAT).w;
    if (anisotropy_slot != 0u) {
        vec3 stored = slot_value(int(anisotropy_slot) - 1, s.uv, s.uv1, false).xyz;
        vec2 along = 2.0 * stored.xy - 1.0;
        tangent = vec2(along.x * tangent.x - along.y * tangent.y, along.x * tangent.y + along.y * tangent.x);
        surface.z *= stored.z;
    }
#endif
    b.tangent = tangent.x * s.along_u + tangent.y * s.along_v;
}
#endif

#ifdef HAS_DIFFUSE_TRANSMISSION
// Splits the diffuse base into reflection and transmission. share: fraction of the surface that has a diffuse base.
void part_diffuse(inout Bsdf b, Surface s, float share)
{
    vec4 through = material_texel(s.material, MATERIAL_THROUGH);
#ifdef HAS_DIFFUSE_TRANSMISSION_TEXTURES
    uvec4 through_slots = slots_texel(s.material, SLOTS_THROUGH);
    through *= vec4(COLOURS(through_slots.y).rgb, NUMBERS(through_slots.x).a);
#endif
    b.diffuse_through = through.rgb * (through.w * share);
    b.diffuse *= 1.0 - through.w;
}
#endif

#ifdef HAS_SHEEN_ROUGHNESS_TEXTURES
// Sets the sheen's alpha, and the coefficients that depend on it: those of Charlie's lambda, and those of the
// logarithm of white sheen's albedo, interpolated in a table.
void set_sheen_alpha(inout Bsdf b, float alpha)
{
    b.sheen_alpha = max(alpha, SHEEN_MIN_ALPHA);
    float lowest = sqrt(sqrt(SHEEN_MIN_ALPHA));
    float at = clamp((sqrt(sqrt(b.sheen_alpha)) - lowest) / (1.0 - lowest), 0.0, 1.0) * float(SHEEN_CELLS);
    int cell = min(int(at), SHEEN_CELLS - 1);
    float part = at - float(cell);
    b.sheen_albedo = mat2x4(
        mix(sheen_fit_texel(cell, SHEEN_FIT_LOW), sheen_fit_texel(cell + 1, SHEEN_FIT_LOW), part),
        mix(sheen_fit_texel(cell, SHEEN_FIT_HIGH), sheen_fit_texel(cell + 1, SHEEN_FIT_HIGH), part));
    float smoother = (1.0 - b.sheen_alpha) * (1.0 - b.sheen_alpha);
    b.sheen_lambda = mix(CHARLIE_MAX, CHARLIE_MIN, smoother);
    b.sheen_lambda_a = mix(CHARLIE_MAX_A, CHARLIE_MIN_A, smoother);
}
#endif

#ifdef HAS_MICROFACETS
// Sets the layers over the base: thin film, clearcoat and sheen. reflects: 1 if the visible side reflects,
// otherwise 0.
void cover(inout Bsdf b, Surface s, float reflects)
{
#ifdef HAS_IRIDESCENCE
    vec4 film = material_texel(s.material, MATERIAL_FILM);
#ifdef HAS_IRIDESCENCE_TEXTURES
    uvec4 film_slots = slots_texel(s.material, SLOTS_SPECULAR);
    film.x *= NUMBERS(film_slots.z).x;
    film.z = mix(film.y, film.z, NUMBERS(film_slots.w).y);
#endif
    b.film = film.xzw;
#endif
#ifdef HAS_COAT
    vec4 coat = material_texel(s.material, MATERIAL_COAT);
#ifdef HAS_COAT_TEXTURES
    uvec4 coat_slots = slots_texel(s.material, SLOTS_COAT);
    coat.xy *= vec2(NUMBERS(coat_slots.x).x, NUMBERS(coat_slots.y).y);
#endif
    b.coat = coat.x * reflects;
    b.coat_alpha = coat.y * coat.y;
#endif
#ifdef HAS_SHEEN
    vec4 sheen = material_texel(s.material, MATERIAL_SHEEN);
#ifdef HAS_SHEEN_TEXTURES
    sheen.rgb *= COLOURS(slots_texel(s.material, SLOTS_THROUGH).z).rgb;
#endif
    b.sheen = sheen.rgb * reflects;
    b.sheen_alpha = sheen.w;
    b.sheen_albedo = mat2x4(material_texel(s.material, MATERIAL_SHEEN_ALBEDO0), material_texel(s.material, MATERIAL_SHEEN_ALBEDO1));
    b.sheen_lambda = material_texel(s.material, MATERIAL_SHEEN_LAMBDA);
    b.sheen_lambda_a = material_texel(s.material, MATERIAL_SHEEN_LAMBDA_A).x;
#ifdef HAS_SHEEN_ROUGHNESS_TEXTURES
    uint rough_slot = slots_texel(s.material, SLOTS_THROUGH).w;
    if (rough_slot != 0u) {
        float rough = slot_value(int(rough_slot) - 1, s.uv, s.uv1, false).a;
        set_sheen_alpha(b, sheen.w * rough * rough);
    }
#endif
#endif
}
#endif

#ifdef HAS_DISNEY
// Sets the properties of Burley's surface: two alphas from roughness and anisotropy; the square root of its colour
// as transmittance of each crossing of the boundary [Burley 2015]; no base if it is seen from inside.
void set_disney(inout Bsdf b, bool front, vec3 base, vec4 surface, float transmission)
{
    float aspect = sqrt(1.0 - 0.9 * surface.z), square = surface.x * surface.x;
    b.alpha = max(vec2(square / aspect, square * aspect), vec2(SMOOTH));
#ifdef HAS_GLASS
    b.transmission = sqrt(base) * transmission;
    if (front || transmission == 0.0) return;
    b.diffuse = b.metal = vec3(0.0);
    b.metallic = 0.0;
    b.layered = transmission;
#endif
}
#endif

#if defined(HAS_FRESNEL) || defined(HAS_METAL_INDICES) || defined(HAS_BECKMANN)
#define HAS_EXACT_LAYERS 1
// Sets Fresnel's equations instead of Schlick's formula, bases other than glTF's, and Beckmann's microfacets; surface:
// MATERIAL_SURFACE with its textures; transmission: fraction of the surface that is glass.
void set_exact_layers(inout Bsdf b, int material, bool front, vec3 base, vec4 surface, float transmission)
{
    vec4 exact = material_texel(material, MATERIAL_FRESNEL);
#ifdef HAS_BECKMANN
    b.is_beckmann = exact.y != 0.0;
#endif
#ifdef HAS_METAL_INDICES
    b.metal_n = material_texel(material, MATERIAL_METAL_N).rgb;
    b.metal_k = material_texel(material, MATERIAL_METAL_K).rgb;
    if (b.metallic > 0.0) b.metal_tint = b.metal / max(metal_reflects(1.0, b.metal_n, b.metal_k), vec3(1e-6));
#endif
#ifdef HAS_FRESNEL
    b.ior = exact.x;
    b.layering = int(exact.z);
    if (b.layering == LAYERING_GLTF) return;
    b.tint = b.dielectric / max(boundary_reflects(b, 1.0), 1e-9);
    if (b.layering == LAYERING_BESIDE) {
        b.layered = transmission;
        if (!front && material_texel(material, MATERIAL_DIFFUSE).w == 0.0) b.diffuse = vec3(0.0);
    }
#ifdef HAS_PLASTIC
    b.entry = mat2x4(material_texel(material, MATERIAL_PLASTIC0), material_texel(material, MATERIAL_PLASTIC1));
    b.entry_mean = exact.w;
#endif
#ifdef HAS_DISNEY
    if (b.layering == LAYERING_DISNEY) set_disney(b, front, base, surface, transmission);
#endif
#endif
}
#endif

// Returns the BSDF of a surface on the visible side; the last three parameters are factors from textures and vertex
// colours.
Bsdf bsdf_of(Surface s, bool front, vec3 colour, vec2 roughness_metallic, float transmission_factor)
{
    vec4 diffuse = material_texel(s.material, MATERIAL_DIFFUSE);
    float reflects = front || diffuse.w != 0.0 ? 1.0 : 0.0;
    vec3 base = diffuse.rgb * colour;
    Bsdf b = lambertian(base * reflects);
#ifdef HAS_HIGHLIGHTS
    vec4 phong = material_texel(s.material, MATERIAL_SPECULAR);
    b.specular = phong.rgb * reflects;
    b.exponent = phong.w;
#endif
#ifdef HAS_MIRRORS
    b.mirror = material_texel(s.material, MATERIAL_MIRROR).rgb * reflects;
#endif
#ifdef HAS_MICROFACETS
    vec4 surface = material_texel(s.material, MATERIAL_SURFACE);
    if (surface.x >= 0.0) {
        vec4 layer = material_texel(s.material, MATERIAL_LAYER);
        surface.xy *= roughness_metallic;
        float metal = surface.y, transmission = 0.0;
#ifdef HAS_GLASS
        vec4 glass = material_texel(s.material, MATERIAL_GLASS);
        transmission = (1.0 - metal) * glass.x * transmission_factor;
        // The back of glass is its boundary seen from inside, which reflects, too.
        if (transmission > 0.0) reflects = 1.0;
        b.transmission = base * transmission;
#ifdef HAS_MULTIPLE_SCATTERING
        b.glass_share = transmission / max(1.0 - metal, 1e-6);
#endif
        b.eta = glass.w != 0.0 ? -glass.w : glass.z == 0.0 ? 0.0 : front ? glass.y : 1.0 / glass.y;
#endif
#ifdef HAS_SPECULAR_TEXTURES
        uvec4 specular_slots = slots_texel(s.material, SLOTS_SPECULAR);
        float weight = NUMBERS(specular_slots.x).a;
        layer = vec4(min(layer.rgb * COLOURS(specular_slots.y).rgb, vec3(layer.w)), layer.w) * weight;
#endif
        b.diffuse = base * ((1.0 - metal - transmission) * reflects);
#ifdef HAS_DIFFUSE_TRANSMISSION
        part_diffuse(b, s, (1.0 - metal - transmission) * reflects);
#endif
        b.metal = base * metal * reflects;
        b.metallic = metal * reflects;
        b.dielectric = layer.rgb;
        b.grazing = layer.w;
        b.layered = (1.0 - metal) * reflects;
#ifdef HAS_ANISOTROPY
        set_tangent(b, s, surface);
#endif
        b.alpha = ggx_alpha(surface.x, surface.z);
        cover(b, s, reflects);
#ifdef HAS_EXACT_LAYERS
        set_exact_layers(b, s.material, front, base, surface, transmission);
#endif
    }
#endif
    return b;
}

Bsdf bsdf_at(Surface s, bool front)
{
    return bsdf_of(s, front, base_colour(s).rgb, roughness_metallic(s), transmission_factor(s));
}

#ifdef HAS_MULTIPLE_SCATTERING
// Directional albedo of single scattering by microfacets that reflect or transmit all light; first: index of the
// table's first cell.
float directional_albedo(int first, float cosine, float roughness)
{
    vec2 at = vec2(sqrt(clamp(cosine, 0.0, 1.0)), roughness) * float(ALBEDO_CELLS);
    ivec2 cell = min(ivec2(at), ivec2(ALBEDO_CELLS - 1));
    vec4 corners = albedo_texel(first + cell.y * ALBEDO_CELLS + cell.x, ALBEDO_CORNERS);
    vec2 part = at - vec2(cell);
    vec2 along = mix(corners.xz, corners.yw, part.x);
    return mix(along.x, along.y, part.y);
}

// Ratio of multiply scattered to singly scattered light. F0, grazing: reflectance at normal and at grazing
// incidence; lost: ratio of the light that single scattering loses to the light that it keeps. At each further
// scattering, the fraction `left` escapes (glpath/scene/directional_albedo.py).
vec3 further(vec3 F0, float grazing, float lost, float roughness)
{
    float left = ESCAPES[0] + roughness * (ESCAPES[1] + roughness * (ESCAPES[2] + roughness * (ESCAPES[3] + roughness * ESCAPES[4])));
    vec3 F = F0 + (grazing - F0) * (1.0 / 21.0);  // cosine-weighted hemispherical mean of Schlick's Fresnel term
    return lost * F * left / max(1.0 - F * (1.0 - left), 1e-6);
}

// Applies the energy compensation of Turquin 2019, eq. 15 and 3.4: light that single scattering loses returns in
// the lobe that lost it. The base gets the light that a dielectric transmits. cosine: between wo and the mirroring
// normal.
void keep_energy(inout Bsdf b, int material, bool front, float cosine)
{
    vec4 energy = material_texel(material, MATERIAL_ENERGY);
    if (energy.x == 0.0) return;
    bool has_base = b.layered > 0.0 && b.grazing > 0.0 && b.glass_share <= 0.0;
#ifdef HAS_IRIDESCENCE
    has_base = has_base && b.film.x <= 0.0;
#endif
    if (max(b.alpha.x, b.alpha.y) < SMOOTH) {
        if (has_base) b.base_share = base_transmittance(b, cosine);
        return;
    }
    float roughness = min(sqrt(sqrt(0.5 * dot(b.alpha, b.alpha))), 1.0);
    float once = directional_albedo(0, cosine, roughness), lost = 1.0 / once - 1.0;
    b.metal_gain = 1.0 + further(b.metal / max(b.metallic, 1e-6), 1.0, lost, roughness);
    if (has_base) {
        float grazing = directional_albedo(ALBEDO_CELLS * ALBEDO_CELLS, cosine, roughness);
        vec3 F = b.dielectric * (once - grazing) + b.grazing * grazing;
        float gain = 1.0 + mean(further(b.dielectric, b.grazing, lost, roughness));
        b.layered *= gain;
        b.base_share = max(1.0 - gain * max(F.r, max(F.g, F.b)), 0.0);
    }
#ifdef HAS_GLASS
    if (b.glass_share <= 0.0) return;
    if (b.eta > 0.0) lost = 1.0 / directional_albedo(int(front ? energy.y : energy.z), cosine, roughness) - 1.0;
    b.layered *= 1.0 + b.glass_share * lost;
    b.transmission *= 1.0 + lost;
#endif
}
#endif

// Sets the clearcoat's normal, which depends on the view direction.
void see_coat_along(inout Bsdf b, Surface s, bool front, vec3 wo)
{
#ifdef HAS_COAT_NORMALS
    vec3 n = facing_normal(front ? s.coat_normal : -s.coat_normal, wo);
    b.coat_cosine = dot(n, wo);
    b.coat_normal = mirroring_normal(n, front ? s.normal : -s.normal, wo);
#endif
}

Bsdf bsdf_seen(Surface s, bool front, vec3 wo)
{
    Bsdf b = bsdf_at(s, front);
#ifdef HAS_MULTIPLE_SCATTERING
    vec3 mirroring = mirroring_normal(shading_normal(s, front, wo), front ? s.normal : -s.normal, wo);
    keep_energy(b, s.material, front, dot(mirroring, wo));
#endif
    see_coat_along(b, s, front, wo);
    return b;
}

// Returns the radiance that a surface emits to the visible side; `pdf_area`: density of light samples per area there, 0 if it
// is not a light.
vec3 emitted(Surface s, bool front, out float pdf_area)
{
    vec4 emission = emission_texel(s.shape, EMISSION_RADIANCE);
    pdf_area = emission.w;
#ifdef HAS_TRIANGLE_DENSITIES
    if (pdf_area > 0.0 && s.triangle >= 0) pdf_area = emitter_texel(s.triangle >> 2, EMITTER_DENSITIES)[s.triangle & 3];
#endif
#ifdef HAS_EMISSION_TEXTURES
    emission.rgb *= COLOURS(slots_texel(s.material, SLOTS_FIRST).w).rgb;
#endif
#ifdef HAS_COLOURED_LIGHT
    if (slots_texel(s.material, SLOTS_SECOND).z != 0u) emission.rgb *= s.colour.rgb;
#endif
    return front || s.emits_back ? emission.rgb : vec3(0.0);
}
