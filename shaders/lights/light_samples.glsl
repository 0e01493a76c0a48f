// light_samples.glsl: light from points of emitting shapes and directions of the sky, the same for all pixels of a path set.
// The light samples are those of the path-buffer (`glpath.lighting`), so the engines use the same lights in a set.
// Needs:  <CONSTANTS>; LIGHT_SAMPLES: number of light samples
// Units:  radiance W sr^-1 m^-2; densities per area, or per solid angle for the sky.
uniform vec3 sample_position[LIGHT_SAMPLES];   // position of each light sample; for the sky, the unit direction towards it
uniform vec4 sample_normal[LIGHT_SAMPLES];     // unit normal of the emitting side; w: 1 for the sky
uniform vec3 sample_radiance[LIGHT_SAMPLES];   // radiance divided by pi, by the density and by the number of samples

struct Incident
{
    vec3 wi;
    float distance;  // distance to the light sample, infinite for the sky
    vec3 E;          // irradiance divided by pi; 0 if the light faces away
};

Incident light_sample(int i, vec3 position, vec3 normal)
{
    vec4 facing = sample_normal[i];
    vec3 to_light = sample_position[i] - (facing.w != 0.0 ? vec3(0.0) : position);
    float r2 = max(dot(to_light, to_light), 1e-37), r = sqrt(r2);
    vec3 wi = to_light / r;
    float cosine = max(dot(normal, wi), 0.0);
    if (facing.w != 0.0) return Incident(wi, 3e38, sample_radiance[i] * cosine);
    return Incident(wi, r, sample_radiance[i] * (cosine * max(-dot(facing.xyz, wi), 0.0) / r2));
}
