// direct.glsl: light that reaches a surface from the light sample of this path set [PB A.3].
// Needs:  <CONSTANTS>, <SCENE>; HAS_POSITIONAL_LIGHTS, HAS_DISTANT_LIGHTS, HAS_SKY: where the scene has them
// Units:  radiance W sr^-1 m^-2; a density per area, or per solid angle of the sky.
//
// The shadow-buffer holds which triangle each of its texels sees. A lookup does not compare a stored depth: it meets the
// plane of the triangle seen, so that neither the depth's precision nor the texel's extent make a surface shadow itself.
// At a silhouette the way to the light may pass through what only the next texel sees: that triangle is met exactly.
#include "texels.glsl"
#include "hemicube.glsl"

UINT_TEXELS(r32ui, light_buffer);
uniform float light_resolution;
uniform vec3 light_radiance;   // 0 without light; of a punctual light its intensity
uniform float light_density;   // of the light sample, see `glpath.lighting.LightSample`
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
#include "punctual.glsl"
uniform uint light_kind;       // LIGHT_AREA ...
uniform vec2 light_cone;       // see punctual.glsl
uniform bool light_quadratic;
#endif
#ifdef HAS_SKY
#include "sky.glsl"
uniform float sky_density_scale;

// Per solid angle, of the light sample in this direction.
float sky_density(vec3 direction)
{
    return dot(sky(direction), vec3(sky_density_scale));
}
#endif

// Per solid angle, of the direction in which a path leaves its surface at a cosine, having had so many to choose from;
// 0: the light sample stands alone.
float direction_density(float cosine, int views)
{
#if defined(WHOLE_SPHERE)
    return 0.0;
#else
    return views == 2 ? cosine / PI : 0.5 / PI;
#endif
}

// Veach's power heuristic: the share of a sample drawn with density a where b could have drawn it as well.
float power_heuristic(float a, float b)
{
    float a2 = a * a, b2 = b * b;
    return a2 / max(a2 + b2, 1e-37);
}

// Veach's share of a light sample: of `density` per solid angle, at a cosine to a surface where the path that goes on has
// so many directions to choose from; 0 where it ends, so that no other sample has this light.
float light_share(float density, float cosine, int views)
{
    return views == 0 ? 1.0 : power_heuristic(density, direction_density(cosine, views));
}

// Share of the way to the light that rounding may take.
const float ROUNDING = 1e-5;

// Does the way from the light point along w, from 0 to just before 1, pass through the triangle? Either side counts.
// Source: Moeller & Trumbore 1997.
bool passes_through(vec3 w, int triangle)
{
    uvec4 face = face_texel(triangle, FACE_CORNERS);
    vec3 a = vertex_position(face.x);
    vec3 ab = vertex_position(face.y) - a;
    vec3 ac = vertex_position(face.z) - a;
    vec3 s = light_position - a;
    vec3 p = cross(w, ac), q = cross(s, ab);
    float scale = 1.0 / dot(ab, p);
    vec3 uvt = vec3(dot(s, p), dot(w, q), dot(ac, q)) * scale;
    return min(uvt.x, uvt.y) >= 0.0 && uvt.x + uvt.y <= 1.0 && uvt.z > 0.0 && uvt.z < 1.0 - ROUNDING;
}

// Does something stand between the light point and `position` on `receiver`?
bool in_shadow(vec3 position, int receiver, vec4 receiver_plane)
{
    vec3 w = position - light_position;
    vec3 p = vec3(dot(w, light_tangent), dot(w, light_bitangent), dot(w, light_normal));
    int face = hemicube_face_of(p);
    vec3 f = hemicube_to_face(face, p);

    vec4 rectangle = hemicube_rectangle(face);
    vec2 atlas = hemicube_atlas(light_resolution);
    vec2 corner = rectangle.xy * atlas, extent = rectangle.zw * atlas;
    float low = hemicube_low(face), height = 1.0 - low;
    vec2 place = vec2(0.5 * (f.x / f.z + 1.0), (f.y / f.z - low) / height) * extent;
    vec2 centre = clamp(floor(place), vec2(0.0), extent - 1.0) + 0.5;

    // The four texels around the place; one of them is its own. Of the others, one that sees something else.
    vec2 least = floor(clamp(place, vec2(1.0), extent - 1.0) - 0.5);
    ivec2 at = ivec2(corner + least + 0.5);
    uvec4 four = uvec4(texel(light_buffer, at).r, texel(light_buffer, at + ivec2(1, 0)).r,
                       texel(light_buffer, at + ivec2(0, 1)).r, texel(light_buffer, at + ivec2(1, 1)).r);
    bvec2 upper = greaterThan(centre, least + 1.0);
    uvec2 row = upper.y ? four.zw : four.xy, next = upper.y ? four.xy : four.zw;
    uint own = upper.x ? row.y : row.x;
    uint beside = upper.x ? row.x : row.y, above = upper.x ? next.y : next.x, across = upper.x ? next.x : next.y;
    int other = int(beside != own ? beside : above != own ? above : across) - 1;
    if (other != int(own) - 1 && other >= 0 && other != receiver && passes_through(w, other)) return true;

    int seen = int(own) - 1;
    if (seen < 0 || seen == receiver) return false;

    // Where does the occluder's plane cut the way from the light (0) to the surface (1)?
    vec4 plane = facet_texel(seen, FACET_PLANE);
    float offset = plane.w - dot(plane.xyz, light_position);
    float cut = offset / dot(plane.xyz, w);
    if (!(cut > 0.0 && cut < 1.0 - ROUNDING)) return false;

    // Two triangles that meet at an edge hide each other when one is continued past it. At the texel's centre, where
    // the buffer knows for certain, the occluder must be in front as well.
    vec2 share = centre / extent;
    vec3 l = hemicube_from_face(face, vec3(2.0 * share.x - 1.0, low + height * share.y, 1.0));
    vec3 c = l.x * light_tangent + l.y * light_bitangent + l.z * light_normal;
    float occluder = offset / dot(plane.xyz, c);
    float surface = (receiver_plane.w - dot(receiver_plane.xyz, light_position)) / dot(receiver_plane.xyz, c);
    return surface <= 0.0 || occluder < surface * (1.0 - ROUNDING);
}

struct DirectLight
{
    vec3 wi;       // unit, towards the light
    vec3 light;    // radiance that a white Lambertian surface makes of it, over the sample's density
    bool distant;  // from infinitely far: whether something stands between is not known yet
};

// normal: on the lit side; views: see light_share.
DirectLight direct_light(vec3 position, vec3 normal, int receiver, vec4 receiver_plane, int views)
{
    vec3 w = light_position - position;
    DirectLight found = DirectLight(vec3(0.0), vec3(0.0), false);
#ifdef HAS_DISTANT_LIGHTS
    found.distant = light_kind == LIGHT_DIRECTIONAL || light_kind == LIGHT_SKY;
    if (found.distant) w = -light_normal;
#endif
    float r2 = dot(w, w);
    vec3 wi = w * inversesqrt(r2);
    float cos_surface = dot(normal, wi);
    float cos_light = -dot(light_normal, wi);
    if (cos_surface <= 0.0 || r2 == 0.0) return found;
    found.wi = wi;
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
    if (light_kind != LIGHT_AREA) {
        bool spot = light_kind == LIGHT_SPOT, fades = light_quadratic && !found.distant;
        vec3 E = punctual_irradiance(light_radiance, fades, r2, spot, light_cone, cos_light);
        // No direction finds what has no extent.
        float share = light_kind == LIGHT_SKY ? light_share(light_density, cos_surface, views) : 1.0;
        if (found.distant || (max(E.r, max(E.g, E.b)) > 0.0 && !in_shadow(position, receiver, receiver_plane)))
            found.light = E * (share * cos_surface / (PI * light_density));
        return found;
    }
#endif
    if (cos_light <= 0.0) return found;
    float g = cos_surface * cos_light / r2;
    float share = light_share(light_density * r2 / cos_light, cos_surface, views);
    if (!in_shadow(position, receiver, receiver_plane)) found.light = light_radiance * (share * g / (PI * light_density));
    return found;
}
