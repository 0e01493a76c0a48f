// light_sample.glsl: unoccluded light of a light sample (`glpath.lights.samples.LightSample`) at a point, and its MIS weight
// against the direction in which a path continues [PB A.3].
// Needs:  <CONSTANTS>; HAS_POSITIONAL_LIGHTS, HAS_DISTANT_LIGHTS, HAS_SKY: if the scene has them
// Units:  radiance W sr^-1 m^-2; densities per area, or per solid angle for the sky.
// angles.glsl is included outside the condition, because a file is included only once, and sky.glsl may need it
// without the condition's includes.
#include "sampling/angles.glsl"
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
#include "lights/punctual.glsl"
#include "lights/profile.glsl"
#endif
#ifdef HAS_SKY
#include "lights/sky.glsl"
uniform float sky_pdf_scale;

// Density of light samples in this direction, per solid angle.
float sky_pdf(vec3 direction)
{
    return dot(sky(direction), vec3(sky_pdf_scale));
}
#endif

// Density per solid angle with which a path leaves its surface in a direction; 0 if only light samples count.
// cosine: between direction and surface normal; views: number of directions that the path can choose from.
float direction_pdf(float cosine, int views)
{
#if defined(WHOLE_SPHERE)
    return 0.0;
#else
    return views == 2 ? cosine / PI : 0.5 / PI;
#endif
}

// Veach's power heuristic: weight of a sample drawn with density a that density b could also have drawn.
float power_heuristic(float a, float b)
{
    float a2 = a * a, b2 = b * b;
    return a2 / max(a2 + b2, 1e-37);
}

// MIS weight of a light sample against the continuing path [Veach]. pdf: density of the sample per solid angle;
// cosine: at the lit surface; views: number of directions that the path can choose from. Without any (0) the weight
// is 1, because the path ends and no other sample has this light.
float mis_weight_light(float pdf, float cosine, int views)
{
    return views == 0 ? 1.0 : power_heuristic(pdf, direction_pdf(cosine, views));
}

// MIS weight of emission that a sampled direction has found, without which emission would count twice. pdf: density
// of the direction per solid angle; pdf_area: density of light samples per area of the emitter; t: distance;
// cosine: at the emitter.
float emission_share(float pdf, float pdf_area, float t, float cosine)
{
    return power_heuristic(pdf, pdf_area * t * t / max(abs(cosine), 1e-9));
}

// Fraction of the segment between light and surface, at its end, in which occluders are ignored because of
// rounding.
const float ROUNDING = 1e-5;

struct LightSample
{
    vec3 position;
    vec3 normal;     // normal of the emitting side, axis of a spot, or direction of parallel light
    vec3 radiance;   // radiance, or intensity of a punctual light
    float pdf;
    uint kind;       // kind of light, LIGHT_AREA or another
    vec2 cone;       // cone of a spot, see punctual.glsl
    bool quadratic;
#ifdef HAS_PROFILES
    int profile;     // index of the photometric profile, -1 for none
#endif
};

struct DirectLight
{
    vec3 wi;         // unit direction towards the light
    vec3 light;      // radiance of a white Lambertian surface lit by the light, divided by the sample's density
    float distance;  // distance to the light
    bool distant;    // true if the light is infinitely far
    float pdf;   // density per solid angle; 0 for a punctual light
};

// Returns the unoccluded light of a sample at a position. `normal` is on the lit side; views: see mis_weight_light.
DirectLight light_from(LightSample l, vec3 position, vec3 normal, int views)
{
    vec3 w = l.position - position;
    DirectLight found = DirectLight(vec3(0.0), vec3(0.0), 0.0, false, 0.0);
#ifdef HAS_DISTANT_LIGHTS
    found.distant = l.kind == LIGHT_DIRECTIONAL || l.kind == LIGHT_SKY;
    if (found.distant) w = -l.normal;
#endif
    float r2 = dot(w, w);
    vec3 wi = w * inversesqrt(r2);
    float cos_surface = dot(normal, wi);
    float cos_light = -dot(l.normal, wi);
    if (cos_surface <= 0.0 || r2 == 0.0) return found;
    found.wi = wi;
    found.distance = sqrt(r2);
#if defined(HAS_POSITIONAL_LIGHTS) || defined(HAS_DISTANT_LIGHTS)
    if (l.kind != LIGHT_AREA) {
        bool spot = l.kind == LIGHT_SPOT, fades = l.quadratic && !found.distant;
        vec3 E = punctual_irradiance(l.radiance, fades, r2, spot, l.cone, cos_light);
#ifdef HAS_PROFILES
        if (l.profile >= 0) E *= profile_intensity(l.profile, -wi);
#endif
        // A punctual light has the MIS weight 1, because no sampled direction hits it.
        float share = l.kind == LIGHT_SKY ? mis_weight_light(l.pdf, cos_surface, views) : 1.0;
        found.light = E * (share * cos_surface / (PI * l.pdf));
        found.pdf = l.kind == LIGHT_SKY ? l.pdf : 0.0;
        return found;
    }
#endif
    if (cos_light <= 0.0) return found;
    float g = cos_surface * cos_light / r2;
    found.pdf = l.pdf * r2 / cos_light;
    float share = mis_weight_light(found.pdf, cos_surface, views);
    found.light = l.radiance * (share * g / (PI * l.pdf));
    return found;
}
