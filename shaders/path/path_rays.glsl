// path_rays.glsl: whole paths, each with its own directions and light samples; rays are cast by the BVH.
// Needs:  BRANCHES of a path, which split at its first vertex; EMITTER_SILHOUETTES; GATHER, GUIDED; START_POINTS: paths start
//         at points instead of an eye; the needs of path_numbers.glsl and path_direct.glsl
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
int scattered = 0;  // number of surfaces that the path has left, except thin dielectrics passed straight
#endif
#ifdef GATHER
uniform int lookup_depth;       // index of the vertex at which the solution is looked up
uniform float lookup_distance;  // maximum distance at which a path continues, in the element's minimum distances, before a random factor
#endif
#if defined(GATHER) || defined(CONTROL_VARIATE)
const int MIRRORS = 1024;       // maximum number of vertices of a path through glass and mirrors; roulette ends it long before
#endif

#ifdef CONTROL_VARIATE
uniform int lookup_depth;         // diffuse bounces before the first vertex at which the solution may replace the path
uniform float correction_number;  // radical inverse of the path set's index; decides which paths continue there
const float FIRST_CHANCE = 0.5;   // probability that a path continues at that vertex
const float LATER_CHANCE = 4.0;   // factor on the throughput for that probability at later vertices, at most 1
#endif

UINT_TEXELS(r32ui, eye_buffer);
uniform ivec2 window_size;
uniform int max_depth;               // maximum number of vertices of a path
uniform int cut_depth;               // index of the vertex at which a path that roulette has not ended is cut and counted
uniform int roulette_depth;          // vertex from which on Russian roulette ends paths (Arvo & Kirk 1990)
#ifdef HAS_GROUND
#include "lights/ground.glsl"
#endif
#include "path/path_numbers.glsl"
#include "path/path_direct.glsl"
#if defined(LIGHT_TREE) || defined(PORTALS) || defined(LAMP_RECTANGLES)
#define LIT_FROM
#endif

#ifdef HAS_DIFFUSE_TRANSMISSION
vec3 reflected_behind;  // weight of light samples on the other side of a vertex, for its diffuse lobe there
#endif

// State of a path between vertices.
struct RayPath
{
    PathId at;
    vec3 origin;      // start of the path's current ray
    vec3 direction;
    int triangle;     // triangle that this ray hits, -1 for none
    vec3 L;           // radiance accumulated so far
    vec3 beta;        // throughput
    float pdf;        // density of the ray's direction, per solid angle
    float reached;    // distance of the hit from the vertex of the last light samples; see `passed`
#ifdef LIT_FROM
    vec3 lit_from;    // position of that vertex
    vec3 lit_normal;  // normal of that vertex on the side of the ray
#endif
    float rays;       // number of rays cast so far
    int vertices;     // maximum number of vertices of this path
    bool continues;
#ifdef GUIDED
    float guiding_weight;  // factor of the path's weight due to guides
#endif
#ifdef CONTROL_VARIATE
    int corrections;        // number of vertices at which the path continued although the solution was looked up
    float weight;           // weight of light that leaves the vertex by the diffuse lobe
    float emission_weight;  // weight of the next vertex's emission for that lobe, because the solution may include direct light
    float emission;         // weight of emission for the current ray
#endif
#ifdef HAS_LOBES
    float passed;      // distance up to the last thin dielectric that the ray passed
    int bounces;       // number of diffuse bounces; mirrors and glass do not count for a gather
    bool was_diffuse;  // true if the last bounce was diffuse
#if defined(HAS_BACKGROUND) && defined(HAS_THIN_DIELECTRICS)
    bool straight;     // true if the path only passed thin dielectrics since the eye
#endif
    vec3 inside;       // attenuation of the medium that the path is in
#endif
};

// Vertex that a path has reached and will leave.
struct ScatterVertex
{
    PathVertex v;
    float t;         // distance from the previous vertex, or from the last thin dielectric
    float pdf_area;  // density of light samples at this point, if it is on a lamp
    vec3 start;      // start of rays from the vertex, off the surface
    float rounding;  // distance of `start` from the surface
    int guide;       // index of the vertex's guide
#ifdef HAS_LOBES
    Lobes lobes;
#endif
};

// Prepares the path for its first bounce, or for that of another branch.
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
// Returns true if its ray comes straight from the eye.
bool is_from_eye(RayPath path)
{
#ifdef HAS_THIN_DIELECTRICS
    return path.straight;
#else
    return path.at.depth == 0;
#endif
}

#ifdef HAS_GROUND
// Unoccluded fraction of the sky's light on the ground at the ray's hit; 1 without a hit. It is estimated with one direction,
// distributed by the sky's irradiance.
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
// Adds the sky for a ray that hits nothing, weighted against the light sample of the previous vertex, as emission is.
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

// Returns the vertex at the end of the ray, and adds the light that it emits. seen: weight of light that the eye sees directly.
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
    // The start is off the surface by more than rounding, because the ray would otherwise hit its neighbouring triangles.
    vec3 far = abs(s.v.surface.position);
    s.rounding = RAY_ROUNDING * ((at_start(path.at) ? start_extent : s.t) + max(far.x, max(far.y, far.z)));
    s.start = s.v.surface.position + s.rounding * s.v.normal;
    return s;
}

#ifdef GATHER
// At a vertex at which the solution is looked up, adds its light, and sets the weight `reflected` of light samples. Sets
// `continues`, if the path continues from the diffuse lobe as elsewhere.
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
// From a path's third diffuse vertex on, either the solution ends the path, or with probability p the path continues with
// weight 1 / p, plus (1 - 1 / p) times the solution. The expected value is the path's light for any solution, which is a
// control variate. p depends on the throughput, so that it ends paths like roulette. Source: Vorba & Krivanek 2016,
// Adjoint-driven Russian roulette and splitting, for roulette by expected light; Rousselle et al. 2016, Image-space control
// variates for rendering.
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
        // The path continues in one of two successive sets (2k and 2k + 1), because correction_number differs by 1/2.
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
    // The fraction of direct light is the same on both sides.
    solution += path.beta * diffuse_transmittance(s.v.bsdf, dot(s.v.n, s.v.wo)) * irradiance_at(in_lattice, !s.v.front).rgb / PI;
#endif
    if (path.continues) {
        path.weight = 1.0 / chance;
        // The solution's direct light gets the weight of the path, the rest the weight 1.
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
// Adds light of light samples by all lobes. Sets the lobes in which the path may continue, and if it continues.
void add_direct_light(inout RayPath path, inout ScatterVertex s, vec3 reflected)
{
#if defined(GATHER) || defined(CONTROL_VARIATE)
    const bool beyond = false;
    bool others_continue = path.at.depth < MIRRORS;
#else
    // Light samples do not contribute to mirrors and glass of the last vertex, so one more ray finds emitters there.
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
// Samples microfacets, clearcoat, a mirror or glass; chosen: random number minus the diffuse lobe's probability. Returns 1 instead of a cosine.
float sample_others(inout RayPath path, ScatterVertex s, float chosen, vec2 numbers)
{
    bool stays = chosen < s.lobes.microfacets + s.lobes.coat + s.lobes.mirror;
    BsdfSample leaving = bsdf_sample(s.v, s.lobes, chosen, numbers);
    path.direction = leaving.direction;
    path.beta *= stays ? leaving.weight : vec3(0.0);
#ifdef HAS_THIN_DIELECTRICS
    // Light samples of a vertex see through thin dielectrics. Light found behind them is weighted against these samples, and
    // the thin dielectric is not a vertex of the path.
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
        path.emission = 1.0;  // not after a thin dielectric, as the light still belongs to the previous vertex
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

// Samples the diffuse lobe, cosine-weighted or guided; chance: probability of the diffuse lobe. Returns the cosine.
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
    // The MIS weights of light samples and emission only use the cosine; any weights that add up to one are valid.
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
// Samples a cosine-weighted direction on the other side; returns the cosine.
float sample_through_diffuse(inout RayPath path, ScatterVertex s, vec2 numbers)
{
#ifdef LIGHT_TREE
    path.lit_from = s.v.surface.position;
    path.lit_normal = -s.v.normal;
#endif
    path.bounces += 1;
    path.was_diffuse = true;
    path.passed = 0.0;
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
        // The guiding weight is left out, because it is small for every path that is guided to a light.
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

// Returns radiance and number of cast rays of the path that a fragment traces. Its branches split at the first vertex.
vec4 trace_path(ivec2 fragment)
{
    ivec2 pixel = pixel_of_fragment(fragment, window_size);
#ifdef START_POINTS
    if (texel(start_positions, pixel).w == 0.0) return vec4(0.0);
#endif
    RayPath path = begin_path(pixel);
    float seen = 1.0;  // weight of light that the eye sees directly
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
