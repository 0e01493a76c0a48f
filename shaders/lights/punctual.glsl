// punctual.glsl: irradiance from a point light, a spot or a directional light; `glpath.lights.samples.incident` is the same on
// the CPU.
// Units:  W m^-2 on an unoccluded surface that faces the light.
//   intensity  W sr^-1, or W m^-2 without falloff; for a light with a profile, a factor on the profile
//              (profile.glsl)
//   quadratic  true if irradiance falls off with the square of the distance
//   cone       cosines of a spot's inner angle, where its full light ends, and its outer angle, where all its light
//              ends
//   cosine     cosine of the angle between the direction and the spot's axis
// Between these angles, light fades as the square of the cosine's relative position between the two cosines
// [KHR_lights_punctual].
vec3 punctual_irradiance(vec3 intensity, bool quadratic, float square_distance, bool spot, vec2 cone, float cosine)
{
    vec3 E = intensity / (quadratic ? max(square_distance, 1e-37) : 1.0);
    if (!spot) return E;
    float share = clamp((cosine - cone.y) / (cone.x - cone.y), 0.0, 1.0);
    return E * (cone.x > cone.y ? share * share : float(cosine >= cone.y));
}
