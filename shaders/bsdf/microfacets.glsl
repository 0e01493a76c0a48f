// microfacets.glsl: GGX's microfacets, and what Fresnel says of them.
// Frame:  the surface's own: z is the normal to shade with, x goes along the tangent; w, m are unit.
// Source: Walter et al. 2007, Microfacet models for refraction; Dupuy & Benyoub 2023, Sampling visible GGX normals with
//         spherical caps; masking and shadowing are independent, as in glTF 2.0, B.3.2.
#include <CONSTANTS>

// Of a roughness: along the tangent and across [KHR_materials_anisotropy]. A tangent leaves grooves, so that across it is
// never quite a mirror, whose density has no value.
vec2 ggx_alpha(float roughness, float anisotropy)
{
    float across = roughness * roughness;
    if (anisotropy > 0.0) across = max(across, SMOOTH);
    return vec2(mix(across, 1.0, anisotropy * anisotropy), across);
}

// Density of normals, per solid angle of m times its cosine.
float ggx(vec3 m, vec2 alpha)
{
    vec2 s = m.xy / alpha;
    float a = dot(s, s) + m.z * m.z;
    return 1.0 / (PI * alpha.x * alpha.y * a * a);
}

// Share of the microfacets that look along w and are seen from there.
float ggx_seen(vec3 w, vec2 alpha)
{
    vec2 s = alpha * w.xy;
    float z = abs(w.z);
    return 2.0 * z / (z + sqrt(z * z + dot(s, s)));
}

// A normal, as dense as they are seen along w, which is above the surface.
vec3 visible_normal(vec3 w, vec2 alpha, vec2 u)
{
    vec3 stretched = normalize(vec3(alpha * w.xy, w.z));
    float phi = 2.0 * PI * u.x, z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    float r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 h = vec3(r * cos(phi), r * sin(phi), z) + stretched;
    return normalize(vec3(alpha * h.xy, max(h.z, 1e-7)));
}

// Its density per solid angle.
float visible_normal_pdf(vec3 w, vec3 m, vec2 alpha)
{
    return ggx_seen(w, alpha) * ggx(m, alpha) * max(dot(w, m), 0.0) / w.z;
}

float schlick(float cosine)
{
    float x = clamp(1.0 - cosine, 0.0, 1.0), x2 = x * x;
    return x2 * x2 * x;
}

// Share that a smooth surface between two dielectrics reflects; eta: index of the far side over that of the near one.
float fresnel(float cosine, float eta)
{
    float sine2 = (1.0 - cosine * cosine) / (eta * eta);
    if (sine2 >= 1.0) return 1.0;
    float far = sqrt(1.0 - sine2);
    vec2 r = vec2((cosine - eta * far) / (cosine + eta * far), (eta * cosine - far) / (eta * cosine + far));
    return 0.5 * dot(r, r);
}
