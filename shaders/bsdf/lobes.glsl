// lobes.glsl: chooses the lobe in which a path continues, and a direction in it. Each lobe has its own probability, and its own
// MIS weight against light samples.
// Needs:  path_vertex.glsl, light_sample.glsl; HAS_THIN_DIELECTRICS, HAS_VARYING_THIN_DIELECTRICS
// Frame:  world.

// Stands for the infinite density of a mirror direction. It marks directions that light samples never have.
const float DELTA_LOBE = 1e18;

// Probabilities of the lobes; the rest is the probability that the path ends.
struct Lobes
{
    float diffuse;
    float microfacets;
    float coat;
    float mirror;
#ifdef HAS_DIFFUSE_TRANSMISSION
    float through;  // probability of diffuse transmission to the other side
#endif
};

// Returns the probabilities with which a path continues by each lobe. diffuse_continues: false for a path whose
// diffuse light is looked up. It continues only by the other lobes, each with a probability equal to its
// reflectance.
Lobes lobes_of(PathVertex v, bool diffuse_continues, bool others_continue)
{
    Bsdf b = v.bsdf;
    float cosine = dot(v.n, v.wo);
    Lobes q;
    q.diffuse = diffuse_importance(b, cosine);
    q.microfacets = q.coat = 0.0;
    q.mirror = mean(b.mirror);
#ifdef HAS_MICROFACETS
    q.coat = coat_takes(b, cosine);
    float through = mean(glass_transmittance(b, cosine));
    q.microfacets = (mean(microfacet_reflects(b, cosine)) + through) * under_layers(b, cosine);
#endif
    if (!others_continue) q.microfacets = q.coat = q.mirror = 0.0;
    if (!diffuse_continues) q.diffuse = 0.0;
    float sum = q.diffuse + q.microfacets + q.coat + q.mirror;
#ifdef HAS_DIFFUSE_TRANSMISSION
    q.through = diffuse_continues ? mean(diffuse_transmittance(b, cosine)) : 0.0;
    sum += q.through;
#endif
    float scale = 1.0 / max(sum, diffuse_continues ? 1e-9 : 1.0);
    q.diffuse *= scale;
    q.microfacets *= scale;
    q.coat *= scale;
    q.mirror *= scale;
#ifdef HAS_DIFFUSE_TRANSMISSION
    q.through *= scale;
#endif
    return q;
}

// MIS weight of a light sample against sampling a direction of a lobe [Veach]; light, direction: densities of the
// two. A punctual light has density 0, and only light samples find it.
float mis_weight(float light, float direction)
{
    return light > 0.0 ? power_heuristic(light, direction) : 1.0;
}

#ifdef HAS_MICROFACETS
// Axes of microfacets, glass and clearcoat.
mat3 mirroring_axes(PathVertex v)
{
    return surface_axes(v.bsdf, mirroring_normal(v.n, v.normal, v.wo));
}
#endif

// Light of a light sample that a vertex reflects, by the diffuse lobe and by the others, with MIS weights.
// direct.light has no MIS weight yet.
void light_lobes(PathVertex v, Lobes q, DirectLight direct, out vec3 diffuse, out vec3 others)
{
    float cosine = dot(v.normal, direct.wi);
    diffuse = diffuse_eval(v.bsdf, v.n, v.wo, direct.wi) * direct.light
         * shading_cosine(v.n, v.normal, v.vertex_cosine, direct.wi)
         * mis_weight(direct.pdf, q.diffuse * cosine / PI);
    others = vec3(0.0);
#ifdef HAS_MICROFACETS
    mat3 axes = mirroring_axes(v);
    vec3 wo = v.wo * axes, wi = direct.wi * axes;
    Lobe base = microfacet_lobe(v.bsdf, wo, wi);
    vec3 f = base.f * mis_weight(direct.pdf, q.microfacets * base.pdf);
#if defined(HAS_COAT) && !defined(HAS_COAT_NORMALS)
    Lobe coat = coat_lobe(v.bsdf, wo, wi);
    f += coat.f * mis_weight(direct.pdf, q.coat * coat.pdf);
#endif
    others = f * direct.light * (max(wi.z, 0.0) / max(cosine, 1e-6));
#ifdef HAS_COAT_NORMALS
    mat3 over = coat_axes(v.bsdf, axes);
    vec3 coat_wi = direct.wi * over;
    Lobe coat = coat_lobe(v.bsdf, v.wo * over, coat_wi);
    others += coat.f * direct.light
            * (mis_weight(direct.pdf, q.coat * coat.pdf) * max(coat_wi.z, 0.0) / max(cosine, 1e-6));
#endif
#endif
}

#ifdef HAS_ROUGH_TRANSMISSION
// Light of a light sample on the other side that rough glass transmits, with its MIS weight.
vec3 light_through(PathVertex v, Lobes q, DirectLight direct)
{
    mat3 axes = mirroring_axes(v);
    vec3 wi = direct.wi * axes;
    Lobe lobe = through_lobe(v.bsdf, v.wo * axes, wi);
    float cosine = -dot(v.normal, direct.wi);
    return lobe.f * direct.light
         * (mis_weight(direct.pdf, q.microfacets * lobe.pdf) * max(-wi.z, 0.0) / max(cosine, 1e-6));
}
#endif

#ifdef HAS_DIFFUSE_TRANSMISSION
// Light of a light sample on the other side that the diffuse lobe transmits, with its MIS weight.
vec3 light_through_diffuse(PathVertex v, Lobes q, DirectLight direct)
{
    float cosine = -dot(v.normal, direct.wi);
    return diffuse_transmittance(v.bsdf, dot(v.n, v.wo)) * direct.light
         * shading_cosine(-v.n, -v.normal, v.vertex_cosine, direct.wi)
         * mis_weight(direct.pdf, q.through * cosine / PI);
}
#endif

struct BsdfSample
{
    vec3 direction;
    vec3 weight;    // throughput factor of the direction, divided by its probability
    float pdf;  // density of the direction per solid angle
    bool through;   // true if the direction goes to the other side
    bool straight;  // true if the direction goes straight through a thin dielectric, as shadow rays do
};

// Samples a direction of microfacets, glass, clearcoat or a mirror. chosen: random number that chose the lobe,
// minus the probability of the diffuse lobes.
BsdfSample bsdf_sample(PathVertex v, Lobes q, float chosen, vec2 numbers)
{
    Bsdf b = v.bsdf;
    vec3 mirrored = reflect(-v.wo, mirroring_normal(v.n, v.normal, v.wo));
    BsdfSample d = BsdfSample(mirrored, b.mirror / max(q.mirror, 1e-9), DELTA_LOBE, false, false);
#ifdef HAS_MICROFACETS
    if (chosen >= q.mirror) {
#ifdef HAS_COAT
        bool coat = chosen < q.mirror + q.coat;
#else
        const bool coat = false;
#endif
        vec2 alpha = coat ? vec2(b.coat_alpha) : b.alpha;
        bool smooth_one = max(alpha.x, alpha.y) < SMOOTH;
        mat3 axes = mirroring_axes(v);
#ifdef HAS_COAT_NORMALS
        if (coat) axes = coat_axes(b, axes);
#endif
        bool is_beckmann = IS_BECKMANN(b) && !coat;
        vec3 wo = v.wo * axes;
        vec3 m = smooth_one ? vec3(0.0, 0.0, 1.0) : sample_visible_normal(wo, alpha, is_beckmann, numbers);
        float cosine = dot(wo, m), part = coat ? 1.0 : reflected_part(b, cosine), chance = coat ? q.coat : q.microfacets;
        vec3 wi = reflect(-wo, m);
        // The remainder of the random number that chose the lobe chooses between transmission and reflection.
        d.through = chosen - q.mirror - q.coat >= part * q.microfacets && !coat;
        if (d.through) {
#ifdef HAS_GLASS
            // No factor of the squared index is needed: radiance over the squared index is constant along a path,
            // and both ends of a path lie in air.
            d.weight = glass_transmittance(b, cosine) / (1.0 - part);
            bool unbent = is_unbent(b);
            wi = unbent ? -wo : b.eta > 0.0 ? refract(-wo, m, 1.0 / b.eta) : vec3(wi.xy, -wi.z);
            d.straight = b.eta <= THIN_DIELECTRIC;
#ifdef HAS_ROUGH_TRANSMISSION
            if (!smooth_one && !unbent) d.pdf = chance * through_lobe(b, wo, wi).pdf;
#endif
#endif
        } else {
            d.weight = (coat ? vec3(coat_reflects(b, cosine)) : microfacet_reflects(b, cosine)) / part;
            float density = masking(wo, alpha, is_beckmann) * normal_density(m, alpha, is_beckmann);
            if (!smooth_one) d.pdf = chance * part * density / (4.0 * wo.z);
        }
        bool right_side = d.through ? wi.z < 0.0 : wi.z > 0.0;
        float seen = smooth_one ? 1.0 : masking(wi, alpha, is_beckmann);
        d.weight *= (right_side ? seen : 0.0) * (coat ? 1.0 : under_layers(b, wo.z)) / chance;
        d.direction = normalize(axes * wi);
    }
#endif
    float side = dot(d.direction, v.normal);
    // The shading normal may have sent the direction to the wrong side of the surface.
    if (d.through ? side >= 0.0 : side <= 0.0) d.weight = vec3(0.0);
    return d;
}

#ifdef HAS_THIN_DIELECTRICS
// Transmittance of a thin dielectric at a ray's hit, 0 for any other surface. ray: direction, of any length.
vec3 thin_transmittance(int triangle, vec3 origin, vec3 ray)
{
    vec4 plane = triangle_plane(triangle);
    vec3 position = origin + (plane.w - dot(plane.xyz, origin)) / dot(plane.xyz, ray) * ray;
#ifdef HAS_VARYING_THIN_DIELECTRICS
    Surface s = surface_of_triangle(triangle, position, plane);
#else
    Surface s = surface_of_shape(int(triangle_face(triangle).w), position, plane.xyz);
#endif
    vec3 wo = -normalize(ray);
    bool front = front_hit(plane.xyz, ray);
#ifdef HAS_VARYING_THIN_DIELECTRICS
    Bsdf b = bsdf_at(s, front);
#else
    Bsdf b = bsdf_of(s, front, vec3(1.0), vec2(1.0), 1.0);
#endif
    see_coat_along(b, s, front, wo);  // suffices, because a smooth surface needs no energy compensation
    float cosine = dot(shading_normal(s, front, wo), wo);
    if (b.eta > THIN_DIELECTRIC) return vec3(0.0);
    return glass_transmittance(b, cosine) * under_layers(b, cosine);
}
#endif
