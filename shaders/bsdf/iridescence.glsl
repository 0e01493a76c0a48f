// iridescence.glsl: reflectance of a thin film over a surface, by interference of light reflected at the film's two
// faces.
// Units:  thickness nm; reflectance linear Rec. 709.
// Source: Belcour & Barla 2017, A practical extension to microfacet theory for the modeling of varying iridescence;
//         with Schlick's Fresnel, as in Khronos' sample renderer [KHR_materials_iridescence];
//         glpath/scene/iridescence.py computes the same.

// Fourier transform of the eye's spectral sensitivities, which are approximated by Gaussians of the wave number.
// path: optical path difference, nm; shift: phase shift for each channel. Returns linear Rec. 709.
vec3 film_sensitivity(float path, vec3 shift)
{
    float phase = 2e-9 * PI * path, square = phase * phase;
    // Peak of each Gaussian times sqrt(2 pi variance), divided by the integral of the Y sensitivity.
    const vec3 weight = vec3(0.846590, 1.000222, 1.001122);
    const vec3 centre = vec3(1.6810e6, 1.7953e6, 2.2084e6), variance = vec3(4.3278e9, 9.3046e9, 6.6121e9);
    vec3 xyz = weight * cos(centre * phase + shift) * exp(-square * variance);
    xyz.x += 0.153868 * cos(2.2399e6 * phase + shift.x) * exp(-square * 4.5282e9);
    return mat3(3.2404542, -0.9692660, 0.0556434, -1.5371385, 1.8760108, -0.2040259, -0.4985314, 0.0415560, 1.0572252) * xyz;
}

vec3 film_schlick(vec3 f0, float cosine)
{
    return f0 + (1.0 - f0) * schlick(cosine);
}

// f0: reflectance in air of the surface under the film, at normal incidence.
vec3 film_reflects(float cosine, float thickness, float ior, vec3 f0)
{
    float index = mix(1.0, ior, smoothstep(0.0, 0.03, thickness));
    float inside = sqrt(max(1.0 - (1.0 - cosine * cosine) / (index * index), 0.0));
    float first = (index - 1.0) / (index + 1.0), R12 = first * first + (1.0 - first * first) * schlick(cosine);
    vec3 root = sqrt(clamp(f0, 0.0, 0.9999)), base = (1.0 + root) / (1.0 - root), second = (base - index) / (base + index);
    vec3 R23 = film_schlick(second * second, inside), phase = PI + PI * vec3(lessThan(base, vec3(index)));
    vec3 R123 = clamp(R12 * R23, 1e-5, 0.9999), r = sqrt(R123);
    float T = 1.0 - R12, path = 2.0 * index * thickness * inside;
    vec3 Rs = T * T * R23 / (1.0 - R123), C = (Rs - T) * r;
    vec3 found = R12 + Rs + C * (2.0 * film_sensitivity(path, phase));
    found += C * r * (2.0 * film_sensitivity(2.0 * path, 2.0 * phase));
    return clamp(found, 0.0, 1.0);
}
