// bsdf_probe.comp: what shaders/bsdf.glsl says of a surface and pairs of directions, lobe by lobe, for the tests.
// Frame:  the surface's own: z is the normal, x goes along the brush.
// Units:  f in those of a white Lambertian surface, 1 / pi; densities per solid angle.
#include <CONSTANTS>
#define HAS_HIGHLIGHTS 1
#define HAS_MIRRORS 1
#define HAS_MICROFACETS 1
#define HAS_COAT 1
#define HAS_GLASS 1
#define HAS_GLASS_SPECULAR 1
#define HAS_ROUGH_TRANSMISSION 1
#define HAS_ANISOTROPY 1
#define HAS_SHEEN 1
#define HAS_FRESNEL 1
#define HAS_PLASTIC 1
#define HAS_DISNEY 1
#define HAS_METAL_INDICES 1
#define HAS_BECKMANN 1
#include "bsdf/bsdf.glsl"

layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Surface { float parameters[]; };
layout(std430, binding = 1) readonly buffer Pairs { vec4 pairs[]; };      // wo; wi
layout(std430, binding = 2) writeonly buffer Found { vec4 found[]; };     // f and density of LOBES lobes

const int LOBES = 6;
const vec3 N = vec3(0.0, 0.0, 1.0);

vec3 colour(int i) { return vec3(parameters[i], parameters[i + 1], parameters[i + 2]); }

void main()
{
    int i = int(gl_GlobalInvocationID.x);
    if (2 * i >= pairs.length()) return;
    Bsdf b = lambertian(colour(0));
    b.specular = colour(3);
    b.exponent = parameters[6];
    b.metal = colour(7);
    b.metallic = parameters[10];
    b.dielectric = colour(11);
    b.grazing = parameters[14];
    b.layered = parameters[15];
    b.alpha = vec2(parameters[16], parameters[17]);
    b.tangent = vec3(1.0, 0.0, 0.0);
    b.coat = parameters[18];
    b.coat_alpha = parameters[19];
    b.transmission = colour(20);
    b.eta = parameters[23];
    b.sheen = colour(24);
    b.sheen_alpha = parameters[27];
    for (int k = 0; k < 8; k++) b.sheen_albedo[k / 4][k % 4] = parameters[28 + k];
    for (int k = 0; k < 4; k++) b.sheen_lambda[k] = parameters[36 + k];
    b.sheen_lambda_a = parameters[40];
    b.is_beckmann = parameters[41] != 0.0;
    b.ior = parameters[42];
    b.layering = int(parameters[43]);
    b.tint = colour(44);
    for (int k = 0; k < 8; k++) b.entry[k / 4][k % 4] = parameters[47 + k];
    b.entry_mean = parameters[55];
    b.metal_n = colour(56);
    b.metal_k = colour(59);
    b.metal_tint = colour(62);
    vec3 wo = pairs[2 * i].xyz, wi = pairs[2 * i + 1].xyz;
    mat3 axes = surface_axes(b, N);
    Lobe base = microfacet_lobe(b, wo * axes, wi * axes), coat = coat_lobe(b, wo * axes, wi * axes);
    Lobe through = through_lobe(b, wo * axes, wi * axes);
    bool above = wi.z > 0.0;
    found[LOBES * i] = above ? vec4(diffuse_eval(b, N, wo, wi), wi.z / PI) : vec4(0.0);
    found[LOBES * i + 1] = vec4(base.f, base.pdf);
    found[LOBES * i + 2] = vec4(coat.f, coat.pdf);
    found[LOBES * i + 3] = vec4(through.f, through.pdf);
    found[LOBES * i + 4] = above ? vec4(bsdf_eval(b, N, wo, wi), 0.0) : vec4(0.0);
    found[LOBES * i + 5] = vec4(mirrored(b, wo.z), coat_reflects(b, wo.z));
}
