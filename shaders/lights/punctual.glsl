// punctual.glsl: irradiance from a point light, a spot or a directional light; `glpath.light_samples.incident` is
// the same on the CPU.
// Units:  W m^-2 on a surface that faces the light, nothing between.
//   intensity  W sr^-1, or W m^-2 where it does not fall off; of a light with a profile (profile.glsl) what multiplies it
//   quadratic  it falls off with the square of the distance
//   cone       of a spot: cosines of the angles of full light and of its end; `cosine` that of the angle to its axis.
//              Between them it fades with the square of the cosine's share [KHR_lights_punctual]
vec3 punctual_irradiance(vec3 intensity, bool quadratic, float square_distance, bool spot, vec2 cone, float cosine)
{
    vec3 E = intensity / (quadratic ? max(square_distance, 1e-37) : 1.0);
    if (!spot) return E;
    float share = clamp((cosine - cone.y) / (cone.x - cone.y), 0.0, 1.0);
    return E * (cone.x > cone.y ? share * share : float(cosine >= cone.y));
}
