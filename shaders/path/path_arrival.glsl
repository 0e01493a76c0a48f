// path_arrival.glsl: vertex at which a path arrives, found by a scan, and the emission of its surface or of the
// sky.
// Needs:  surface.glsl, direct.glsl, path_next.glsl, ray_record.glsl
// Frame:  world. Units: radiance W sr^-1 m^-2, linear Rec. 709.
#include "gl/texels.glsl"
#include "path/direction_code.glsl"
#include "path/path_result.glsl"
#include "film/split_light.glsl"

TEXELS(rgba32f, path_position);
TEXELS(rgba32f, path_beta);
TEXELS(rgba32f, path_radiance);
uniform vec3 path_d[VIEWS];
uniform int path_views;
#ifdef SPLIT_LIGHT
TEXELS(rgba32f, path_direct);
uniform bool first_bounce;  // true if only one surface has reflected the light found here
#endif

struct Arrival
{
    int triangle;     // index of the triangle; below 0 if the path has no further vertex
    vec3 position;
    vec4 plane;       // plane of the triangle
    Surface surface;
    bool front;       // true if the path arrives on the triangle's front
    float t;          // distance from the previous vertex
    vec3 wo;          // unit direction back along the path
    vec3 throughput;  // throughput before the reflection at this vertex
    vec4 radiance;    // radiance summed so far; a: events of the path, see accumulate.glsl
};

Arrival arrive(ivec2 pixel)
{
    Arrival a;
    a.radiance = texel(path_radiance, pixel);
#ifdef SPLIT_LIGHT
    direct_part = texel(path_direct, pixel).rgb;
#endif
    float weight;
    a.triangle = path_result(pixel, weight);
    if (a.triangle != PATH_DEAD) a.radiance.a += scan_events(a.triangle);
#ifdef HAS_SKY
    if (a.triangle == PATH_MISSED) {
        // MIS weight of the sky against the light sample of the previous vertex, as for emission below.
        float direction_code = texel(path_position, pixel).w;
        float escaped = direction_pdf(coded_cosine(direction_code), path_views);
        vec3 seen = path_d[coded_view(direction_code)] * sign(direction_code);
        vec3 beta = texel(path_beta, pixel).rgb * weight;
        if (escaped > 0.0) a.radiance.rgb += beta * sky(seen) * power_heuristic(escaped, sky_pdf(seen));
#ifdef SPLIT_LIGHT
        if (escaped > 0.0 && first_bounce) direct_part += beta * sky(seen) * power_heuristic(escaped, sky_pdf(seen));
#endif
    }
#endif
    if (a.triangle < 0) return a;
    vec4 from = texel(path_position, pixel);
    a.throughput = texel(path_beta, pixel).rgb * weight;
    vec3 d = path_d[coded_view(from.w)] * sign(from.w);
    a.plane = hit_plane(a.triangle, pixel);
    a.t = max(0.0, (a.plane.w - dot(a.plane.xyz, from.xyz)) / dot(a.plane.xyz, d));
    a.position = from.xyz + a.t * d;
    a.wo = -d;
    a.surface = hit_surface(a.triangle, pixel, a.position, a.plane);
    a.front = front_hit(a.plane.xyz, d);

    // MIS weight of emission against the light sample of the previous vertex [Veach 1997]. Without it, emission
    // would count twice.
    float pdf_area;
    vec3 Le = emitted(a.surface, a.front, pdf_area);
    float pdf = direction_pdf(coded_cosine(from.w), path_views);
    if (pdf > 0.0) a.radiance.rgb += a.throughput * Le * emission_share(pdf, pdf_area, a.t, dot(a.plane.xyz, d));
#ifdef SPLIT_LIGHT
    if (pdf > 0.0 && first_bounce)
        direct_part += a.throughput * Le * emission_share(pdf, pdf_area, a.t, dot(a.plane.xyz, d));
#endif
    return a;
}
