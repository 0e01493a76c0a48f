// ground.glsl: where a ray of the eye that meets no shape meets the ground that catches shadows, `glpath.integrators.ground`.
// Needs:  random.glsl; GROUND_LIGHTS; RAY_ROUNDING
uniform vec4 ground;                        // its unit normal, and how far along that it is
uniform vec3 ground_lights[GROUND_LIGHTS];  // directions, as dense as the light that they bring to the ground

// The ray from there to the light, by one direction of the set; false where the eye's ray meets no ground.
// chance: which direction, another number for each pixel
bool ground_ray(vec3 origin, vec3 direction, uint chance, out vec3 start, out vec3 to_light)
{
    float cosine = dot(ground.xyz, direction), height = dot(ground.xyz, origin) - ground.w;
    to_light = ground_lights[chance % uint(GROUND_LIGHTS)];
    float t = height / max(-cosine, 1e-37);
    start = origin + t * direction;
    vec3 far = abs(start);
    start += RAY_ROUNDING * (t + max(far.x, max(far.y, far.z))) * ground.xyz;
    return cosine < 0.0 && height > 0.0;
}
