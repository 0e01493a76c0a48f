// path_next.glsl: direct light at a vertex, and the shared direction in which its path continues [PB A.3, table 6].
// Needs:  <SCENE>, path_vertex.glsl, direct.glsl, random.glsl, direction_code.glsl
// Frame:  world. Units: radiance W sr^-1 m^-2, linear Rec. 709.
uniform vec3 next_directions[VIEWS];  // directions in which paths continue, shared by all paths of a set [PB 3.1]
uniform int next_views;         // number of directions that a path can choose from
uniform bool roulette;          // true if paths end by Russian roulette (Arvo & Kirk 1990)
// Probability that a path continues, per unit of its cosine with the surface; see go_on.
uniform float cosine_roulette;

#ifdef HAS_DISTANT_LIGHTS
// Light from a source at infinity, reflected by this vertex. It is pending: it counts only if a scan towards the
// source hits nothing. pending_start: start of that scan; w: code of direction_code.glsl, 0 if nothing is pending.
vec4 pending_start = vec4(0.0);
vec3 pending_light = vec3(0.0);
#endif

#if defined(SPLIT_LIGHT) && defined(LAST_VERTEX)
vec3 last_lit;  // light of the light sample at this vertex
#endif

struct PathState
{
    vec4 position;  // start of the path's next segment; w: see direction_code.glsl
    vec3 beta;      // throughput, including the reflection at `position`
    vec3 radiance;
};

PathState ended(vec3 radiance)
{
    return PathState(vec4(0.0), vec3(0.0), radiance);
}

// Returns the light that the eye receives from the light sample by reflection at this vertex. Light from a source
// at infinity is left pending instead. `views`: number of directions that the path can choose from when it
// continues, 0 if it ends.
vec3 lit(PathVertex v, uint path, vec3 beta, int views)
{
    DirectLight direct = direct_light(v.surface.position, v.normal, v.triangle, v.plane, views);
#if defined(LAST_VERTEX) && defined(HAS_SKY) && defined(HAS_DISTANT_LIGHTS)
    if (ambient_instead(light_kind)) direct.light = vec3(0.0);
#endif
    vec3 lit = beta * diffuse_eval(v.bsdf, v.n, v.wo, direct.wi) * direct.light
             * shading_cosine(v.n, v.normal, v.vertex_cosine, direct.wi);
#ifdef HAS_MICROFACETS
    lit += beta * mirroring_eval(v.bsdf, v.n, v.normal, v.wo, direct.wi) * direct.light;
#endif
#ifdef HAS_DISTANT_LIGHTS
    if (direct.distant) {
        // A surface at grazing incidence receives little light, but its paths would displace others from their
        // cells. The probability is twice that of continuing paths, because the light's single direction has all
        // cells to itself.
        float chance = min(1.0, 2.0 * dot(v.normal, direct.wi) * cosine_roulette);
        bool asks = max(lit.r, max(lit.g, lit.b)) > 0.0 && random_number(path, USE_LIGHT) < chance;
        if (asks) pending_start = vec4(v.surface.position, 1.0);
        pending_light = lit / max(chance, 1e-30);
        lit = vec3(0.0);
    }
#endif
    return lit;
}

// Continues the path in one of the shared directions.
PathState go_on(PathVertex v, uint path, vec3 beta, vec3 radiance)
{
    float c = dot(v.normal, next_directions[0]);
    int view = 0;
#if defined(WHOLE_SPHERE)
    // Uniform density 1 / (4 pi) over the sphere [PB]: a path ends if its direction is below the surface.
    if (c <= 0.0) return ended(radiance);
    float weight = 4.0 * c;
#else
    float weight = 1.0;
    if (next_views == 2) {
        // Both directions are uniform on the sphere and are flipped to the visible side. The direction nearer to
        // the normal then has the density cosine / pi, which suits a Lambertian surface.
        float other = dot(v.normal, next_directions[VIEWS - 1]);
        if (abs(other) > abs(c)) { c = other; view = 1; }
    } else {
        // Paths that leave a surface at a grazing angle carry little light and crowd into few cells. They continue
        // with a probability proportional to the cosine.
        float chance = min(1.0, abs(c) * cosine_roulette);
        if (random_number(path, USE_COSINE) >= chance) return ended(radiance);
        weight = 2.0 * abs(c) / chance;
    }
#endif
    vec3 wi = c < 0.0 ? -next_directions[view] : next_directions[view];
    vec3 throughput = beta * diffuse_eval(v.bsdf, v.n, v.wo, wi) * (weight * shading_cosine(v.n, v.normal, v.vertex_cosine, wi));
#ifdef HAS_MICROFACETS
    throughput += beta * mirroring_eval(v.bsdf, v.n, v.normal, v.wo, wi) * weight;
#endif
    float max_throughput = max(throughput.r, max(throughput.g, throughput.b));
    if (roulette) {
        float stay = min(1.0, max_throughput);
        if (random_number(path, USE_ROULETTE) >= stay) return ended(radiance);
        throughput /= stay;
    }
    if (max_throughput <= 0.0 || c == 0.0) return ended(radiance);
    return PathState(vec4(v.surface.position, pack_direction(view, c)), throughput, radiance);
}

// Adds direct light, and chooses the next direction; at the last vertex adds ambient radiance.
PathState lit_and_gone_on(PathVertex v, uint path, vec3 beta, vec3 radiance)
{
#ifdef LAST_VERTEX
    vec3 found = lit(v, path, beta, 0);
#ifdef SPLIT_LIGHT
    last_lit = found;
#endif
    return ended(radiance + found + beta * v.bsdf.diffuse * ambient);
#else
    return go_on(v, path, beta, radiance + lit(v, path, beta, next_views));
#endif
}
