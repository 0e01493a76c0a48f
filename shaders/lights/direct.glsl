// direct.glsl: light that reaches a surface from the light sample of this path set [PB A.3].
// Needs:  <CONSTANTS>, <SCENE>; the needs of light_sample.glsl
//
// The shadow-buffer stores the triangle that each of its texels sees. A lookup does not compare a stored depth, but
// intersects the plane of that triangle. Neither depth precision nor texel size can thus make a surface shadow
// itself. At a silhouette the ray to the light may pass through a triangle that only a neighbouring texel sees;
// this triangle is tested exactly.
#include "gl/texels.glsl"
#include "shadow/hemicube.glsl"
#include "lights/light_sample.glsl"
#include "scene/opacity.glsl"

UINT_TEXELS(r32ui, light_buffer);
uniform float light_resolution;
uniform vec3 light_radiance;   // radiance of a light sample, see light_sample.glsl; 0 without light
uniform float light_pdf;
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
uniform uint light_kind;
uniform vec2 light_cone;
uniform bool light_quadratic;
#ifdef HAS_PROFILES
uniform int light_profile;
#endif
#endif

// Plane and corners of the triangle that a texel of the shadow-buffer sees. This triangle may be streamed.
#ifdef STREAMED
#include "scene/stream_records.glsl"
TEXELS(rgba32f, light_records);

vec4 plane_lit(int triangle, ivec2 at)
{
    if (triangle < first_streamed) return facet_texel(triangle, FACET_PLANE);
    return texel(light_records, record_texel(at, RECORD_PLANE));
}

mat3 corners_lit(int triangle, ivec2 at)
{
    if (triangle < first_streamed) {
        uvec4 face = face_texel(triangle, FACE_CORNERS);
        return mat3(vertex_position(face.x), vertex_position(face.y), vertex_position(face.z));
    }
    return mat3(texel(light_records, record_texel(at, RECORD_CORNER_A)).xyz,
                texel(light_records, record_texel(at, RECORD_CORNER_B)).xyz,
                texel(light_records, record_texel(at, RECORD_CORNER_C)).xyz);
}
#define IS_RESIDENT(triangle) ((triangle) < first_streamed)
#else
#define plane_lit(triangle, at) facet_texel(triangle, FACET_PLANE)
#define IS_RESIDENT(triangle) true
#endif

// Returns true if the segment along w, from the light sample (0) to just before the surface (1), passes through the
// triangle from either side. seen_at: texel that sees the triangle.
// Source: Moeller & Trumbore 1997.
bool passes_through(vec3 w, int triangle, ivec2 seen_at)
{
#ifdef STREAMED
    mat3 corners = corners_lit(triangle, seen_at);
    vec3 a = corners[0], ab = corners[1] - a, ac = corners[2] - a;
#else
    uvec4 face = face_texel(triangle, FACE_CORNERS);
    vec3 a = vertex_position(face.x);
    vec3 ab = vertex_position(face.y) - a;
    vec3 ac = vertex_position(face.z) - a;
#endif
    vec3 s = light_position - a;
    vec3 p = cross(w, ac), q = cross(s, ab);
    float scale = 1.0 / dot(ab, p);
    vec3 uvt = vec3(dot(s, p), dot(w, q), dot(ac, q)) * scale;
    return min(uvt.x, uvt.y) >= 0.0 && uvt.x + uvt.y <= 1.0 && uvt.z > 0.0 && uvt.z < 1.0 - ROUNDING;
}

// Returns true if something occludes `position` on `receiver` from the light sample.
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
    vec2 in_face = vec2(0.5 * (f.x / f.z + 1.0), (f.y / f.z - low) / height) * extent;
    vec2 centre = clamp(floor(in_face), vec2(0.0), extent - 1.0) + 0.5;

    // Four texels surround the position. One contains it; of the other three, take one that sees another triangle.
    vec2 lower = floor(clamp(in_face, vec2(1.0), extent - 1.0) - 0.5);
    ivec2 at = ivec2(corner + lower + 0.5);
    uvec4 four = uvec4(texel(light_buffer, at).r, texel(light_buffer, at + ivec2(1, 0)).r,
                       texel(light_buffer, at + ivec2(0, 1)).r, texel(light_buffer, at + ivec2(1, 1)).r);
    bvec2 upper = greaterThan(centre, lower + 1.0);
    uvec2 row = upper.y ? four.zw : four.xy, next = upper.y ? four.xy : four.zw;
    uint own = upper.x ? row.y : row.x;
    uint beside = upper.x ? row.x : row.y, above = upper.x ? next.y : next.x, across = upper.x ? next.x : next.y;
    int other = int(beside != own ? beside : above != own ? above : across) - 1;
#ifdef HAS_ALPHA
    // Transparency is only known at the centres of texels, so a see-through neighbour is not tested.
    if (other >= 0 && IS_RESIDENT(other) && is_see_through(int(face_texel(other, FACE_CORNERS).w))) other = -1;
#endif
    ivec2 other_at = at;
#ifdef STREAMED
    other_at += ivec2(beside != own || above == own ? !upper.x : upper.x, beside != own ? upper.y : !upper.y);
#endif
    if (other != int(own) - 1 && other >= 0 && other != receiver && passes_through(w, other, other_at)) return true;

    int seen = int(own) - 1;
    if (seen < 0 || seen == receiver) return false;

    // Position at which the occluder's plane cuts the segment from the light (0) to the surface (1).
    vec4 plane = plane_lit(seen, at + ivec2(upper));
    float offset = plane.w - dot(plane.xyz, light_position);
    float cut = offset / dot(plane.xyz, w);
    if (!(cut > 0.0 && cut < 1.0 - ROUNDING)) return false;

    // Two triangles that meet at an edge would hide each other if their planes were extended past the edge.
    // Therefore the occluder must also be in front at the texel's centre, where the buffer is exact.
    vec2 share = centre / extent;
    vec3 l = hemicube_from_face(face, vec3(2.0 * share.x - 1.0, low + height * share.y, 1.0));
    vec3 c = l.x * light_tangent + l.y * light_bitangent + l.z * light_normal;
    float occluder = offset / dot(plane.xyz, c);
    float surface = (receiver_plane.w - dot(receiver_plane.xyz, light_position)) / dot(receiver_plane.xyz, c);
    return surface <= 0.0 || occluder < surface * (1.0 - ROUNDING);
}

// Returns the light of the path set's light sample. `normal` is on the lit side; views: see mis_weight_light. Light
// from a source at infinity is not yet tested for visibility.
DirectLight direct_light(vec3 position, vec3 normal, int receiver, vec4 receiver_plane, int views)
{
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
    LightSample sample_of_set = LightSample(light_position, light_normal, light_radiance, light_pdf, light_kind,
                                            light_cone, light_quadratic
#ifdef HAS_PROFILES
                                            , light_profile
#endif
                                            );
#else
    LightSample sample_of_set = LightSample(light_position, light_normal, light_radiance, light_pdf, LIGHT_AREA,
                                            vec2(0.0), true
#ifdef HAS_PROFILES
                                            , -1
#endif
                                            );
#endif
    DirectLight found = light_from(sample_of_set, position, normal, views);
    bool arrives = max(found.light.r, max(found.light.g, found.light.b)) > 0.0;
    if (arrives && !found.distant && in_shadow(position, receiver, receiver_plane)) found.light = vec3(0.0);
    return found;
}
