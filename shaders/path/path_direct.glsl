// path_direct.glsl: direct light at the vertices of paths with per-path rays, from light samples.
// Needs:  LIGHTS: number of light samples drawn for a path set; PARTS: number of parts into which the lights are
//         divided, see direct_light; OWN_LIGHT_SAMPLES: each path draws its own light samples; LIGHT_TREE: number
//         of samples that each vertex draws by a light tree (PARTS then divides only the lights outside the tree);
//         path_numbers.glsl, ray_bvh.glsl, and the needs of light_sample.glsl
// Units:  radiance W sr^-1 m^-2, linear Rec. 709.
#ifdef OWN_LIGHT_SAMPLES
#include "lights/light_draw.glsl"
#ifdef LIGHT_TREE
#include "lights/light_tree.glsl"
#endif
uniform uvec3 sequence_point;           // sequence point of the path set, see light_point()
#else
#include "gl/texels.glsl"
TEXELS(rgba32f, light_table);           // row: path set; in a row, LIGHTS light samples of LIGHT_ROWS texels each
uniform int light_row;                  // row of the path set in light_table
#endif

#ifdef OWN_LIGHT_SAMPLES
// Returns the path set's sequence point, shifted differently for each path, branch and vertex.
uvec3 light_point(PathId at)
{
    uint first = pcg(path_seed + 4096u + uint(BRANCHES * at.depth + at.branch)), second = pcg(first);
    return sequence_point ^ uvec3(pcg(at.path + first), pcg(at.path + second), pcg(at.path + pcg(second)));
}

#ifdef PARTS
// Draws a light sample of one part of the lights, as seen from a position; share: probability of this part. The
// sequence point is shifted for each part, too.
LightSample light_of(PathId at, int part, vec3 from, out float share)
{
    return light_draw(part, light_point(at) ^ (0x9E3779B9u * uint(part)), from, share);
}
#endif
#else
LightSample light_in(int number, out float share)
{
    ivec2 at = ivec2(LIGHT_ROWS * number, light_row);
    vec4 a = texel(light_table, at), b = texel(light_table, at + ivec2(1, 0));
    vec4 c = texel(light_table, at + ivec2(2, 0)), d = texel(light_table, at + ivec2(3, 0));
    share = d.z;
#ifdef HAS_PROFILES
    return LightSample(a.xyz, b.xyz, c.xyz, b.w, uint(a.w), d.xy, c.w != 0.0, int(d.w));
#else
    return LightSample(a.xyz, b.xyz, c.xyz, b.w, uint(a.w), d.xy, c.w != 0.0);
#endif
}

// Returns the path's light sample of one part of the lights; share: probability of this part. A path set has only
// LIGHTS light samples. So paths are hashed into classes, and each class shares one sample of each part. At each
// vertex, a path uses the samples of another class.
LightSample light_of(PathId at, int part, vec3 from, out float share)
{
    uint other = 5u * uint(at.depth + at.branch);
    int first = PARTS * int((pcg(at.path + path_seed) + other) % uint(LIGHTS / PARTS));
    return light_in(first + part, share);
}
#endif

#ifdef LIGHT_TREE
// Reservoir sampling: returns true if this sample replaces the one chosen so far. After all samples, each is the
// chosen one with a probability proportional to its weight.
// sum: sum of the weights so far. number: uniform in [0, 1); rescaled on return, so that it is uniform again.
bool is_taken(float weight, inout float sum, inout float number)
{
    sum += weight;
    float chance = weight / max(sum, 1e-37);
    bool taken = number < chance;
    number = min((taken ? number : number - chance) / max(taken ? chance : 1.0 - chance, 1e-37), 0.99999994);
    return taken;
}

// Returns direct light from one light sample, without a shadow test. views: number of directions that the path can
// choose from; 0 if the path ends here.
// Draws several light samples and chooses one, with a probability proportional to its unoccluded light [Talbot
// 2005]. LIGHT_TREE samples come from the light tree, which selects their lights by evenly spaced numbers. One more
// sample comes from each part of the other lights.
DirectLight direct_light(PathId at, vec3 position, vec3 normal, int views, out LightSample light_sample)
{
    uvec3 point = light_point(at);
    float number = choice_number(at), sum = 0.0;
    DirectLight direct;
    for (int k = 0; k < LIGHT_TREE; ++k)
    {
        float chance;
        int piece = light_of_tree(position, normal, point.x + uint(k) * (0xFFFFFFFFu / uint(LIGHT_TREE)), chance);
        uvec2 on = point.yz ^ (0x9E3779B9u * uint(k));
        LightSample one = light_on(light_piece_texel(piece, LIGHT_PIECE_CHOICE), vec3(fraction(on.x), fraction(on.y), 0.0), position);
        one.pdf *= max(chance, 1e-30);
        DirectLight found = light_from(one, position, normal, views);
        found.light *= chance > 0.0 ? 1.0 / float(LIGHT_TREE) : 0.0;
        if (is_taken(found.light.r + found.light.g + found.light.b, sum, number) || k == 0) {
            light_sample = one;
            direct = found;
        }
    }
#ifdef PARTS
    for (int k = 0; k < PARTS; ++k)
    {
        float share;
        LightSample one = light_of(at, k, position, share);
        DirectLight found = light_from(one, position, normal, views);
        found.light *= share;
        if (is_taken(found.light.r + found.light.g + found.light.b, sum, number)) {
            light_sample = one;
            direct = found;
        }
    }
#endif
    direct.light *= sum / max(direct.light.r + direct.light.g + direct.light.b, 1e-37);
    return direct;
}
#else
// Returns direct light from one light sample, without a shadow test. views: number of directions that the path can
// choose from; 0 if the path ends here.
// Draws one light sample from each part of the lights, and chooses one of them with a probability proportional to
// its unoccluded light [Talbot 2005].
DirectLight direct_light(PathId at, vec3 position, vec3 normal, int views, out LightSample light_sample)
{
    int selected = 0;
    float scale = 1.0, share;
#if PARTS > 1
    float weights[PARTS], sum = 0.0;
    for (int k = 0; k < PARTS; ++k)
    {
        LightSample one = light_of(at, k, position, share);
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
    light_sample = light_of(at, selected, position, share);
    DirectLight direct = light_from(light_sample, position, normal, views);
    direct.light *= scale * share;
    return direct;
}
#endif

// Adds `lit`, the path's radiance from a light sample, to L if the sample is visible. start: start of the shadow
// ray, at distance `rounding` from the surface of `triangle`.
void add_unblocked(
    inout vec3 L, vec3 lit, PathId at, DirectLight direct, LightSample light_sample, vec3 start, float rounding, int triangle)
{
    if (max(lit.r, max(lit.g, lit.b)) > 0.0) {
        // The ray ends just before the light, so that the light's own triangle does not occlude it.
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
