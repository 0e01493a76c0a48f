// followed.glsl: follows the eye's ray through mirrors and clear glass, because a denoiser that only gets features of the
// mirror itself blurs the reflection.
// Needs:  ray_bvh.glsl, surface.glsl, sky.glsl
// Frame:  world.
// Source: Open Image Denoise, documentation, "Albedos" and "Normals": features along the path of a perfect mirror or
//         dielectric.
const int FOLLOWED = 6;  // maximum number of mirrors that are followed

// Finds the mirrored or refracted direction from which the surface sends more than half of its light to the eye.
// Returns false if there is none; otherwise sets d to it, `share` to the fraction of light from there, and `side`
// to -1 if it is behind the surface.
// straight: true if a thin dielectric transmits this light.
bool is_clear(Surface s, bool front, inout vec3 d, out vec3 share, out float side, out bool straight)
{
    vec3 wo = -d, n = shading_normal(s, front, wo), m = mirroring_normal(n, front ? s.normal : -s.normal, wo);
    float cosine = dot(m, wo);
    Bsdf b = bsdf_seen(s, front, wo);
    vec3 reflected = mirrored(b, cosine), others = diffuse_reflectance(b, dot(n, wo)), through = vec3(0.0);
#ifdef HAS_MICROFACETS
    if (max(b.alpha.x, b.alpha.y) < SMOOTH) through = glass_transmittance(b, cosine) * under_layers(b, cosine);
    else others += (microfacet_reflects(b, cosine) + glass_transmittance(b, cosine)) * under_layers(b, cosine);
#endif
    bool mirrors = mean(reflected) >= mean(through);
    share = mirrors ? reflected : through;
    side = mirrors ? 1.0 : -1.0;
    straight = false;
    vec3 bent = reflect(d, m);
#ifdef HAS_GLASS
    straight = !mirrors && b.eta <= THIN_DIELECTRIC;
    if (!mirrors) bent = b.eta > 0.0 && !is_unbent(b) ? refract(d, m, 1.0 / b.eta) : d;
#endif
    if (mean(share) <= mean(reflected + others + through) - mean(share) || dot(bent, bent) == 0.0) return false;
    d = bent;
    return true;
}

// Follows the eye's ray from its first hit through mirrors and clear glass to the surface that they show. Returns
// the fraction of light from there. hit: false if the ray ends in the sky, or in the background. straight: true if
// all surfaces passed were thin glass, so that the eye sees the background. Absorption in solid glass is ignored.
vec3 follow(inout bool hit, inout vec3 d, inout bool front, inout Surface s, vec3 eye, out bool straight)
{
    vec3 share = vec3(1.0), from = eye;
    bool clear = hit;
    int mirrors = 0;
    straight = true;
    do
    {
        vec3 part;
        float side;
        bool goes_on;
        clear = clear && is_clear(s, front, d, part, side, goes_on);
        if (clear) {
            straight = straight && goes_on;
            share *= part;
            vec3 far = abs(s.position);
            float rounding = RAY_ROUNDING * (length(s.position - from) + max(far.x, max(far.y, far.z)));
            from = s.position + side * rounding * (front ? s.normal : -s.normal);
            int triangle = nearest_triangle(from, d, s.triangle);
            hit = triangle >= 0;
            clear = hit;
            if (hit) {
                vec4 plane = triangle_plane(triangle);
                s = surface_of_triangle(triangle, from + d * ((plane.w - dot(plane.xyz, from)) / dot(plane.xyz, d)), plane);
                front = front_hit(plane.xyz, d);
            }
        }
    } while (clear && ++mirrors < FOLLOWED);
    return share;
}
