// slab.glsl: reflectance and transmittance of a glass sheet between two faces, with all reflections between them.
// `glpath.scene.slab` is the same on the CPU.
// Needs:  nothing.
// Units:  fractions; `cosine` is that of the angle in air; `inside` is the transmittance of one pass straight through the
//         glass.
// Source: Hecht 2017, Optics, 4.6 and 9.6.1, for beams that do not interfere; Ward, Radiance: glass.

// Returns the transmittance, and sets the reflectance.
vec3 slab(float cosine, float ior, vec3 inside, out vec3 reflected)
{
    cosine = max(cosine, 1e-4);
    float within = sqrt(1.0 - (1.0 - cosine * cosine) / (ior * ior));
    vec2 f = vec2((cosine - ior * within) / (cosine + ior * within), (ior * cosine - within) / (ior * cosine + within));
    f *= f;  // reflectances of both polarizations
    vec3 once = pow(inside, vec3(1.0 / within)), twice = once * once, passed = vec3(0.0);
    reflected = vec3(0.0);
    for (int k = 0; k < 2; ++k)
    {
        vec3 between = 1.0 / max(1.0 - f[k] * f[k] * twice, 1e-9);
        passed += (0.5 * (1.0 - f[k]) * (1.0 - f[k])) * once * between;
        reflected += 0.5 * f[k] * (1.0 + (1.0 - 2.0 * f[k]) * twice) * between;
    }
    return passed;
}
