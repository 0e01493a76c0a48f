// microfacets.glsl: microfacets with GGX's or Beckmann's distribution, and Fresnel's equations.
// Needs:  HAS_BECKMANN, HAS_METAL_INDICES: if materials have them
// Frame:  the surface's own: z is the shading normal, x is along the tangent; w, m are unit.
// Source: Walter et al. 2007, Microfacet models for refraction; Dupuy & Benyoub 2023, Sampling visible GGX normals with
//         spherical caps; Heitz & d'Eon 2014 and Jakob 2014 (An improved visible normal sampling routine) for Beckmann; masking
//         and shadowing are independent, as in glTF 2.0, B.3.2.
#include <CONSTANTS>

// Converts a roughness to alpha, along the tangent and across it [KHR_materials_anisotropy]. With anisotropy, alpha
// across is at least SMOOTH, because a perfect mirror has no density.
vec2 ggx_alpha(float roughness, float anisotropy)
{
    float across = roughness * roughness;
    if (anisotropy > 0.0) across = max(across, SMOOTH);
    return vec2(mix(across, 1.0, anisotropy * anisotropy), across);
}

// GGX distribution of normals, D. The integral of D times the cosine of m over the hemisphere is 1.
float ggx(vec3 m, vec2 alpha)
{
    vec2 s = m.xy / alpha;
    float a = dot(s, s) + m.z * m.z;
    return 1.0 / (PI * alpha.x * alpha.y * a * a);
}

// Smith's masking by GGX: fraction of the microfacets facing w that are visible from direction w.
float ggx_seen(vec3 w, vec2 alpha)
{
    vec2 s = alpha * w.xy;
    float z = abs(w.z);
    return 2.0 * z / (z + sqrt(z * z + dot(s, s)));
}

// Samples a microfacet normal with the density of normals visible from w, which is above the surface.
vec3 visible_normal(vec3 w, vec2 alpha, vec2 u)
{
    vec3 stretched = normalize(vec3(alpha * w.xy, w.z));
    float phi = 2.0 * PI * u.x, z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    float r = sqrt(clamp(1.0 - z * z, 0.0, 1.0));
    vec3 h = vec3(r * cos(phi), r * sin(phi), z) + stretched;
    return normalize(vec3(alpha * h.xy, max(h.z, 1e-7)));
}

#ifdef HAS_BECKMANN
// Beckmann's distribution of normals, D, whose slopes are Gaussian. The integral of D times the cosine of m is 1.
float beckmann(vec3 m, vec2 alpha)
{
    vec2 s = m.xy / alpha;
    float z2 = m.z * m.z;
    return exp(-dot(s, s) / z2) / (PI * alpha.x * alpha.y * z2 * z2);
}

// Smith's masking by Beckmann's distribution: Walter et al., eq. 27, a rational approximation within 0.35 %.
float beckmann_seen(vec3 w, vec2 alpha)
{
    vec2 s = alpha * w.xy;
    float square = dot(s, s), a = abs(w.z) * inversesqrt(max(square, 1e-30));
    return a >= 1.6 ? 1.0 : a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a));
}

// Error function by Abramowitz & Stegun 1964, 7.1.26, with an error below 1.5e-7.
float error_function(float x)
{
    float t = 1.0 / (1.0 + 0.3275911 * abs(x));
    float p = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    return sign(x) * (1.0 - p * exp(-x * x));
}

// Inverse error function by Giles 2010, Approximating the erfinv function, in single precision.
float inverse_error_function(float x)
{
    float w = -log(max((1.0 - x) * (1.0 + x), 1e-30)), p;
    if (w < 5.0) {
        w -= 2.5;
        p = -3.5233877e-6 + w * (3.43273939e-7 + w * 2.81022636e-8);
        p = 0.00021858087 + w * (-4.39150654e-6 + w * p);
        p = -0.00417768164 + w * (-0.00125372503 + w * p);
        return x * (1.50140941 + w * (0.246640727 + w * p));
    }
    w = sqrt(w) - 3.0;
    p = 0.00134934322 + w * (0.000100950558 + w * -0.000200214257);
    p = 0.00573950773 + w * (-0.00367342844 + w * p);
    p = 0.00943887047 + w * (-0.0076224613 + w * p);
    return x * (2.83297682 + w * (1.00167406 + w * p));
}

// Samples a slope of a surface of alpha 1 that is visible from a direction in the plane y = 0. cosine: between that
// direction and the normal. Source: Jakob 2014, by Newton's method.
vec2 visible_beckmann_slope(float cosine, vec2 u)
{
    float tangent = sqrt(max(1.0 - cosine * cosine, 1e-12)) / max(cosine, 1e-6), cotangent = 1.0 / tangent;
    float largest = error_function(cotangent), first = clamp(u.x, 1e-6, 1.0 - 1e-6);
    float x = largest - (largest + 1.0) * error_function(sqrt(-log(first)));
    const float root = 0.5641895835;  // 1 / sqrt(pi)
    float wanted = first * (1.0 + largest + root * tangent * exp(-cotangent * cotangent));
    for (int k = 0; k < 3; ++k)
    {
        float slope = inverse_error_function(x);
        x -= (1.0 + x + root * tangent * exp(-slope * slope) - wanted) / (1.0 - slope * tangent);
        x = clamp(x, -1.0 + 1e-6, largest);
    }
    return vec2(inverse_error_function(x), inverse_error_function(clamp(2.0 * u.y - 1.0, -1.0 + 1e-6, 1.0 - 1e-6)));
}

vec3 visible_beckmann_normal(vec3 w, vec2 alpha, vec2 u)
{
    vec3 stretched = normalize(vec3(alpha * w.xy, w.z));
    vec2 slope = visible_beckmann_slope(stretched.z, u);
    float across = length(stretched.xy);
    vec2 along = across > 1e-9 ? stretched.xy / across : vec2(1.0, 0.0);
    slope = vec2(along.x * slope.x - along.y * slope.y, along.y * slope.x + along.x * slope.y);
    return normalize(vec3(-alpha * slope, 1.0));
}
#endif

// The next functions give the density of normals, masking, and samples of visible normals: by Beckmann's
// distribution if is_beckmann, otherwise by GGX.

float normal_density(vec3 m, vec2 alpha, bool is_beckmann)
{
#ifdef HAS_BECKMANN
    if (is_beckmann) return beckmann(m, alpha);
#endif
    return ggx(m, alpha);
}

float masking(vec3 w, vec2 alpha, bool is_beckmann)
{
#ifdef HAS_BECKMANN
    if (is_beckmann) return beckmann_seen(w, alpha);
#endif
    return ggx_seen(w, alpha);
}

vec3 sample_visible_normal(vec3 w, vec2 alpha, bool is_beckmann, vec2 u)
{
#ifdef HAS_BECKMANN
    if (is_beckmann) return visible_beckmann_normal(w, alpha, u);
#endif
    return visible_normal(w, alpha, u);
}

// Density per solid angle with which `sample_visible_normal` returns the normal m.
float visible_normal_pdf(vec3 w, vec3 m, vec2 alpha, bool is_beckmann)
{
    return masking(w, alpha, is_beckmann) * normal_density(m, alpha, is_beckmann) * max(dot(w, m), 0.0) / w.z;
}

float schlick(float cosine)
{
    float x = clamp(1.0 - cosine, 0.0, 1.0), x2 = x * x;
    return x2 * x2 * x;
}

// Reflectance of a smooth surface between two dielectrics; eta: index of the far side over that of the near side.
float fresnel(float cosine, float eta)
{
    float sine2 = (1.0 - cosine * cosine) / (eta * eta);
    if (sine2 >= 1.0) return 1.0;
    float far = sqrt(1.0 - sine2);
    vec2 r = vec2((cosine - eta * far) / (cosine + eta * far), (eta * cosine - far) / (eta * cosine + far));
    return 0.5 * dot(r, r);
}

#ifdef HAS_METAL_INDICES
// Reflectance of metal with the index n + ik. Source: Born & Wolf 1999, Principles of optics, 14.2.
vec3 metal_reflects(float cosine, vec3 n, vec3 k)
{
    float c2 = cosine * cosine, s2 = 1.0 - c2;
    vec3 real = n * n - k * k - s2, modulus = sqrt(real * real + 4.0 * n * n * k * k);
    vec3 t = modulus + c2, u = 2.0 * cosine * sqrt(max(0.5 * (modulus + real), vec3(0.0)));
    vec3 v = c2 * modulus + s2 * s2, across = (t - u) / (t + u);
    return 0.5 * across * (1.0 + (v - u * s2) / (v + u * s2));
}
#endif
