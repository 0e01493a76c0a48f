// punctual.glsl: irradiance from a point light, a spot or a directional light; `glpath.light_samples.incident` is the same on
// the CPU.
// Units:  W m^-2 on an unoccluded surface that faces the light.
//   intensity  W sr^-1, or W m^-2 without falloff; for a light with a profile (profile.glsl) a factor of it
//   quadratic  true if it falls off with the square of the distance
//   cone       of a spot: cosines of the angles at which full light and all light end; `cosine`: of the angle to its axis
vec3 punctual_irradiance(vec3 intensity, bool quadratic, float square_distance, bool spot, vec2 cone, float cosine)
{
    vec3 E = intensity / (quadratic ? max(square_distance, 1e-37) : 1.0);
    if (spot) E *= cone.x > cone.y ? smoothstep(cone.y, cone.x, cosine) : float(cosine >= cone.y);
    return E;
}
