// surface.glsl: what is hit, and what it does with light: the only place that reads materials and textures.
// Needs:  <SCENE>
// Frame:  world; wo and wi are unit and point away from the surface; `n` is unit and on wo's side.
// Units:  radiance W sr^-1 m^-2, linear Rec. 709. A BRDF is told in units of a white Lambertian surface's, 1 / pi, so that
//         what leaves is beta * bsdf_eval * cos * E / pi.
#include <CONSTANTS>
#include "bsdf.glsl"
#ifdef HAS_TEXTURES
#include "texture.glsl"
#endif

struct Surface
{
    vec3 position;
    vec3 normal;   // geometric, unit, out of the front
    vec3 smooth_normal;  // unit, on the same side: that of the vertices where the mesh has them
    vec2 uv;
    int shape;
    int material;
    bool emits_back;  // where it emits at all
};

// Does a ray along `direction` arrive on the front?
bool front_hit(vec3 normal, vec3 direction)
{
    return dot(normal, direction) < 0.0;
}

// All that follows from the shape that was hit.
Surface surface_of_shape(int shape, vec3 position, vec3 normal)
{
    uvec2 of_shape = shape_texel(shape, SHAPE_MATERIAL).xy;
    return Surface(position, normal, normal, vec2(0.0), shape, int(of_shape.x), of_shape.y != 0u);
}

// What the vertices of a triangle bring, by the weights of its corners.
void interpolate(inout Surface s, uvec4 face, vec3 weight)
{
#ifdef HAS_TEXTURES
    s.uv = weight.x * uv_texel(int(face.x), UV_FIRST).xy + weight.y * uv_texel(int(face.y), UV_FIRST).xy
         + weight.z * uv_texel(int(face.z), UV_FIRST).xy;
#endif
#ifdef HAS_NORMALS
    vec3 n = weight.x * shading_texel(int(face.x), SHADING_NORMAL).xyz
           + weight.y * shading_texel(int(face.y), SHADING_NORMAL).xyz
           + weight.z * shading_texel(int(face.z), SHADING_NORMAL).xyz;
    // A mesh without vertex normals has zeros; one whose normals are those of another surface is shaded flat.
    if (dot(n, s.normal) > 0.0) s.smooth_normal = normalize(n);
#endif
}

// The normal to shade with, on the side that is seen. Where it looks away from the eye, which the surface does not, it is
// turned until it does not any more, or the outline of a smooth object would be black.
vec3 shading_normal(Surface s, bool front, vec3 wo)
{
    vec3 n = front ? s.smooth_normal : -s.smooth_normal;
#ifdef HAS_NORMALS
    float away = dot(n, wo);
    if (away < 1e-3) n = normalize(n + (1e-3 - away) * wo);
#endif
    return n;
}

// By how much more light a surface gets from wi with the normal n to shade with than with its own on the same side, which
// faces wi. Light from between the two planes is lost: of a uniform surrounding (1 + cos of the angle between the
// normals) / 2 is left. It is divided by that, so that a white furnace stays flat however coarse a mesh is.
float shading_cosine(vec3 n, vec3 normal, vec3 wi)
{
#ifdef HAS_NORMALS
    return max(dot(n, wi), 0.0) / max(dot(normal, wi), 1e-6) * (2.0 / (1.0 + max(dot(n, normal), 0.0)));
#else
    return 1.0;
#endif
}

// A point of a triangle whose plane (see FACET_PLANE) is at hand.
Surface surface_of_triangle(int triangle, vec3 position, vec4 plane)
{
    uvec4 face = face_texel(triangle, FACE_CORNERS);
    Surface s = surface_of_shape(int(face.w), position, plane.xyz);
#if defined(HAS_TEXTURES) || defined(HAS_NORMALS)
    vec3 a = vertex_position(face.x), ab = vertex_position(face.y) - a, ac = vertex_position(face.z) - a;
    vec3 n = cross(ab, ac), d = position - a;
    vec2 bc = vec2(dot(cross(d, ac), n), dot(cross(ab, d), n)) / dot(n, n);
    interpolate(s, face, vec3(1.0 - bc.x - bc.y, bc));
#endif
    return s;
}

// What a surface does with light on the side that is seen.
Bsdf bsdf_at(Surface s, bool front)
{
    vec4 diffuse = material_texel(s.material, MATERIAL_DIFFUSE);
    float reflects = front || diffuse.w != 0.0 ? 1.0 : 0.0;
    vec3 base = diffuse.rgb;
#ifdef HAS_TEXTURES
    uint number = textured_texel(s.material, TEXTURED_BY).x;
    if (number != 0u) base *= texture_colour(int(number) - 1, s.uv);
#endif
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
        vec4 layer = material_texel(s.material, MATERIAL_LAYER), coat = material_texel(s.material, MATERIAL_COAT);
        float metal = surface.y, clear = 0.0;
#ifdef HAS_GLASS
        vec4 glass = material_texel(s.material, MATERIAL_GLASS);
        clear = (1.0 - metal) * glass.x;
        // The back of glass is its inside.
        if (clear > 0.0) reflects = 1.0;
        b.clear = base * clear;
        b.eta = glass.z == 0.0 ? 0.0 : front ? glass.y : 1.0 / glass.y;
#endif
        b.diffuse = base * ((1.0 - metal - clear) * reflects);
        b.metal = base * metal * reflects;
        b.metallic = metal * reflects;
        b.dielectric = layer.rgb;
        b.grazing = layer.w;
        b.layered = (1.0 - metal) * reflects;
        b.alpha = ggx_alpha(surface.x, surface.z);
        b.coat = coat.x * reflects;
        b.coat_alpha = coat.y * coat.y;
    }
#endif
    return b;
}

// Radiance that a surface emits to the side that is seen; `density` per area of a light point there, 0 without light.
vec3 emitted(Surface s, bool front, out float density)
{
    vec4 emission = emission_texel(s.shape, EMISSION_RADIANCE);
    density = emission.w;
    return front || s.emits_back ? emission.rgb : vec3(0.0);
}
