// bsdf_read.frag: what shaders/scene/surface.glsl makes of a scene's first shape, for the tests: the numbers that
// bsdf_probe.comp takes, in its order, four a pixel.
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"

uniform int from_front;
out vec4 four;

const int PARAMETERS = 68;
float parameters[PARAMETERS];

void put(int i, vec3 colour)
{
    parameters[i] = colour.r;
    parameters[i + 1] = colour.g;
    parameters[i + 2] = colour.b;
}

void main()
{
    Bsdf b = bsdf_at(surface_of_shape(0, vec3(0.0), vec3(0.0, 0.0, 1.0)), from_front != 0);
    for (int i = 0; i < PARAMETERS; i++) parameters[i] = 0.0;
    put(0, b.diffuse);
    put(3, b.specular);
    parameters[6] = b.exponent;
    parameters[16] = parameters[17] = 1.0;
#ifdef HAS_MICROFACETS
    put(7, b.metal);
    parameters[10] = b.metallic;
    put(11, b.dielectric);
    parameters[14] = b.grazing;
    parameters[15] = b.layered;
    parameters[16] = b.alpha.x;
    parameters[17] = b.alpha.y;
    parameters[18] = b.coat;
    parameters[19] = b.coat_alpha;
    put(20, b.transmission);
    parameters[23] = b.eta;
#endif
    parameters[27] = 1.0;
#ifdef HAS_SHEEN
    put(24, b.sheen);
    parameters[27] = b.sheen_alpha;
    for (int k = 0; k < 8; k++) parameters[28 + k] = b.sheen_albedo[k / 4][k % 4];
    for (int k = 0; k < 4; k++) parameters[36 + k] = b.sheen_lambda[k];
    parameters[40] = b.sheen_lambda_a;
#endif
#ifdef HAS_BECKMANN
    parameters[41] = b.is_beckmann ? 1.0 : 0.0;
#endif
#ifdef HAS_FRESNEL
    parameters[42] = b.ior;
    parameters[43] = float(b.layering);
    put(44, b.tint);
#ifdef HAS_PLASTIC
    for (int k = 0; k < 8; k++) parameters[47 + k] = b.entry[k / 4][k % 4];
    parameters[55] = b.entry_mean;
#endif
#endif
#ifdef HAS_METAL_INDICES
    put(56, b.metal_n);
    put(59, b.metal_k);
    put(62, b.metal_tint);
#endif
    int i = 4 * int(gl_FragCoord.x);
    four = vec4(parameters[i], parameters[i + 1], parameters[i + 2], parameters[i + 3]);
}
