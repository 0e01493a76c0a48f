// shadow_rays.glsl: rays from a point of a surface to the lights that may reach it. Rays are numbered: one for each
// punctual light, then LIGHT_SAMPLES to points of emitting shapes and directions of the sky. Also the ray from a
// ground that catches shadows.
// Needs:  <SCENE>, <CONSTANTS>, camera.glsl; the needs of light_samples.glsl, punctual.glsl, profile.glsl, ground.glsl
#ifdef LIGHT_SAMPLES
#include "lights/light_samples.glsl"
#endif
#include "lights/punctual.glsl"
#include "lights/profile.glsl"
#ifdef HAS_GROUND
#include "sampling/random.glsl"
#include "lights/ground.glsl"
#endif

struct PunctualRay
{
    vec3 wi;      // unit direction to the light
    float tmax;   // distance just before the light
    vec3 E;       // irradiance by the light
    bool distant; // true if the light has no position
};

PunctualRay punctual_ray(int light, vec3 position)
{
    vec3 axis = light_texel(light, LIGHT_DIRECTION).xyz;
    uvec3 punctual = punctual_texel(light, PUNCTUAL_KIND).xyz;
    uint kind = punctual.x;
    vec3 to_light = kind == LIGHT_DIRECTIONAL ? -axis : light_texel(light, LIGHT_POSITION).xyz - position;
    float square = dot(to_light, to_light), distance = sqrt(square);
    PunctualRay ray;
    ray.wi = to_light / max(distance, 1e-37);
    ray.distant = kind == LIGHT_DIRECTIONAL;
    ray.tmax = ray.distant ? NO_HIT : distance * (1.0 - RAY_ROUNDING);
    bool spot = kind == LIGHT_SPOT;
    vec2 cone = spot ? light_texel(light, LIGHT_CONE).xy : vec2(0.0);
    vec3 intensity = light_texel(light, LIGHT_INTENSITY).rgb;
    ray.E = punctual_irradiance(intensity, punctual.y != 0u, square, spot, cone, -dot(ray.wi, axis));
#ifdef HAS_PROFILES
    if (punctual.z != 0u) ray.E *= profile_intensity(int(punctual.z) - 1, -ray.wi);
#endif
    return ray;
}

#ifdef LIGHT_SAMPLES
float sample_tmax(Incident light) { return min(light.distance * (1.0 - RAY_ROUNDING), NO_HIT); }
#endif

bool is_lit(vec3 E) { return max(E.r, max(E.g, E.b)) > 0.0; }

// Distance from the surface at which rays from a point begin. t: distance along the ray that has hit the point;
// rounding: minimum.
float rounding_at(vec3 position, float t, float rounding)
{
    vec3 size = abs(position);
    return max(rounding, RAY_ROUNDING * (t + max(size.x, max(size.y, size.z))));
}

float rounding_of(vec3 origin) { return RAY_ROUNDING * max(abs(origin.x), max(abs(origin.y), abs(origin.z))); }

#ifdef HAS_GROUND
// Returns true if the eye's ray through a pixel hits the ground. Sets the shadow ray: its start at this hit, and
// its direction.
bool ground_shadow_ray(ivec2 pixel, vec3 origin, vec3 direction, out vec3 start, out vec3 to_light)
{
    ivec2 of_image = pixel + eye_corner;
    uint chance = pcg(uint(of_image.x) + (uint(of_image.y) << 16u));
    return ground_ray(origin, direction, chance, start, to_light);
}
#endif
