// path_rays.glsl: traces whole paths, each with its own directions and light samples, through a BVH.
// Needs:  BRANCHES: number of branches into which a path splits at its first vertex; EMITTER_SILHOUETTES; GATHER,
//         GUIDED; START_POINTS: paths start at points instead of an eye; the needs of path_numbers.glsl and
//         path_direct.glsl
// Frame:  world. Units: radiance W sr^-1 m^-2, linear Rec. 709.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "camera/camera.glsl"
#include "sampling/random.glsl"
#include "lights/light_sample.glsl"
#ifdef HAS_BACKGROUND
#include "lights/background.glsl"
#endif
#include "path/path_vertex.glsl"
#include "path/lanes.glsl"
#ifdef START_POINTS
#define START_VERTEX
#include "camera/start_points.glsl"
#else
const float start_extent = 0.0;
#endif
#include "scene/ray_bvh.glsl"
#include "bsdf/cosine.glsl"
#if defined(HAS_MICROFACETS) || defined(HAS_MIRRORS)
#define HAS_LOBES
#endif
#ifdef HAS_LOBES
#include "bsdf/lobes.glsl"
#endif
#ifdef EMITTER_SILHOUETTES
#include "lights/emitter_silhouettes.glsl"
#endif
#if defined(GATHER) || defined(GUIDED)
#include "radiosity/radiosity.glsl"
#endif
#ifdef GUIDED
#include "path/path_guide.glsl"
#endif
#include "film/split_light.glsl"
#ifdef SPLIT_LIGHT
// Number of surfaces that have scattered the path, not counting thin dielectrics passed straight.
int scattered = 0;
#endif
#ifdef GATHER
uniform int lookup_depth;       // number of diffuse bounces after which the solution is looked up
// A path continues if its segment is shorter than this, times a random number in [0, 1), times min_lookup_distance.
uniform float lookup_distance;
#endif
#if defined(GATHER) || defined(CONTROL_VARIATE)
// Maximum number of vertices of a path through glass and mirrors; roulette ends paths long before.
const int MIRRORS = 1024;
#endif

#ifdef CONTROL_VARIATE
uniform int lookup_depth;         // number of diffuse bounces before the first possible look-up of the solution
// Radical inverse of the path set's index; decides which paths continue at their first look-up.
uniform float correction_number;
const float FIRST_CHANCE = 0.5;   // probability that a path continues at its first look-up
// At later look-ups, the probability of continuing is this factor times the throughput, at most 1.
const float LATER_CHANCE = 4.0;
#endif

UINT_TEXELS(r32ui, eye_buffer);
uniform ivec2 window_size;
uniform int max_depth;               // maximum number of vertices of a path
// Index of the vertex at which a path that roulette has not ended is cut, and counted as cut.
uniform int cut_depth;
// Russian roulette may end a path before each vertex from this index on (Arvo & Kirk 1990).
uniform int roulette_depth;
#ifdef HAS_GROUND
#include "lights/ground.glsl"
#endif
#include "path/path_numbers.glsl"
#include "path/path_direct.glsl"
#if defined(LIGHT_TREE) || defined(PORTALS) || defined(LAMP_RECTANGLES)
#define LIT_FROM
#endif

#ifdef HAS_DIFFUSE_TRANSMISSION
vec3 reflected_behind;  // weight of light samples behind the surface, for diffuse transmission
#endif

// State of a path between vertices.
struct RayPath
{
    PathId at;
    vec3 origin;      // start of the path's current ray
    vec3 direction;
    int triangle;     // triangle that the current ray hits, -1 for none
    vec3 L;           // radiance accumulated so far
    vec3 beta;        // throughput
    float pdf;        // density of the ray's direction, per solid angle
    float reached;    // distance from the vertex of the last light samples to the hit, including `passed`
#ifdef LIT_FROM
    vec3 lit_from;    // position of the vertex of the last light samples
    vec3 lit_normal;  // normal at lit_from, on the side into which the ray leaves
#endif
    float rays;       // number of rays cast so far
    int vertices;     // maximum number of vertices of this path
    bool continues;
#ifdef GUIDED
    float guiding_weight;  // factor that guiding has contributed to beta
#endif
#ifdef CONTROL_VARIATE
    int corrections;        // number of vertices at which the path continued although the solution was looked up
    float weight;           // factor on the throughput of the diffuse lobe, see correct()
    // Factor on emission that the ray from the diffuse lobe hits, because the solution may include direct light.
    float emission_weight;
    float emission;         // factor on emission or sky that the current ray hits
#endif
#ifdef HAS_LOBES
    float passed;      // distance from the vertex of the last light samples to the last thin dielectric passed
    int bounces;       // number of diffuse bounces; mirrors and glass do not count for a gather
    bool was_diffuse;  // true if the last bounce was diffuse
#if defined(HAS_BACKGROUND) && defined(HAS_THIN_DIELECTRICS)
    bool straight;     // true if the path only passed thin dielectrics since the eye
#endif
    vec3 inside;       // attenuation coefficient of the medium that the path is in, per scene unit
#endif
};

// Vertex that a path has reached and will leave.
struct ScatterVertex
{
    PathVertex v;
    float t;         // distance from the previous vertex, or from the last thin dielectric
    float pdf_area;  // density per area of light samples at this point, if it is on a lamp
    vec3 start;      // start of rays from the vertex, off the surface
    float rounding;  // distance of `start` from the surface
    int guide;       // index of the guide used at the vertex, -1 for none
#ifdef HAS_LOBES
    Lobes lobes;
#endif
};

// Resets the path to its state before its first bounce, for the given branch.
void begin_branch(inout RayPath path, int branch)
{
    path.at = PathId(path.at.path, 0, branch);
    path.vertices = max_depth;
#ifdef GUIDED
    path.guiding_weight = 1.0;
#endif
#ifdef CONTROL_VARIATE
    path.corrections = 0;
    path.weight = path.emission_weight = path.emission = 1.0;
#endif
#ifdef HAS_LOBES
    path.passed = 0.0;
    path.bounces = 0;
    path.was_diffuse = false;
    path.inside = vec3(0.0);
#if defined(HAS_BACKGROUND) && defined(HAS_THIN_DIELECTRICS)
    path.straight = true;
#endif
#endif
#ifdef SPLIT_LIGHT
    scattered = 0;
#endif
}

// Starts a path from the eye, or from a point, to the first vertex.
RayPath begin_path(ivec2 pixel)
{
    RayPath path;
    path.at.path = shared_path(pixel);
    begin_branch(path, 0);
#ifdef START_POINTS
    path.origin = path.direction = vec3(0.0);
#else
    path.origin = eye_origin(pixel);
    path.direction = eye_direction(pixel);
#endif
    path.triangle = int(texel(eye_buffer, pixel).r) - 1;
    path.L = vec3(0.0);
    path.beta = vec3(1.0);
    path.pdf = path.reached = path.rays = 0.0;
#ifdef LIT_FROM
    path.lit_from = path.lit_normal = vec3(0.0);
#endif
    path.continues = true;
    return path;
}

void add_light(inout RayPath path, vec3 light)
{
    path.L += light;
#ifdef SPLIT_LIGHT
    if (scattered <= 1) direct_part += light;
#endif
}

#ifdef HAS_BACKGROUND
// Returns true if the path's current ray comes straight from the eye.
bool is_from_eye(RayPath path)
{
#ifdef HAS_THIN_DIELECTRICS
    return path.straight;
#else
    return path.at.depth == 0;
#endif
}

#ifdef HAS_GROUND
// Estimates the unoccluded fraction of the sky's irradiance where the ray hits the ground; 1 if it misses the
// ground. One shadow ray is cast, in a random direction distributed by the sky's irradiance.
vec3 light_on_ground(RayPath path, ivec2 pixel)
{
    vec3 start, to_light;
    uint chance = pcg(path_in_image(pixel) + path_seed);
    if (!ground_ray(path.origin, path.direction, chance, start, to_light)) return vec3(1.0);
#ifdef HAS_ALPHA
    opacity_key_at(path.at, USE_SHADOW_OPACITY);
#endif
    if (is_blocked(start, to_light, NO_HIT, -1)) return vec3(0.0);
#ifdef HAS_THIN_DIELECTRICS
    return passed_thin_dielectrics;
#else
    return vec3(1.0);
#endif
}
#endif

// Adds the background for a ray from the eye that hits nothing.
void add_background(inout RayPath path, ivec2 pixel, float seen)
{
    vec3 light = path.beta * seen_behind(path.direction);
#ifdef HAS_GROUND
    light *= light_on_ground(path, pixel);
#endif
    add_light(path, light * (path.at.depth == 0 ? seen : 1.0));
}
#endif

#ifdef HAS_SKY
// Adds the sky for a ray that hits nothing, with its MIS weight against the light sample of the previous vertex.
// seen: weight instead, for a ray from the eye.
void add_sky(inout RayPath path, float seen)
{
#ifdef PORTALS
    float of_samples = sky_pdf(path.lit_from, path.direction);
#else
    float of_samples = sky_pdf(path.direction);
#endif
    float share = path.at.depth == 0 ? seen : power_heuristic(path.pdf, of_samples);
#ifdef CONTROL_VARIATE
    share *= path.emission;
#endif
    add_light(path, path.beta * sky(path.direction) * share);
}
#endif

// Returns the vertex at the end of the ray, and adds the light that it emits. seen: weight of light that the eye
// sees directly, 0 if lamps_seen has added it.
ScatterVertex arrive(inout RayPath path, ivec2 pixel, float seen)
{
    ScatterVertex s;
#ifdef START_POINTS
    if (at_start(path.at)) {
        s.v = start_vertex(pixel, path.triangle);
        path.triangle = s.v.triangle;
        s.t = 0.0;
    } else
#endif
        s.v = vertex_on(path.triangle, path.origin, path.direction, s.t);
#ifdef HAS_LOBES
    path.reached = path.passed + s.t;
#else
    path.reached = s.t;
#endif
#ifdef HAS_GLASS
    path.beta *= exp(-path.inside * s.t);
#endif
    if (!at_start(path.at)) {
        vec3 Le = emitted(s.v.surface, s.v.front, s.pdf_area);
#ifdef LIGHT_TREE
        if (s.pdf_area > 0.0)
            s.pdf_area = tree_pdf_area(s.v.surface.shape, path.triangle, s.v.front, path.lit_from, path.lit_normal);
#endif
#ifdef LAMP_RECTANGLES
        SeenRectangle lamp = seen_lamp(path.triangle, s.v.front, path.lit_from);
        s.pdf_area = lamp_pdf_area(lamp, s.pdf_area, path.direction, path.reached);
#endif
        float share = emission_share(path.pdf, s.pdf_area, path.reached, dot(s.v.plane.xyz, path.direction));
#ifdef CONTROL_VARIATE
        share *= path.emission;
#endif
        add_light(path, path.beta * Le * (path.at.depth == 0 ? seen : share));
    }
    // The start is offset from the surface by more than the rounding error. A ray from a nearer start would hit
    // triangles next to its own.
    vec3 far = abs(s.v.surface.position);
    s.rounding = RAY_ROUNDING * ((at_start(path.at) ? start_extent : s.t) + max(far.x, max(far.y, far.z)));
    s.start = s.v.surface.position + s.rounding * s.v.normal;
    return s;
}

#ifdef GATHER
// If the solution is looked up at this vertex, adds the light that it gives, and reduces `reflected`, the weight of
// light samples, by the direct light that it includes. Sets `path.continues`: true if the path continues from the
// diffuse lobe instead.
void look_up(inout RayPath path, ScatterVertex s, LatticePosition in_lattice, inout vec3 reflected)
{
#ifdef HAS_LOBES
    bool mirrored = path.at.depth > 0 && !path.was_diffuse;
    int bounces = path.bounces;
    path.continues = bounces < lookup_depth;
#else
    const bool mirrored = false;
    int bounces = path.at.depth;
#endif
    if (bounces < lookup_depth) return;
    path.continues = !mirrored
        && s.t < lookup_distance * random_at(path.at, USE_LOOKUP) * min_lookup_distance(in_lattice, s.v.front);
    if (path.continues) {
        path.vertices = path.at.depth + 2;
    } else {
        vec4 found = irradiance_at(in_lattice, s.v.front);
        path.L += path.beta * diffuse_reflectance(s.v.bsdf, dot(s.v.n, s.v.wo)) * found.rgb / PI;
        reflected *= 1.0 - found.a;
#ifdef HAS_DIFFUSE_TRANSMISSION
        vec4 behind = irradiance_at(in_lattice, !s.v.front);
        path.L += path.beta * diffuse_transmittance(s.v.bsdf, dot(s.v.n, s.v.wo)) * behind.rgb / PI;
        reflected_behind *= 1.0 - behind.a;
#endif
    }
}
#endif

#ifdef CONTROL_VARIATE
// From a path's third diffuse vertex on, the path continues with a probability p; otherwise the solution replaces
// its rest. If it continues, its weight is 1 / p, and (1 - 1 / p) times the solution is added. The expected value
// is the path's light whatever the solution is, so the solution is a control variate. p depends on the throughput,
// so that it ends paths like roulette. Source: Vorba & Krivanek 2016, Adjoint-driven Russian roulette and
// splitting, for roulette by expected light; Rousselle et al. 2016, Image-space control variates for rendering.
void correct(inout RayPath path, ScatterVertex s, LatticePosition in_lattice, inout vec3 reflected)
{
    path.weight = path.emission_weight = 1.0;
    path.continues = true;
#ifdef HAS_LOBES
    int bounces = path.bounces;
#else
    int bounces = path.at.depth;
#endif
    if (bounces < lookup_depth) return;
    float chance, number;
    if (path.corrections == 0) {
        // The path continues in exactly one of two successive path sets (2k and 2k + 1), because their
        // correction_numbers differ by 1/2.
        chance = FIRST_CHANCE;
        number = fract(correction_number + unit(pcg(path.at.path + pcg(path_seed + 8191u + uint(path.at.branch)))));
    } else {
        chance = min(1.0, LATER_CHANCE * max(path.beta.r, max(path.beta.g, path.beta.b)));
        number = random_at(path.at, USE_LOOKUP);
    }
    path.continues = number < chance;
    vec4 found = irradiance_at(in_lattice, s.v.front);
    vec3 solution = path.beta * diffuse_reflectance(s.v.bsdf, dot(s.v.n, s.v.wo)) * found.rgb / PI;
#ifdef HAS_DIFFUSE_TRANSMISSION
    // The solution's fraction of direct light, found.a, is the same on both sides of the surface.
    solution += path.beta * diffuse_transmittance(s.v.bsdf, dot(s.v.n, s.v.wo)) * irradiance_at(in_lattice, !s.v.front).rgb / PI;
#endif
    if (path.continues) {
        path.weight = 1.0 / chance;
        // The part of direct light that the solution includes gets the path's weight, the rest gets the weight 1.
        float direct = 1.0 + (path.weight - 1.0) * found.a;
        path.L += (1.0 - path.weight) * solution;
        path.emission_weight = direct / path.weight;
        reflected *= direct;
#ifdef HAS_DIFFUSE_TRANSMISSION
        reflected_behind *= direct;
#endif
        path.corrections += 1;
    } else {
        path.L += solution;
        reflected *= 1.0 - found.a;
#ifdef HAS_DIFFUSE_TRANSMISSION
        reflected_behind *= 1.0 - found.a;
#endif
    }
}
#endif

#ifdef HAS_LOBES
// Adds light of light samples, scattered by all lobes. Sets s.lobes, the lobes by which the path may continue, and
// path.continues.
void add_direct_light(inout RayPath path, inout ScatterVertex s, vec3 reflected)
{
#if defined(GATHER) || defined(CONTROL_VARIATE)
    const bool beyond = false;
    bool others_continue = path.at.depth < MIRRORS;
#else
    // Mirrors and glass do not reflect light samples. At the last vertex, one more ray therefore finds the emitters
    // that they show.
    bool beyond = path.at.depth >= path.vertices, others_continue = !beyond;
#endif
    LightSample light_sample;
    DirectLight direct = direct_light(path.at, s.v.surface.position, s.v.normal, 0, light_sample);
    if (beyond || (!path.continues && ambient_instead(light_sample.kind))) direct.light = vec3(0.0);
    s.lobes = lobes_of(s.v, path.continues, others_continue);
    vec3 diffuse, others;
    light_lobes(s.v, s.lobes, direct, diffuse, others);
    vec3 lit = reflected * diffuse + path.beta * others;
    bool ends = !path.continues && !beyond;
#if defined(HAS_ROUGH_TRANSMISSION) || defined(HAS_DIFFUSE_TRANSMISSION)
    bool lit_from_behind = false;
#ifdef HAS_ROUGH_TRANSMISSION
    lit_from_behind = is_rough_transmission(s.v.bsdf);
#endif
#ifdef HAS_DIFFUSE_TRANSMISSION
    lit_from_behind = lit_from_behind || s.v.bsdf.diffuse_through != vec3(0.0);
#endif
    if (lit_from_behind && !beyond) {
        LightSample other;
        DirectLight behind = direct_light(path.at, s.v.surface.position, -s.v.normal, 0, other);
        vec3 through = vec3(0.0);
#ifdef HAS_ROUGH_TRANSMISSION
        through = path.beta * light_through(s.v, s.lobes, behind);
#endif
#ifdef HAS_DIFFUSE_TRANSMISSION
        through += reflected_behind * light_through_diffuse(s.v, s.lobes, behind);
#endif
        vec3 start = s.v.surface.position - s.rounding * s.v.normal;
        add_unblocked(path.L, through, path.at, behind, other, start, s.rounding, path.triangle);
    }
#endif
    path.continues = s.lobes.diffuse + s.lobes.microfacets + s.lobes.coat + s.lobes.mirror > 0.0;
#ifdef HAS_DIFFUSE_TRANSMISSION
    path.continues = path.continues || s.lobes.through > 0.0;
#endif
    add_unblocked(path.L, lit, path.at, direct, light_sample, s.start, s.rounding, path.triangle);
    if (ends) path.L += path.beta * bsdf_albedo(s.v.bsdf) * ambient;
}
#else
// Adds light of light samples at a diffuse surface.
void add_direct_light(inout RayPath path, inout ScatterVertex s, vec3 reflected)
{
    LightSample light_sample;
    DirectLight direct = direct_light(path.at, s.v.surface.position, s.v.normal, path.continues ? 2 : 0, light_sample);
    if (!path.continues && ambient_instead(light_sample.kind)) direct.light = vec3(0.0);
    vec3 lit = reflected * bsdf_eval(s.v.bsdf, s.v.n, s.v.wo, direct.wi) * direct.light
             * shading_cosine(s.v.n, s.v.normal, s.v.vertex_cosine, direct.wi);
    add_unblocked(path.L, lit, path.at, direct, light_sample, s.start, s.rounding, path.triangle);
    if (!path.continues) path.L += path.beta * bsdf_albedo(s.v.bsdf) * ambient;
}
#endif

// Adds all light of a vertex except its emission.
void add_reflected(inout RayPath path, inout ScatterVertex s)
{
    vec3 reflected = path.beta;  // weight of light samples
#ifdef HAS_DIFFUSE_TRANSMISSION
    reflected_behind = path.beta;
#endif
    path.continues = path.at.depth < path.vertices - 1;
#if defined(GATHER) || defined(GUIDED)
    LatticePosition in_lattice = lattice_position(at_start(path.at) ? max(path.triangle, 0) : path.triangle, s.v.surface.position);
#endif
#ifdef GATHER
    look_up(path, s, in_lattice, reflected);
#endif
#ifdef CONTROL_VARIATE
    correct(path, s, in_lattice, reflected);
#endif
    add_direct_light(path, s, reflected);
#ifdef GUIDED
    s.guide = s.v.front && path.triangle >= 0 ? guide_at(in_lattice) : -1;
#endif
}

#ifdef HAS_LOBES
// Samples a direction of the microfacets, clearcoat, a mirror or glass. chosen: random number that chose the lobe,
// minus the probability of the diffuse lobes. Returns 1 instead of the cosine, because the caller only tests
// whether it is positive.
float sample_others(inout RayPath path, ScatterVertex s, float chosen, vec2 numbers)
{
    bool stays = chosen < s.lobes.microfacets + s.lobes.coat + s.lobes.mirror;
    BsdfSample leaving = bsdf_sample(s.v, s.lobes, chosen, numbers);
    path.direction = leaving.direction;
    path.beta *= stays ? leaving.weight : vec3(0.0);
#ifdef HAS_THIN_DIELECTRICS
    // Shadow rays pass through thin dielectrics. Emission behind a thin dielectric is therefore weighted against
    // the light samples of the vertex before it, and the thin dielectric is no vertex of the path.
    if (leaving.straight) {
        path.passed = path.reached;
        path.vertices += 1;
        if (path.at.depth == 0) path.pdf = DELTA_LOBE;
#ifdef SPLIT_LIGHT
        scattered -= 1;
#endif
    } else
#endif
    {
        path.pdf = leaving.pdf;
        path.was_diffuse = false;
#ifdef CONTROL_VARIATE
        path.emission = 1.0;  // set only here, because a thin dielectric keeps the factor of the previous vertex
#endif
#if defined(HAS_BACKGROUND) && defined(HAS_THIN_DIELECTRICS)
        path.straight = false;
#endif
        path.passed = 0.0;
#ifdef LIT_FROM
        path.lit_from = s.v.surface.position;
        path.lit_normal = leaving.through ? -s.v.normal : s.v.normal;
#endif
    }
#ifdef HAS_GLASS
    if (leaving.through) {
        path.origin = 2.0 * s.v.surface.position - s.start;
        if (s.v.bsdf.eta > 0.0)
            path.inside = s.v.front ? material_texel(s.v.surface.material, MATERIAL_INSIDE).rgb : vec3(0.0);
    }
#endif
    return 1.0;
}
#endif

// Samples the diffuse lobe, cosine-weighted or guided; chance: probability that this lobe was chosen. Returns the
// cosine.
float sample_diffuse(inout RayPath path, ScatterVertex s, float chance, vec2 numbers)
{
#ifdef LIT_FROM
    path.lit_from = s.v.surface.position;
    path.lit_normal = s.v.normal;
#endif
#ifdef HAS_LOBES
    path.bounces += 1;
    path.was_diffuse = true;
    path.passed = 0.0;
#if defined(HAS_BACKGROUND) && defined(HAS_THIN_DIELECTRICS)
    path.straight = false;
#endif
#endif
#ifdef GUIDED
    // MIS weights of light samples and emission ignore guiding. This adds no bias, because they still add up to
    // one.
    if (s.guide >= 0) {
        float chosen;
        numbers = guided(s.guide, numbers, chosen);
        path.beta /= chosen;
        path.guiding_weight /= chosen;
    }
#endif
    path.direction = cosine_direction(s.v.normal, numbers);
    float cosine = dot(s.v.normal, path.direction);
    path.beta *= diffuse_eval(s.v.bsdf, s.v.n, s.v.wo, path.direction)
               * (shading_cosine(s.v.n, s.v.normal, s.v.vertex_cosine, path.direction) / chance);
    path.pdf = chance * cosine / PI;
#ifdef CONTROL_VARIATE
    path.beta *= path.weight;
    path.emission = path.emission_weight;
#endif
    return cosine;
}

#ifdef HAS_DIFFUSE_TRANSMISSION
// Samples a cosine-weighted direction behind the surface; returns its cosine with the reversed normal.
float sample_through_diffuse(inout RayPath path, ScatterVertex s, vec2 numbers)
{
#ifdef LIT_FROM
    path.lit_from = s.v.surface.position;
    path.lit_normal = -s.v.normal;
#endif
    path.bounces += 1;
    path.was_diffuse = true;
    path.passed = 0.0;
#if defined(HAS_BACKGROUND) && defined(HAS_THIN_DIELECTRICS)
    path.straight = false;
#endif
    path.origin = 2.0 * s.v.surface.position - s.start;
    path.direction = cosine_direction(-s.v.normal, numbers);
    float cosine = -dot(s.v.normal, path.direction);
    path.beta *= diffuse_transmittance(s.v.bsdf, dot(s.v.n, s.v.wo))
               * (shading_cosine(-s.v.n, -s.v.normal, s.v.vertex_cosine, path.direction) / s.lobes.through);
    path.pdf = s.lobes.through * cosine / PI;
#ifdef CONTROL_VARIATE
    path.beta *= path.weight;
    path.emission = path.emission_weight;
#endif
    return cosine;
}
#endif

// Samples the direction to the next vertex, and applies roulette.
void leave(inout RayPath path, ScatterVertex s)
{
    vec2 numbers = direction_numbers(path.at);
    path.origin = s.start;
#ifdef HAS_LOBES
    float chosen = random_at(path.at, USE_LOBE) - s.lobes.diffuse;
    float cosine;
#ifdef HAS_DIFFUSE_TRANSMISSION
    if (chosen >= 0.0 && chosen < s.lobes.through) {
        cosine = sample_through_diffuse(path, s, numbers);
    } else {
        if (chosen >= 0.0) chosen -= s.lobes.through;
        cosine = chosen < 0.0 ? sample_diffuse(path, s, s.lobes.diffuse, numbers) : sample_others(path, s, chosen, numbers);
    }
#else
    cosine = chosen < 0.0 ? sample_diffuse(path, s, s.lobes.diffuse, numbers) : sample_others(path, s, chosen, numbers);
#endif
#else
    float cosine = sample_diffuse(path, s, 1.0, numbers);
#endif
    float max_beta = max(path.beta.r, max(path.beta.g, path.beta.b));
    if (path.at.depth + 1 >= roulette_depth) {
#ifdef GUIDED
        // Roulette ignores the guiding weight, which is small for every path that is guided to a light.
        float stay = min(1.0, max_beta / path.guiding_weight);
#else
        float stay = min(1.0, max_beta);
#endif
        path.continues = random_at(path.at, USE_ROULETTE) < stay;
        path.beta /= stay;
    }
    path.continues = path.continues && max_beta > 0.0 && cosine > 0.0;
    path.at.depth += 1;
#ifdef SPLIT_LIGHT
    scattered += 1;
#endif
}

// Casts the path's ray to its next hit.
void cast_ray(inout RayPath path, int from)
{
    path.rays += 1.0;
#ifdef HAS_ALPHA
    opacity_key_at(path.at, USE_OPACITY);
#endif
    path.triangle = nearest_triangle(path.origin, path.direction, from);
}

// Traces the path of a fragment, with branches that split at the first vertex. Returns its radiance; a: number of
// rays cast, and a bit for a cut path.
vec4 trace_path(ivec2 fragment)
{
    ivec2 pixel = pixel_of_fragment(fragment, window_size);
#ifdef START_POINTS
    if (texel(start_positions, pixel).w == 0.0) return vec4(0.0);
#endif
    RayPath path = begin_path(pixel);
    float seen = 1.0;  // weight of light that the eye sees directly, 0 if lamps_seen adds it
#ifdef EMITTER_SILHOUETTES
    seen = lamps_seen(pixel, path.L) ? 0.0 : 1.0;
#ifdef SPLIT_LIGHT
    direct_part = path.L;
#endif
#endif
    ScatterVertex s;
#if BRANCHES > 1
    ScatterVertex first;
#endif
    for (;;)
    {
        bool arrives = path.continues;
        path.continues = false;
#ifdef HAS_BACKGROUND
        bool sees_background = is_from_eye(path);
        if (arrives && path.triangle < 0 && !at_start(path.at) && sees_background) add_background(path, pixel, seen);
#else
        const bool sees_background = false;
#endif
#ifdef HAS_SKY
        if (arrives && path.triangle < 0 && !at_start(path.at) && !sees_background) add_sky(path, seen);
#endif
        if (arrives && (path.triangle >= 0 || at_start(path.at))) {
            s = arrive(path, pixel, seen);
            add_reflected(path, s);
        }
#if BRANCHES > 1
        if (path.continues && path.at.depth == 0) {
            first = s;
            path.beta = vec3(1.0 / float(BRANCHES));
        } else if (!path.continues && path.at.depth > 0 && path.at.branch < BRANCHES - 1) {
            s = first;
            path.beta = vec3(1.0 / float(BRANCHES));
            begin_branch(path, path.at.branch + 1);
            path.continues = true;
        }
#endif
        if (!path.continues) break;
        leave(path, s);
        if (path.continues) cast_ray(path, s.v.triangle);
#if BRANCHES == 1
        if (!path.continues) break;
#endif
    }
    // The number of casts is clamped to CAST_BITS bits. The next bit marks a path that was cut.
    float cut = path.at.depth >= cut_depth ? float(1 << CAST_BITS) : 0.0;
    return vec4(path.L, min(path.rays, float((1 << CAST_BITS) - 1)) + cut);
}
