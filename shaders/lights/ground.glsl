// ground.glsl: where an eye ray that hits no shape meets the ground that catches shadows; see
// `glpath.integrators.ground`.
// Needs:  random.glsl; GROUND_LIGHTS: number of directions; RAY_ROUNDING
uniform vec4 ground;  // unit normal of the ground; w: distance of the ground from the origin along it
// Directions to the sky's light, distributed by their irradiance on the ground.
uniform vec3 ground_lights[GROUND_LIGHTS];

// Sets the shadow ray from the ground, in one of the directions of ground_lights; returns false if the eye's ray
// misses the ground. chance: selects the direction; a different number for each pixel
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
