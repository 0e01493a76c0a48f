// path_rays.glsl: whole paths, each with directions and a light of its own: rays are cast by the BVH.
// Needs:  BRANCHES of a path, which part at its first vertex; BOUNCES, LIGHTS: as many directions come from the sequence
//         for each, and light samples has a set; PARTS: of the lights, see direct_light; EMITTER_SILHOUETTES;
//         GATHER, GUIDED; START_POINTS: paths start at points, not at an eye; OWN_LIGHT_SAMPLES: paths draw light samples
//         of their own; those of light_sample.glsl
// Frame:  world. Units: radiance W sr^-1 m^-2, linear Rec. 709.
//
// The set has a point of a sequence for each bounce; a path shifts it by numbers of its own, the same in every set, so
// that the points of each pixel are as even as the sequence, and those of two pixels have nothing in common.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "camera/camera.glsl"
#include "sampling/random.glsl"
#include "lights/light_sample.glsl"
#include "path/path_vertex.glsl"
#include "path/lanes.glsl"
#ifdef START_POINTS
#define START_VERTEX
#include "camera/start_points.glsl"
#define AT_START (at.depth == 0)
#else
#define AT_START false
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
int scattered = 0;  // surfaces that the path has left, thin dielectrics that it went straight through aside
#endif
#ifdef GATHER
uniform int lookup_depth;       // number of the vertex where the solution is looked up
uniform float lookup_distance;  // in widths of an element; nearer than a random share of it, a path continues
const int FURTHER = 2;          // vertices at most: in a corner, two coarse elements look at each other
const int MIRRORS = 1024;       // vertices of a path through glass and by mirrors at most: roulette ends them long before
#endif

UINT_TEXELS(r32ui, eye_buffer);
uniform ivec2 window_size;
uniform int max_depth;               // vertices of a path
uniform int cut_depth;               // number of the vertex where a path that chance should have ended is cut and counted
uniform int roulette_depth;          // from this vertex on, Russian roulette ends paths (Arvo & Kirk 1990)
uniform uint path_seed;              // of a path's own shifts
uniform uvec2 direction_points[BRANCHES * BOUNCES];
uniform uint choice_points[BRANCHES * BOUNCES];
uniform bool lattice;                // the first direction is a point of a lattice, the others of a Sobol sequence
#ifdef OWN_LIGHT_SAMPLES
#include "lights/light_draw.glsl"
uniform uvec3 sequence_point;           // a point of the sequence
#else
uniform vec4 light_table[LIGHT_ROWS * LIGHTS];
#endif

float unit(uint bits)
{
    return float(bits >> 8u) * (1.0 / 16777216.0);
}

// Where on its branches a path is.
struct PathId
{
    uint path;
    int depth;   // number of the vertex
    int branch;
};

// Another number at each vertex of each branch, for the uses of random.glsl, 0 and 1.
float random_at(PathId at, uint use)
{
    return random_number(at.path, 8u * uint(BRANCHES * at.depth + at.branch + 1) + use);
}

#ifdef HAS_ALPHA
void opacity_key_at(PathId at, uint use)
{
    opacity_key = pcg(at.path + pcg(random_seed + 8u * uint(BRANCHES * at.depth + at.branch + 1) + use));
}
#endif

// Which part of the lights a vertex takes.
float choice_number(PathId at)
{
    if (at.depth >= BOUNCES) return random_at(at, USE_LIGHT);
    uint point = choice_points[BOUNCES * at.branch + at.depth];
    return unit(point ^ pcg(at.path + pcg(path_seed + 2u * uint(at.depth) + 1u)));
}

// A lattice's shift is a sum, a net's an exclusive or.
vec2 direction_numbers(PathId at)
{
    if (at.depth >= BOUNCES) return vec2(random_at(at, 0u), random_at(at, 1u));
    uvec2 point = direction_points[BOUNCES * at.branch + at.depth];
    uint first = pcg(path_seed + 2u * uint(at.depth));
    uvec2 shift = uvec2(pcg(at.path + first), pcg(at.path + pcg(first)));
    uvec2 own = lattice && at.depth == 0 ? point + shift : point ^ shift;
    return vec2(unit(own.x), unit(own.y));
}

#ifdef OWN_LIGHT_SAMPLES
// Shifted for each vertex of each branch, and for each part of the lights.
LightSample light_of(PathId at, int part, out float share)
{
    uint first = pcg(path_seed + 4096u + uint(BRANCHES * at.depth + at.branch)), second = pcg(first);
    uvec3 shift = uvec3(pcg(at.path + first), pcg(at.path + second), pcg(at.path + pcg(second)));
    return light_draw(part, sequence_point ^ shift ^ (0x9E3779B9u * uint(part)), share);
}
#else
LightSample light_in(int number, out float share)
{
    int row = LIGHT_ROWS * number;
    vec4 a = light_table[row], b = light_table[row + 1], c = light_table[row + 2], d = light_table[row + 3];
    share = d.z;
#ifdef HAS_PROFILES
    return LightSample(a.xyz, b.xyz, c.xyz, b.w, uint(a.w), d.xy, c.w != 0.0, int(d.w));
#else
    return LightSample(a.xyz, b.xyz, c.xyz, b.w, uint(a.w), d.xy, c.w != 0.0);
#endif
}

// The set's light samples are few: paths share them by classes, and a path takes those of another class at each vertex.
LightSample light_of(PathId at, int part, out float share)
{
    uint other = 5u * uint(at.depth + at.branch);
    int first = PARTS * int((pcg(at.path + path_seed) + other) % uint(LIGHTS / PARTS));
    return light_in(first + part, share);
}
#endif

// Direct light, shadows not asked for; views: see mis_weight_light.
// There is a sample of each part of the lights; a path takes one by what they send [Talbot 2005].
DirectLight direct_light(PathId at, vec3 position, vec3 normal, int views, out LightSample light_sample)
{
    int selected = 0;
    float scale = 1.0, share;
#if PARTS > 1
    float weights[PARTS], sum = 0.0;
    for (int k = 0; k < PARTS; ++k)
    {
        LightSample one = light_of(at, k, share);
        vec3 light = light_from(one, position, normal, views).light;
        weights[k] = share * (light.r + light.g + light.b);
        sum += weights[k];
    }
    float number = choice_number(at) * sum, upto = 0.0, weight = 0.0;
    for (int k = 0; k < PARTS; ++k)
    {
        bool beyond = weights[k] > 0.0 && upto <= number;
        selected = beyond ? k : selected;
        weight = beyond ? weights[k] : weight;
        upto += weights[k];
    }
    scale = weight > 0.0 ? sum / weight : 0.0;
#endif
    light_sample = light_of(at, selected, share);
    DirectLight direct = light_from(light_sample, position, normal, views);
    direct.light *= scale * share;
    return direct;
}

// What an unoccluded light sample would bring. start: off the surface by `rounding`, of a triangle.
void add_unblocked(
    inout vec3 L, vec3 lit, PathId at, DirectLight direct, LightSample light_sample, vec3 start, float rounding, int triangle)
{
    if (max(lit.r, max(lit.g, lit.b)) > 0.0) {
        // To just before the light, so that its own triangle does not occlude it.
        vec3 to_light = direct.distant ? direct.wi : light_sample.position - start;
        float tmax = direct.distant ? NO_HIT : 1.0 - ROUNDING - rounding / direct.distance;
#ifdef HAS_ALPHA
        opacity_key_at(at, USE_SHADOW_OPACITY);
#endif
        if (!is_blocked(start, to_light, tmax, triangle)) {
#ifdef HAS_THIN_DIELECTRICS
            lit *= passed_thin_dielectrics;
#endif
            L += lit;
#ifdef SPLIT_LIGHT
            if (scattered == 0) direct_part += lit;
#endif
        }
    }
}

// A vertex that a path leaves.
struct ScatterVertex
{
    PathVertex v;
    vec3 start;  // off the surface
    int guide;   // its number
#ifdef HAS_LOBES
    Lobes lobes;
#endif
};

// Radiance of the path that a fragment traces, and the rays that it cast. Its branches part at the first vertex.
vec4 trace_path(ivec2 fragment)
{
    ivec2 pixel = pixel_of_fragment(fragment, window_size);
    PathId at = PathId(shared_path(pixel), 0, 0);
#ifdef START_POINTS
    vec3 origin = vec3(0.0), direction = vec3(0.0);
    if (texel(start_positions, pixel).w == 0.0) return vec4(0.0);
#else
    vec3 origin = eye_origin(pixel), direction = eye_direction(pixel);
#endif
    int triangle = int(texel(eye_buffer, pixel).r) - 1;
    vec3 L = vec3(0.0), beta = vec3(1.0);
#ifdef EMITTER_SILHOUETTES
    float seen = lamps_seen(pixel, L) ? 0.0 : 1.0;  // the path's share of the light that the eye sees
#ifdef SPLIT_LIGHT
    direct_part = L;
#endif
#else
    const float seen = 1.0;
#endif
#ifdef HAS_LOBES
    int bounces = 0;          // off a diffuse surface: where a gather looks up, mirrors and glass do not count
    bool was_diffuse = false;    // the last one
    vec3 inside = vec3(0.0);  // attenuation of what the path goes through
#endif
    float passed = 0.0, reached = 0.0;  // of the ray: up to the last thin dielectric that it went through, and in all
    float pdf = 0.0;  // of the direction, per solid angle
    float rays = 0.0;
    int vertices = max_depth;
    bool continues = true;
#ifdef GUIDED
    float guiding_weight = 1.0;  // what the path weighs more for where guides sent it
#endif
    ScatterVertex from;
#if BRANCHES > 1
    ScatterVertex first;
#endif
    for (;;)
    {
        // What is at the end of the ray.
        bool arrived = continues;
        continues = false;
#ifdef HAS_SKY
        if (arrived && triangle < 0 && !AT_START) {
            // Shared with the light sample of the vertex before, as emission is.
            float share = at.depth == 0 ? seen : power_heuristic(pdf, sky_pdf(direction));
            L += beta * sky(direction) * share;
#ifdef SPLIT_LIGHT
            if (scattered <= 1) direct_part += beta * sky(direction) * share;
#endif
        }
#endif
        if (arrived && (triangle >= 0 || AT_START)) {
            float t, pdf_area;
#ifdef START_POINTS
            PathVertex v;
            if (AT_START) {
                v = start_vertex(pixel, triangle);
                triangle = v.triangle;
                t = 0.0;
            } else {
                v = vertex_on(triangle, origin, direction, t);
            }
#else
            PathVertex v = vertex_on(triangle, origin, direction, t);
#endif
            vec3 position = v.surface.position;
            bool front = v.front;
            reached = passed + t;
#ifdef HAS_GLASS
            beta *= exp(-inside * t);
#endif

            vec3 Le = vec3(0.0);
            if (!AT_START) Le = emitted(v.surface, front, pdf_area);
            L += beta * Le * (at.depth == 0 ? seen : emission_share(pdf, pdf_area, reached, dot(v.plane.xyz, direction)));
#ifdef SPLIT_LIGHT
            if (scattered <= 1)
                direct_part += beta * Le
                    * (at.depth == 0 ? seen : emission_share(pdf, pdf_area, reached, dot(v.plane.xyz, direction)));
#endif

            vec3 reflected = beta;  // of direct light
            continues = at.depth < vertices - 1;
#if defined(GATHER) || defined(GUIDED)
            LatticePosition in_lattice = lattice_position(AT_START ? max(triangle, 0) : triangle, position);
#endif
#ifdef GATHER
#ifdef HAS_LOBES
            bool mirrored = at.depth > 0 && !was_diffuse;
            continues = bounces < lookup_depth;
#else
            const bool mirrored = false;
            int bounces = at.depth;
#endif
            if (bounces >= lookup_depth) {
                continues = bounces < lookup_depth + FURTHER && !mirrored
                    && t < lookup_distance * random_at(at, USE_LOOKUP) * in_lattice.width;
                if (continues) {
                    vertices = at.depth + 2;
                } else {
                    vec4 found = irradiance_at(in_lattice, front);
                    L += beta * diffuse_reflectance(v.bsdf, dot(v.n, v.wo)) * found.rgb / PI;
                    reflected *= 1.0 - found.a;
                }
            }
#endif
            // Off the surface by more than rounding, or its other triangles would be hit.
            vec3 far = abs(position);
            float rounding = RAY_ROUNDING * ((AT_START ? start_extent : t) + max(far.x, max(far.y, far.z)));
            vec3 start = position + rounding * v.normal;
            LightSample light_sample;
#ifdef HAS_LOBES
#ifdef GATHER
            const bool beyond = false;
            bool others_continue = at.depth < MIRRORS;
#else
            // Of the last vertex's mirrors and glass, light samples know nothing: one ray more finds what shines there.
            bool beyond = at.depth >= vertices, others_continue = !beyond;
#endif
            DirectLight direct = direct_light(at, position, v.normal, 0, light_sample);
            if (beyond || (!continues && ambient_instead(light_sample.kind))) direct.light = vec3(0.0);
            Lobes lobes = lobes_of(v, continues, others_continue);
            vec3 diffuse, others;
            light_lobes(v, lobes, direct, diffuse, others);
            vec3 lit = reflected * diffuse + beta * others;
            bool ends = !continues && !beyond;
#ifdef HAS_GLASS
            if (is_rough_transmission(v.bsdf) && !beyond) {
                LightSample other;
                DirectLight behind = direct_light(at, position, -v.normal, 0, other);
                vec3 through = beta * light_through(v, lobes, behind);
                add_unblocked(L, through, at, behind, other, position - rounding * v.normal, rounding, triangle);
            }
#endif
            continues = lobes.diffuse + lobes.microfacets + lobes.coat + lobes.mirror > 0.0;
#else
            DirectLight direct = direct_light(at, position, v.normal, continues ? 2 : 0, light_sample);
            if (!continues && ambient_instead(light_sample.kind)) direct.light = vec3(0.0);
            vec3 lit = reflected * bsdf_eval(v.bsdf, v.n, v.wo, direct.wi) * direct.light
                     * shading_cosine(v.n, v.normal, direct.wi);
            bool ends = !continues;
#endif
            add_unblocked(L, lit, at, direct, light_sample, start, rounding, triangle);
            if (ends) L += beta * bsdf_albedo(v.bsdf) * ambient;
            from.v = v;
            from.start = start;
#ifdef HAS_LOBES
            from.lobes = lobes;
#endif
#ifdef GUIDED
            from.guide = front && triangle >= 0 ? guide_at(in_lattice) : -1;
#endif
        }
#if BRANCHES > 1
        if (continues && at.depth == 0) {
            first = from;
            beta = vec3(1.0 / float(BRANCHES));
        } else if (!continues && at.depth > 0 && at.branch < BRANCHES - 1) {
            from = first;
            beta = vec3(1.0 / float(BRANCHES));
            at = PathId(at.path, 0, at.branch + 1);
            vertices = max_depth;
            continues = true;
#ifdef GUIDED
            guiding_weight = 1.0;
#endif
#ifdef HAS_LOBES
            bounces = 0;
            was_diffuse = false;
            passed = 0.0;
            inside = vec3(0.0);
#endif
#ifdef SPLIT_LIGHT
            scattered = 0;
#endif
        }
#endif
        if (!continues) break;
        vec2 numbers = direction_numbers(at);
        PathVertex v = from.v;
        origin = from.start;
        float chance = 1.0, cosine;
#ifdef HAS_LOBES
        float chosen = random_at(at, USE_LOBE) - from.lobes.diffuse;
        bool by_diffuse = chosen < 0.0;
        if (!by_diffuse) {
            bool stays = chosen < from.lobes.microfacets + from.lobes.coat + from.lobes.mirror;
            BsdfSample leaving = bsdf_sample(v, from.lobes, chosen, numbers);
            direction = leaving.direction;
            beta *= stays ? leaving.weight : vec3(0.0);
#ifdef HAS_THIN_DIELECTRICS
            // To its light samples a vertex sees through thin dielectrics: what it finds behind them is shared with these,
            // and the thin dielectric is no vertex of the path.
            if (leaving.straight) {
                passed = reached;
                vertices += 1;
                if (at.depth == 0) pdf = DELTA_LOBE;
#ifdef SPLIT_LIGHT
                scattered -= 1;
#endif
            } else
#endif
            {
                pdf = leaving.pdf;
                was_diffuse = false;
                passed = 0.0;
            }
            cosine = 1.0;
#ifdef HAS_GLASS
            if (leaving.through) {
                origin = 2.0 * v.surface.position - from.start;
                if (v.bsdf.eta > 0.0) inside = v.front ? material_texel(v.surface.material, MATERIAL_INSIDE).rgb : vec3(0.0);
            }
#endif
        } else
#endif
        {
#ifdef HAS_LOBES
            chance = from.lobes.diffuse;
            bounces += 1;
            was_diffuse = true;
            passed = 0.0;
#endif
#ifdef GUIDED
            // Light samples and emission share light by the cosine alone: any shares will do that make one.
            if (from.guide >= 0) {
                float chosen;
                numbers = guided(from.guide, numbers, chosen);
                beta /= chosen;
                guiding_weight /= chosen;
            }
#endif
            direction = cosine_direction(v.normal, numbers);
            cosine = dot(v.normal, direction);
            beta *= diffuse_eval(v.bsdf, v.n, v.wo, direction) * (shading_cosine(v.n, v.normal, direction) / chance);
            pdf = chance * cosine / PI;
        }
        float max_beta = max(beta.r, max(beta.g, beta.b));
        if (at.depth + 1 >= roulette_depth) {
#ifdef GUIDED
            // Without the guiding weight, which is small for every path that is guided to a light.
            float stay = min(1.0, max_beta / guiding_weight);
#else
            float stay = min(1.0, max_beta);
#endif
            continues = random_at(at, USE_ROULETTE) < stay;
            beta /= stay;
        }
        continues = continues && max_beta > 0.0 && cosine > 0.0;
        at.depth += 1;
#ifdef SPLIT_LIGHT
        scattered += 1;
#endif
        if (continues) {
            rays += 1.0;
#ifdef HAS_ALPHA
            opacity_key_at(at, USE_OPACITY);
#endif
            triangle = nearest_triangle(origin, direction, v.triangle);
        }
#if BRANCHES == 1
        if (!continues) break;
#endif
    }
    // More casts than their bits hold count as so many; what stands above them is a path that was cut.
    return vec4(L, min(rays, float((1 << CAST_BITS) - 1)) + (at.depth >= cut_depth ? float(1 << CAST_BITS) : 0.0));
}
