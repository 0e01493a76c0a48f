// bsdf.glsl: scattering at a point of a surface: a diffuse base (Lambert's, with Phong's highlight) and sheen, under or beside
// mirroring lobes: microfacets, a clearcoat, a mirror. Each lobe is evaluated and sampled separately.
// Needs:  constants.py (PI, LAYERING_GLTF and the other layerings)
//         HAS_HIGHLIGHTS, HAS_MIRRORS, HAS_MICROFACETS, HAS_COAT, HAS_COAT_NORMALS, HAS_IRIDESCENCE, HAS_SHEEN, HAS_GLASS,
//         HAS_GLASS_SPECULAR, HAS_ROUGH_TRANSMISSION, HAS_DIFFUSE_TRANSMISSION, HAS_MULTIPLE_SCATTERING, HAS_FRESNEL,
//         HAS_PLASTIC, HAS_DISNEY, HAS_BECKMANN, HAS_METAL_INDICES: defined if materials have the feature
// Frame:  world; wo and wi are unit and point away from the surface; `n` is unit and on wo's side.
// Units:  a BRDF is relative to that of a white Lambertian surface, 1 / pi.
// Source: glTF 2.0, appendix B, and its extensions for the clearcoat (clearcoat), glass (transmission, volume) and the strength
//         of a dielectric's reflection (specular); Phong 1975 [TB IV]. For layerings other than glTF's see `Material.layering`:
//         plastic is Mitsuba's; Burley 2012, Physically based shading at Disney.
#include "sampling/directions.glsl"
#ifdef HAS_MICROFACETS
#include "bsdf/microfacets.glsl"
#ifdef HAS_IRIDESCENCE
#include "bsdf/iridescence.glsl"
#endif
#ifdef HAS_SLABS
#include "bsdf/slab.glsl"
#endif
#endif

struct Bsdf
{
    vec3 diffuse;   // diffuse reflectance
    vec3 specular;  // coefficient of Phong's highlight
    float exponent;
    vec3 mirror;    // reflectance for light from the mirror direction
#ifdef HAS_MICROFACETS
    vec3 metal;       // reflectance of metal at normal incidence, times the fraction of the surface that is metal
    float metallic;   // fraction of the surface that is metal; also the limit of `metal` at grazing incidence
    vec3 dielectric;  // dielectric's reflectance at normal incidence
    float grazing;    // dielectric's reflectance at grazing incidence
    float layered;    // fraction of the surface that is a dielectric
    vec2 alpha;       // alpha of GGX, along the tangent and across it
#ifdef HAS_ANISOTROPY
    vec3 tangent;       // unit tangent along the surface; 0 for none
#endif
#ifdef HAS_IRIDESCENCE
    vec3 film;        // x: fraction of the surface under a thin film; y: film thickness, nm; z: index of refraction of the film
#endif
    float coat;       // fraction of the surface under clearcoat
    float coat_alpha;
#ifdef HAS_COAT_NORMALS
    vec3 coat_normal;   // mirror normal of the clearcoat, on wo's side
    float coat_cosine;  // cosine between wo and the clearcoat's shading normal
#endif
#ifdef HAS_SHEEN
    vec3 sheen;           // colour of sheen, which is sampled with the diffuse lobe
    float sheen_alpha;    // alpha of Charlie's distribution
    // Coefficients of the logarithm of white sheen's albedo, a polynomial in the square root of the cosine.
    mat2x4 sheen_albedo;
    vec4 sheen_lambda;    // coefficients b, c, d, e of Charlie's lambda; sheen_lambda_a is a
    float sheen_lambda_a;
#endif
    vec3 transmission;       // transmittance of glass, times the fraction of the surface that is glass
#ifdef HAS_MULTIPLE_SCATTERING
    vec3 metal_gain;    // factor on metal's lobe that compensates for multiple scattering
    float glass_share;  // fraction of the dielectric that is glass
    float base_share;   // fraction of light that a dielectric transmits to the base; below 0: computed from the half vector's angle
#endif
#ifdef HAS_DIFFUSE_TRANSMISSION
    vec3 diffuse_through;  // diffuse transmittance of Lambert's base
#endif
#ifdef HAS_BECKMANN
    bool is_beckmann;  // true for Beckmann's distribution instead of GGX's
#endif
#ifdef HAS_METAL_INDICES
    vec3 metal_n;     // refractive index of metal; 0: Schlick's formula
    vec3 metal_k;
    vec3 metal_tint;  // factor on the reflectance that metal_n and metal_k give
#endif
#ifdef HAS_FRESNEL
    float ior;   // index of refraction for Fresnel's equations
    vec3 tint;   // factor on the reflectance that `ior` gives
    int layering;  // LAYERING_GLTF, with Schlick's formula, or another LAYERING_ constant
#ifdef HAS_PLASTIC
    // Coefficients of the fraction of light that crosses the boundary to plastic's base: a polynomial in the square
    // root of the cosine.
    mat2x4 entry;
    float entry_mean;  // `entry` for uniform light
#endif
#endif
    // Refractive index of the far side, divided by that of the near side. 0: thin, without refraction.
    // THIN_DIELECTRIC: thin and smooth. Below THIN_DIELECTRIC: minus the index of a slab; `transmission` is then
    // the transmittance of one pass through the slab's glass.
    float eta;
#endif
};

Bsdf lambertian(vec3 reflectance)
{
    Bsdf b;
    b.diffuse = reflectance;
    b.specular = b.mirror = vec3(0.0);
    b.exponent = 1.0;
#ifdef HAS_MICROFACETS
    b.metal = b.dielectric = b.transmission = vec3(0.0);
    b.metallic = b.grazing = b.layered = b.coat = b.coat_alpha = b.eta = 0.0;
    b.alpha = vec2(1.0);
#ifdef HAS_MULTIPLE_SCATTERING
    b.metal_gain = vec3(1.0);
    b.glass_share = 0.0;
    b.base_share = -1.0;
#endif
#ifdef HAS_DIFFUSE_TRANSMISSION
    b.diffuse_through = vec3(0.0);
#endif
#ifdef HAS_BECKMANN
    b.is_beckmann = false;
#endif
#ifdef HAS_METAL_INDICES
    b.metal_n = b.metal_k = b.metal_tint = vec3(0.0);
#endif
#ifdef HAS_FRESNEL
    b.ior = 0.0;
    b.tint = vec3(0.0);
    b.layering = LAYERING_GLTF;
#ifdef HAS_PLASTIC
    b.entry = mat2x4(0.0);
    b.entry_mean = 0.0;
#endif
#endif
#ifdef HAS_IRIDESCENCE
    b.film = vec3(0.0);
#endif
#ifdef HAS_COAT_NORMALS
    b.coat_normal = vec3(0.0, 0.0, 1.0);
    b.coat_cosine = 1.0;
#endif
#ifdef HAS_SHEEN
    b.sheen = vec3(0.0);
    b.sheen_alpha = 1.0;
    b.sheen_albedo = mat2x4(0.0);
    b.sheen_lambda = vec4(0.0);
    b.sheen_lambda_a = 0.0;
#endif
#ifdef HAS_ANISOTROPY
    b.tangent = vec3(0.0);
#endif
#endif
    return b;
}

float mean(vec3 v)
{
    return (v.r + v.g + v.b) * (1.0 / 3.0);
}

#ifdef HAS_MICROFACETS
const float THIN_DIELECTRIC = -1.0;  // code of a smooth and thin dielectric, through which light goes straight
const float COAT_REFLECTS = 0.04;

// Returns `plain`, the reflectance without a film, mixed with the reflectance under a thin film by the fraction of
// the surface that has one; weight: reflectance at grazing incidence; f0: reflectance at normal incidence without
// the film.
vec3 under_film(Bsdf b, float cosine, vec3 plain, float weight, vec3 f0)
{
#ifdef HAS_IRIDESCENCE
    if (b.film.x <= 0.0 || weight <= 0.0) return plain;
    return mix(plain, weight * film_reflects(cosine, b.film.y, b.film.z, f0 / weight), b.film.x);
#else
    return plain;
#endif
}

#ifdef HAS_BECKMANN
#define IS_BECKMANN(b) b.is_beckmann
#else
#define IS_BECKMANN(b) false
#endif

#ifdef HAS_FRESNEL
// Reflectance of an untinted dielectric; for a thin dielectric, that of both its faces, without polarization.
float boundary_reflects(Bsdf b, float cosine)
{
    float F = fresnel(cosine, b.eta > 0.0 ? b.eta : b.ior);
    return b.eta <= THIN_DIELECTRIC ? 2.0 * F / (1.0 + F) : F;
}
#endif

// Reflectance of a dielectric; `cosine`: between a direction and the microfacet's normal.
vec3 dielectric_reflects(Bsdf b, float cosine)
{
#ifdef HAS_FRESNEL
    if (b.layering != LAYERING_GLTF) return b.tint * boundary_reflects(b, cosine);
#endif
#ifdef HAS_GLASS
    // Fresnel's equations, because Schlick's formula has no total internal reflection. A film has no effect from
    // inside.
    if (b.eta > 0.0) {
        vec3 plain = vec3(fresnel(cosine, b.eta));
#ifdef HAS_GLASS_SPECULAR
        // From b.dielectric to b.grazing, as Fresnel's equations go from their value at normal incidence to 1. Total
        // internal reflection stays total, because there is no direction for the rest.
        float root = (b.eta - 1.0) / (b.eta + 1.0), normal = root * root;
        if (b.eta > 1.0 || plain.r < 1.0)
            plain = max(b.dielectric + (b.grazing - b.dielectric) * ((plain.r - normal) / (1.0 - normal)), vec3(0.0));
        return b.eta > 1.0 ? under_film(b, cosine, plain, b.grazing, b.dielectric) : plain;
#else
        return b.eta > 1.0 ? under_film(b, cosine, plain, 1.0, b.dielectric) : plain;
#endif
    }
#endif
#ifdef HAS_SLABS
    if (b.eta < THIN_DIELECTRIC) {
        vec3 reflected;
        slab(cosine, -b.eta, b.transmission, reflected);
        return reflected;
    }
#endif
    return under_film(b, cosine, b.dielectric + (b.grazing - b.dielectric) * schlick(cosine), b.grazing, b.dielectric);
}

vec3 microfacet_reflects(Bsdf b, float cosine)
{
    vec3 metal = b.metal + (b.metallic - b.metal) * schlick(cosine);
    metal = under_film(b, cosine, metal, b.metallic, b.metal);
#ifdef HAS_METAL_INDICES
    if (b.metal_k.r + b.metal_n.r > 0.0) metal = b.metal_tint * metal_reflects(cosine, b.metal_n, b.metal_k);
#endif
#ifdef HAS_MULTIPLE_SCATTERING
    metal *= b.metal_gain;
#endif
    return metal + b.layered * dielectric_reflects(b, cosine);
}

// Fraction of light that a dielectric transmits to the base below it.
float base_transmittance(Bsdf b, float cosine)
{
#ifdef HAS_MULTIPLE_SCATTERING
    if (b.base_share >= 0.0) return b.base_share;
#endif
#ifdef HAS_FRESNEL
    if (b.layering != LAYERING_GLTF) return b.layered > 0.0 ? 1.0 - boundary_reflects(b, cosine) : 1.0;
#endif
    vec3 F = dielectric_reflects(b, cosine);
    return b.layered > 0.0 ? 1.0 - max(F.r, max(F.g, F.b)) : 1.0;
}

// Transmittance of glass, with both the reflection at its boundary and its colour.
vec3 glass_transmittance(Bsdf b, float cosine)
{
#ifdef HAS_SLABS
    vec3 reflected;
    if (b.eta < THIN_DIELECTRIC) return slab(cosine, -b.eta, b.transmission, reflected);
#endif
    return b.transmission * base_transmittance(b, cosine);
}

float coat_reflects(Bsdf b, float cosine)
{
#ifdef HAS_COAT
    return b.coat * (COAT_REFLECTS + (1.0 - COAT_REFLECTS) * schlick(cosine));
#else
    return 0.0;
#endif
}

// Fraction of light that the clearcoat reflects, so that the layers below lose it; `cosine`: between wo and the
// base's normal.
float coat_takes(Bsdf b, float cosine)
{
#ifdef HAS_COAT_NORMALS
    return coat_reflects(b, b.coat_cosine);
#else
    return coat_reflects(b, cosine);
#endif
}

#ifdef HAS_SHEEN
// Directional albedo of white sheen; `cosine`: between wo and the normal.
float sheen_albedo(Bsdf b, float cosine)
{
    float x = sqrt(clamp(cosine, 0.0, 1.0)), x2 = x * x;
    vec4 powers = vec4(1.0, x, x2, x2 * x);
    return exp(dot(b.sheen_albedo[0], powers) + x2 * x2 * dot(b.sheen_albedo[1], powers));
}

float charlie_exponent(Bsdf b, float x)
{
    return b.sheen_lambda_a / (1.0 + b.sheen_lambda.x * pow(x, b.sheen_lambda.y)) + b.sheen_lambda.z * x + b.sheen_lambda.w;
}

float charlie_lambda(Bsdf b, float cosine)
{
    float x = clamp(cosine, 1e-6, 1.0);
    if (x < 0.5) return exp(charlie_exponent(b, x));
    return exp(2.0 * charlie_exponent(b, 0.5) - charlie_exponent(b, max(1.0 - x, 1e-6)));
}

// BRDF of sheen: Charlie's distribution and visibility (Estevez & Kulla 2017). At grazing angles with a small alpha
// their albedo exceeds 1. The BRDF is then divided by the albedo, which only depends on the angle of wo.
vec3 sheen_eval(Bsdf b, vec3 n, vec3 wo, vec3 wi)
{
    float o = max(dot(n, wo), 1e-4), i = max(dot(n, wi), 1e-4);
    if (dot(n, wi) <= 0.0 || b.sheen == vec3(0.0)) return vec3(0.0);
    float h = dot(n, normalize(wo + wi)), sine2 = max(1.0 - h * h, 1e-12), over = 1.0 / b.sheen_alpha;
    float D = (2.0 + over) * pow(sine2, 0.5 * over) / (2.0 * PI);
    float seen = 1.0 / (4.0 * o * i * (1.0 + charlie_lambda(b, o) + charlie_lambda(b, i)));
    return b.sheen * (PI * D * seen / max(sheen_albedo(b, o), 1.0) * (1.0 - coat_takes(b, o)));
}
#endif

// Fraction of light left under the covering layers, clearcoat and sheen [KHR_materials_sheen]; `cosine`: between wo and the
// normal.
float under_layers(Bsdf b, float cosine)
{
    float left = 1.0 - coat_takes(b, cosine);
#ifdef HAS_SHEEN
    left *= 1.0 - max(b.sheen.r, max(b.sheen.g, b.sheen.b)) * min(sheen_albedo(b, cosine), 1.0);
#endif
    return left;
}
#endif

#ifdef HAS_MICROFACETS
#ifdef HAS_PLASTIC
float plastic_entry(Bsdf b, float cosine)
{
    float x = sqrt(clamp(cosine, 0.0, 1.0)), x2 = x * x;
    vec4 powers = vec4(1.0, x, x2, x2 * x);
    return max(dot(b.entry[0], powers) + x2 * x2 * dot(b.entry[1], powers), 0.0);
}
#endif

#ifdef HAS_DISNEY
// Ratio of Burley's base to Lambert's: darker at grazing angles, and retroreflective depending on roughness; d2: squared cosine
// of half the angle between the two directions.
float disney_base(Bsdf b, float o, float i, float d2)
{
    float Fo = schlick(o), Fi = schlick(i), R = 2.0 * sqrt(sqrt(b.alpha.x * b.alpha.y)) * d2;
    return (1.0 - 0.5 * Fo) * (1.0 - 0.5 * Fi) + R * (Fo + Fi + Fo * Fi * (R - 1.0));
}
#endif

// Ratio of the base's BRDF to Lambert's, for light from wi.
float base_response(Bsdf b, vec3 n, vec3 wo, vec3 wi)
{
#ifdef HAS_FRESNEL
    if (b.layering == LAYERING_BESIDE) return 1.0;
#endif
#ifdef HAS_PLASTIC
    if (b.layering == LAYERING_PLASTIC) return plastic_entry(b, dot(n, wo)) * plastic_entry(b, dot(n, wi));
#endif
#ifdef HAS_DISNEY
    if (b.layering == LAYERING_DISNEY) return disney_base(b, dot(n, wo), dot(n, wi), 0.5 + 0.5 * dot(wo, wi));
#endif
    return base_transmittance(b, dot(wo, normalize(wo + wi)));
}

// Ratio of the base's reflectance to Lambert's, for uniform light; `cosine`: between wo and the normal. Approximate
// for Burley's base, for which a mean angle between the directions is used.
float base_response(Bsdf b, float cosine)
{
#ifdef HAS_FRESNEL
    if (b.layering == LAYERING_BESIDE) return 1.0;
#endif
#ifdef HAS_PLASTIC
    if (b.layering == LAYERING_PLASTIC) return plastic_entry(b, cosine) * b.entry_mean;
#endif
#ifdef HAS_DISNEY
    if (b.layering == LAYERING_DISNEY) return disney_base(b, cosine, 0.455, 0.5 + cosine / 3.0);
#endif
    return base_transmittance(b, cosine);
}
#endif

// Approximate reflectance of the diffuse lobe for uniform light, used as the lobe's probability; `cosine`: between
// wo and the normal.
float diffuse_importance(Bsdf b, float cosine)
{
    float share = mean(b.diffuse + b.specular);
#ifdef HAS_MICROFACETS
    share *= base_response(b, cosine) * under_layers(b, cosine);
#endif
#ifdef HAS_SHEEN
    share += mean(b.sheen) * min(sheen_albedo(b, cosine), 1.0) * (1.0 - coat_takes(b, cosine));
#endif
    return share;
}

// Reflectance of the diffuse lobe, base and sheen, for uniform light; `cosine`: between wo and the normal.
vec3 diffuse_reflectance(Bsdf b, float cosine)
{
    vec3 sent = b.diffuse;
#ifdef HAS_MICROFACETS
    sent *= base_response(b, cosine) * under_layers(b, cosine);
#endif
#ifdef HAS_SHEEN
    sent += b.sheen * (min(sheen_albedo(b, cosine), 1.0) * (1.0 - coat_takes(b, cosine)));
#endif
    return sent;
}

#ifdef HAS_DIFFUSE_TRANSMISSION
// Transmittance of the diffuse lobe to the other side; `cosine`: between wo and the normal.
vec3 diffuse_transmittance(Bsdf b, float cosine)
{
    return b.diffuse_through * (base_transmittance(b, cosine) * under_layers(b, cosine));
}
#endif

// Albedo for a denoiser: approximately the fraction of uniform light that is reflected or transmitted.
vec3 bsdf_albedo(Bsdf b)
{
    vec3 all = b.diffuse;
#ifdef HAS_MIRRORS
    all += b.mirror;
#endif
#ifdef HAS_MICROFACETS
    all += b.metal + b.layered * b.dielectric + b.transmission;
#endif
#ifdef HAS_DIFFUSE_TRANSMISSION
    all += b.diffuse_through;
#endif
#ifdef HAS_SHEEN
    float share = min(sheen_albedo(b, 0.5), 1.0);
    all = all * (1.0 - share * max(b.sheen.r, max(b.sheen.g, b.sheen.b))) + share * b.sheen;
#endif
    return all;
}

// Reflectance of mirrors for light from the mirror direction: of the mirror lobe, of smooth microfacets, and of a
// smooth clearcoat unless it has its own normals.
vec3 mirrored(Bsdf b, float cosine)
{
    vec3 share = b.mirror;
#ifdef HAS_MICROFACETS
    if (max(b.alpha.x, b.alpha.y) < SMOOTH) share += microfacet_reflects(b, cosine) * under_layers(b, cosine);
#if defined(HAS_COAT) && !defined(HAS_COAT_NORMALS)
    if (b.coat_alpha < SMOOTH) share += coat_takes(b, cosine);
#endif
#endif
    return share;
}

#ifdef HAS_COAT_NORMALS
// Reflectance of a smooth clearcoat with its own normals, whose mirror direction differs.
float coat_mirrored(Bsdf b)
{
    return b.coat_alpha < SMOOTH ? coat_reflects(b, b.coat_cosine) : 0.0;
}
#endif

// BRDF of the diffuse lobe: base, sheen and Phong's highlight. The highlight is defined without a cosine, so it is
// divided by the cosine here.
vec3 diffuse_eval(Bsdf b, vec3 n, vec3 wo, vec3 wi)
{
    vec3 f = b.diffuse;
#ifdef HAS_MICROFACETS
    f *= base_response(b, n, wo, wi) * under_layers(b, dot(n, wo));
#endif
#ifdef HAS_SHEEN
    f += sheen_eval(b, n, wo, wi);
#endif
#ifdef HAS_HIGHLIGHTS
    float highlight = pow(max(dot(reflect(-wo, n), wi), 1e-20), b.exponent);
    f += b.specular * (highlight / max(dot(n, wi), 1e-4));
#endif
    return f;
}

#ifdef HAS_MICROFACETS
// Value of a lobe, and the density per solid angle of its sampling.
struct Lobe
{
    vec3 f;
    float pdf;
};

// Returns the surface's axes as columns: along the tangent, across it, and the shading normal.
mat3 surface_axes(Bsdf b, vec3 n)
{
    vec3 x, y;
    axes_across(n, x, y);
#ifdef HAS_ANISOTROPY
    vec3 along = b.tangent - dot(b.tangent, n) * n;
    if (dot(along, along) > 1e-8) {
        x = normalize(along);
        y = cross(n, x);
    }
#endif
    return mat3(x, y, n);
}

// Fraction that is reflected of all the light that microfacets reflect or transmit.
float reflected_part(Bsdf b, float cosine)
{
    float reflected = mean(microfacet_reflects(b, cosine)), through = mean(glass_transmittance(b, cosine));
    return through > 0.0 ? reflected / max(reflected + through, 1e-9) : 1.0;
}

// Value and density of microfacets; wo and wi are in the surface's own axes. Both are 0 for smooth microfacets,
// because no light sample lies exactly in the mirror direction.
Lobe microfacet_lobe(Bsdf b, vec3 wo, vec3 wi)
{
    if (max(b.alpha.x, b.alpha.y) < SMOOTH || wi.z <= 0.0 || wo.z <= 0.0) return Lobe(vec3(0.0), 0.0);
    vec3 m = normalize(wo + wi);
    float cosine = dot(wo, m), D = normal_density(m, b.alpha, IS_BECKMANN(b)), seen = masking(wo, b.alpha, IS_BECKMANN(b));
    vec3 F = microfacet_reflects(b, cosine) * under_layers(b, wo.z);
    float f = PI * D * seen * masking(wi, b.alpha, IS_BECKMANN(b)) / (4.0 * wo.z * wi.z);
    return Lobe(F * f, reflected_part(b, cosine) * seen * D / (4.0 * wo.z));
}

#ifdef HAS_GLASS
// Returns true if the indices of both sides are equal, or nearly. All microfacets then send light straight on,
// however rough the boundary is, so directions have no density. Nearly equal indices bend light by less than a
// thousandth, and the half vector in through_lobe() would be only rounding.
bool is_unbent(Bsdf b)
{
    return abs(b.eta - 1.0) < 1e-3;
}

#ifdef HAS_ROUGH_TRANSMISSION
bool is_rough_transmission(Bsdf b)
{
    float largest = max(b.transmission.r, max(b.transmission.g, b.transmission.b));
    return !is_unbent(b) && largest > 0.0 && max(b.alpha.x, b.alpha.y) >= SMOOTH;
}

// Lobe for light from the other side of glass, wi.z < 0. A thin dielectric transmits the mirror image of what it
// would reflect. A solid uses Walter et al., eq. 16, for radiance over the squared index. This equals radiance at
// both ends of a path, which lie in air.
Lobe through_lobe(Bsdf b, vec3 wo, vec3 wi)
{
    if (!is_rough_transmission(b) || wi.z >= 0.0 || wo.z <= 0.0) return Lobe(vec3(0.0), 0.0);
    bool thin = b.eta <= 0.0;
    vec3 m = normalize(thin ? wo + vec3(wi.xy, -wi.z) : wo + b.eta * wi);
    if (m.z < 0.0) m = -m;
    float o = dot(wo, m), i = thin ? o : -dot(wi, m);
    if (o <= 0.0 || i <= 0.0) return Lobe(vec3(0.0), 0.0);
    float spread = thin ? 0.25 / o : b.eta * b.eta * i / max((o - b.eta * i) * (o - b.eta * i), 1e-9);
    float pdf = visible_normal_pdf(wo, m, b.alpha, IS_BECKMANN(b)) * spread;
    vec3 T = glass_transmittance(b, o) * under_layers(b, wo.z);
    float f = PI * masking(wi, b.alpha, IS_BECKMANN(b)) * pdf / max(-wi.z, 1e-6);
    return Lobe(T * f, (1.0 - reflected_part(b, o)) * pdf);
}
#endif
#endif

// Axes of the clearcoat, which is isotropic; `axes`: those of the base.
mat3 coat_axes(Bsdf b, mat3 axes)
{
#ifdef HAS_COAT_NORMALS
    vec3 x, y;
    axes_across(b.coat_normal, x, y);
    return mat3(x, y, b.coat_normal);
#else
    return axes;
#endif
}

// Value and density of the clearcoat; wo and wi are in the clearcoat's own axes.
Lobe coat_lobe(Bsdf b, vec3 wo, vec3 wi)
{
#ifdef HAS_COAT
    if (b.coat <= 0.0 || b.coat_alpha < SMOOTH || wi.z <= 0.0 || wo.z <= 0.0) return Lobe(vec3(0.0), 0.0);
    vec3 m = normalize(wo + wi);
    vec2 alpha = vec2(b.coat_alpha);
    float D = ggx(m, alpha), seen = ggx_seen(wo, alpha);
    float f = PI * D * seen * ggx_seen(wi, alpha) / (4.0 * wo.z * wi.z);
    return Lobe(vec3(coat_reflects(b, dot(wo, m)) * f), seen * D / (4.0 * wo.z));
#else
    return Lobe(vec3(0.0), 0.0);
#endif
}
#endif

// BRDF of all lobes except mirrors and smooth microfacets.
vec3 bsdf_eval(Bsdf b, vec3 n, vec3 wo, vec3 wi)
{
    vec3 f = diffuse_eval(b, n, wo, wi);
#ifdef HAS_MICROFACETS
    mat3 axes = surface_axes(b, n);
    vec3 o = wo * axes, i = wi * axes;
#ifdef HAS_COAT_NORMALS
    mat3 over = coat_axes(b, axes);
    f += microfacet_lobe(b, o, i).f + coat_lobe(b, wo * over, wi * over).f;
#else
    f += microfacet_lobe(b, o, i).f + coat_lobe(b, o, i).f;
#endif
#endif
    return f;
}
