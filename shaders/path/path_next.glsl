// path_next.glsl: direct light at a vertex, and the shared direction in which its path continues [PB A.3, table 6].
// Needs:  <SCENE>, path_vertex.glsl, direct.glsl, random.glsl, direction_code.glsl
// Frame:  world. Units: radiance W sr^-1 m^-2, linear Rec. 709.
uniform vec3 next_directions[VIEWS];  // next directions, shared by all paths [PB 3.1]
uniform int next_views;         // number of directions that a path can choose from
uniform bool roulette;          // true if paths end by Russian roulette (Arvo & Kirk 1990)
uniform float cosine_roulette;  // see below

#ifdef HAS_DISTANT_LIGHTS
// Light from infinitely far that this vertex reflects if a scan along the light's direction hits nothing. pending_start.w is the
// code of direction_code.glsl, or 0 without such light.
vec4 pending_start = vec4(0.0);
vec3 pending_light = vec3(0.0);
#endif

#if defined(SPLIT_LIGHT) && defined(LAST_VERTEX)
vec3 last_lit;  // light of the light sample at this vertex
#endif

struct PathState
{
    vec4 position;  // position of the next vertex's start; w: see direction_code.glsl
    vec3 beta;      // throughput, including the next reflection
    vec3 radiance;
};

PathState ended(vec3 radiance)
{
    return PathState(vec4(0.0), vec3(0.0), radiance);
}

// Light of the light sample that the eye receives from here. Light from infinitely far stays pending. `views`: number of
// directions that the path can choose from when it continues, 0 if it ends.
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
        // A surface at grazing incidence gets little light, but its paths would displace others from their cells. The
        // probability is twice that of continuing paths, because there is only one direction, with all cells.
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
    // The paper's density 1 / (4 pi): a path ends if its direction is below the surface.
    if (c <= 0.0) return ended(radiance);
    float weight = 4.0 * c;
#else
    float weight = 1.0;
    if (next_views == 2) {
        // Both uniform directions are turned to the visible side. The direction nearer to the normal then has the density
        // cosine / pi, that of a Lambertian surface.
        float other = dot(v.normal, next_directions[VIEWS - 1]);
        if (abs(other) > abs(c)) { c = other; view = 1; }
    } else {
        // Paths of a surface seen edge-on carry little light and crowd into few cells. They continue with a probability in
        // proportion to the cosine.
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
