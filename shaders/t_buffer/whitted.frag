// whitted.frag: computes a pixel's radiance from the primitive that the eye sees [TB IV].
// Needs:  <SCENE>; BY_BVH: secondary rays use the BVH, otherwise the classical algorithm; SHADOW_BUFFERS: lights
//         with a position are looked up (point_shadow.glsl), otherwise a ray is shot; STREAM_SHADOWS: streamed
//         triangles block rays too (stream_shadows.glsl); REFLECTIONS: the scene has reflections. (Without them, no
//         loop may contain mirror rays, because llvmpipe runs the body of a loop once even if no pixel enters it.)
// Units:  radiance W sr^-1 m^-2, linear Rec. 709.
//
//   L = ambient rho + emission + sum over lights of (rho cos + specular max(r . v, 0)^exponent) E / pi + mirror L(r)
// Lights are punctual lights, points of emitting shapes and directions of the sky. LIGHT_SAMPLES is the number of
// the latter two.
#include <SCENE>
#include "scene/surface_at.glsl"
#include "camera/camera.glsl"
#include "t_buffer/eye_hit.glsl"
#include "scene/object_classic.glsl"
#ifdef BY_BVH
#include "scene/object_bvh.glsl"
#endif
#include "film/accumulate.glsl"
#if defined(REFLECTIONS) && defined(HAS_COAT_NORMALS)
#include "sampling/random.glsl"
#endif
#include "t_buffer/shadow_rays.glsl"
#include "t_buffer/stream_shadows.glsl"
#include "lights/sky.glsl"
#include "lights/background.glsl"
#ifdef SHADOW_BUFFERS
#include "shadow/point_shadow.glsl"
#endif

UINT_TEXELS(rg32ui, eye_buffer);  // number of the primitive + 1, and bits of t
uniform int max_depth;         // maximum number of surfaces between light and eye
uniform vec3 ambient;

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };  // counts for shadow rays and secondary rays
#endif

#ifdef HAS_ALPHA
uint rays_cast = 0u;  // number of rays cast for the pixel so far
#endif

// Point of a surface that a ray of the pixel has hit.
struct Shaded
{
    int primitive;
    Surface surface;
    bool front;
    vec3 normal;     // geometric normal on the visible side
    vec3 n;          // shading normal
    float vertex_cosine;
    Bsdf bsdf;
    vec3 wo;         // unit direction back along the ray
    float rounding;  // distance from the surface at which secondary rays begin
};

Shaded shaded_at(int primitive, ivec2 pixel, vec3 origin, vec3 direction, float t, float rounding)
{
    Shaded at;
    at.primitive = primitive;
    at.surface = surface_seen(primitive, pixel, origin, direction, t);
    at.front = front_hit(at.surface.normal, direction);
    at.normal = at.front ? at.surface.normal : -at.surface.normal;
    at.wo = -direction;
    at.n = shading_normal(at.surface, at.front, at.wo);
    at.vertex_cosine = vertex_cosine(at.surface, at.front, at.wo);
    at.bsdf = bsdf_seen(at.surface, at.front, at.wo);
    at.rounding = rounding_at(at.surface.position, t, rounding);
    return at;
}

// Gives the pixel's next ray its own random number for blended surfaces.
void begin_ray()
{
#ifdef HAS_ALPHA
    new_opacity_key(ivec2(gl_FragCoord.xy) + eye_corner, ++rays_cast);
#endif
}

bool is_blocked(int ray, vec3 origin, vec3 direction, float tmin, float tmax, int exclude)
{
    begin_ray();
    bool blocked = blocked_by_stream(ivec2(gl_FragCoord.xy), ray);
#ifdef BY_BVH
    return blocked || blocked_by_bvh(origin, direction, tmin, tmax, exclude);
#else
    return blocked || blocked_classic(origin, direction, tmin, tmax, exclude);
#endif
}

// ray: number of the ray, see shadow_rays.glsl
bool shadow_ray_blocked(Shaded at, int ray, vec3 wi, float tmax)
{
    return is_blocked(ray, at.surface.position, wi, at.rounding, tmax, at.primitive);
}

// Light that the eye sees behind all shapes: the background, and on a ground that catches shadows the shadow of the
// shapes.
vec3 seen_by_eye(vec3 origin, vec3 direction)
{
    vec3 light = seen_behind(direction);
#ifdef HAS_GROUND
    vec3 start, to_light;
    if (ground_shadow_ray(ivec2(gl_FragCoord.xy), origin, direction, start, to_light)
        && is_blocked(0, start, to_light, 0.0, NO_HIT, -1)) light = vec3(0.0);
#endif
    return light;
}

// Radiance towards wo from the punctual lights.
vec3 light_from_lights(Shaded at)
{
    vec3 sum = vec3(0.0);
    for (int light = 0; light < light_count; ++light)
    {
        PunctualRay ray = punctual_ray(light, at.surface.position);
        vec3 wi = ray.wi;
        float cosine = dot(at.normal, wi);
        bool reaches = cosine > 0.0 && is_lit(ray.E);
        float visible = reaches ? 1.0 : 0.0;
#ifdef SHADOW_BUFFERS
        if (reaches && !ray.distant)
        {
            visible = point_light_visibility(light, at.surface.position, at.normal, at.surface.shape);
            reaches = false;
        }
#endif
#if !defined(SHADOW_BUFFERS) || defined(HAS_DIRECTIONAL_LIGHTS)
        if (reaches && shadow_ray_blocked(at, light, wi, ray.tmax)) visible = 0.0;
#endif
        vec3 f = diffuse_eval(at.bsdf, at.n, at.wo, wi) * (cosine * shading_cosine(at.n, at.normal, at.vertex_cosine, wi));
#ifdef HAS_MICROFACETS
        f += mirroring_eval(at.bsdf, at.n, at.normal, at.wo, wi) * cosine;
#endif
        sum += f * ray.E * (visible / PI);
    }
    return sum;
}

#ifdef LIGHT_SAMPLES
// Radiance towards wo from samples of emitting shapes and of the sky. These always need shadow rays, because their
// positions differ in every path set.
vec3 light_from_samples(Shaded at)
{
    vec3 sum = vec3(0.0);
    for (int i = 0; i < LIGHT_SAMPLES; ++i)
    {
        Incident light = light_sample(i, at.surface.position, at.normal);
        if (!is_lit(light.E)) continue;
        if (!shadow_ray_blocked(at, light_count + i, light.wi, sample_tmax(light)))
        {
            vec3 f = diffuse_eval(at.bsdf, at.n, at.wo, light.wi) * shading_cosine(at.n, at.normal, at.vertex_cosine, light.wi);
#ifdef HAS_MICROFACETS
            f += mirroring_eval(at.bsdf, at.n, at.normal, at.wo, light.wi);
#endif
            sum += f * light.E;
        }
    }
    return sum;
}
#endif

// Adds light to a pixel; direct: true if at most one surface has reflected it.
void add_light(inout vec3 L, vec3 light, bool direct)
{
    L += light;
#ifdef SPLIT_LIGHT
    if (direct) direct_part += light;
#endif
}

// Adds light that the surface emits, and the ambient light that it reflects.
void add_emission(inout vec3 L, Shaded at, vec3 weight, int depth)
{
    float pdf_area;
    L += weight * (ambient * at.bsdf.diffuse + emitted(at.surface, at.front, pdf_area));
#ifdef SPLIT_LIGHT
    if (depth <= 2) direct_part += weight * emitted(at.surface, at.front, pdf_area);
#endif
}

// Adds direct light that the surface reflects.
void add_direct_light(inout vec3 L, Shaded at, vec3 weight, int depth)
{
    add_light(L, weight * light_from_lights(at), depth == 1);
#ifdef LIGHT_SAMPLES
    add_light(L, weight * light_from_samples(at), depth == 1);
#endif
}

#if defined(REFLECTIONS) && defined(HAS_COAT_NORMALS)
uint mirrors_chosen = 0u;  // number of choices between clearcoat and base in this pixel so far

// A smooth clearcoat with its own normals mirrors another direction than its base. The ray is not split; it follows
// one of the two directions, with a probability proportional to its reflectance.
void choose_mirror(Shaded at, inout vec3 share, inout vec3 mirroring)
{
    float coat = coat_mirrored(at.bsdf), both = coat + mean(share);
    if (coat <= 0.0) return;
    ivec2 pixel = ivec2(gl_FragCoord.xy) + eye_corner;
    uint path = pcg(uint(pixel.x) + (uint(pixel.y) << 16u)) + ++mirrors_chosen;
    if (random_number(path, USE_LOBE) * both < coat) {
        share = vec3(both);
        mirroring = at.bsdf.coat_normal;
    } else {
        share *= both / (both - coat);
    }
}
#endif

#ifdef REFLECTIONS
// Follows the mirrored ray to the next surface; returns false if it is not cast, because it would add no light.
bool mirror_ray(
    Shaded at, bool last, inout vec3 weight, inout vec3 origin, inout vec3 direction, inout int primitive, inout float t)
{
    vec3 mirroring = mirroring_normal(at.n, at.normal, at.wo);
    vec3 share = mirrored(at.bsdf, dot(mirroring, at.wo));
#ifdef HAS_COAT_NORMALS
    choose_mirror(at, share, mirroring);
#endif
    weight *= share;
    if (last || max(weight.r, max(weight.g, weight.b)) <= 0.0) return false;

    origin = at.surface.position;
    direction = normalize(reflect(direction, mirroring));
    begin_ray();
#ifdef BY_BVH
    primitive = nearest_by_bvh(origin, direction, at.rounding, primitive, t);
#else
    primitive = nearest_classic(origin, direction, at.rounding, primitive, t);
#endif
    return true;
}
#endif

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    uvec2 seen = texel(eye_buffer, pixel).rg;
    vec3 origin = eye_origin(pixel), direction = eye_direction(pixel);
    int primitive = int(seen.x) - 1;
    float t = eye_hit(primitive, pixel, origin, direction, uintBitsToFloat(seen.y)), rounding = rounding_of(origin);
    vec3 L = vec3(0.0), weight = vec3(1.0);
#ifdef COUNT_TESTS
    uint shadow_tests = 0u;
#endif
    for (int depth = 1; depth <= max_depth; ++depth)
    {
        if (primitive < 0)
        {
            add_light(L, weight * (depth == 1 ? seen_by_eye(origin, direction) : sky(direction)), depth <= 2);
            break;
        }
        Shaded at = shaded_at(primitive, pixel, origin, direction, t, rounding);
        rounding = at.rounding;
        add_emission(L, at, weight, depth);
#ifdef COUNT_TESTS
        uint before = tests;
#endif
        add_direct_light(L, at, weight, depth);
#ifdef COUNT_TESTS
        shadow_tests += tests - before;
#endif
#ifdef REFLECTIONS
        if (!mirror_ray(at, depth == max_depth, weight, origin, direction, primitive, t)) break;
#else
        break;
#endif
    }
    accumulate(pixel, vec4(L, 0.0));
#ifdef COUNT_TESTS
    int at = 2 * (pixel.y * eye_size.x + pixel.x);
    tests_of_pixel[at] += shadow_tests;
    tests_of_pixel[at + 1] += tests - shadow_tests;
#endif
}
