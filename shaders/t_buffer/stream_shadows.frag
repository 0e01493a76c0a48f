// stream_shadows.frag: tests if a part of the streamed triangles blocks those shadow rays of pixels that earlier
// parts do not block [TB III.A]. The part is on the device during the test; the next part starts with the resulting
// bits.
// Needs:  <SCENE>, <BVH>, <OCCLUDERS>; SHADOW_BUFFERS: lights with a position are looked up in a buffer and have no
//         rays
// Runs over: the images of words, see stream_shadows.glsl. Output: the word, with a bit for each blocked ray
#include <SCENE>
#include "scene/surface_at.glsl"
#include "camera/camera.glsl"
#include "t_buffer/eye_hit.glsl"
#include "scene/stream_bvh.glsl"
#include "t_buffer/shadow_rays.glsl"
#include "t_buffer/stream_shadows.glsl"

UINT_TEXELS(rg32ui, eye_buffer);  // number of the primitive + 1, and bits of t

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };  // counts for shadow rays and secondary rays
#endif

layout(location = 0) out uint blocked;

// Sets direction and length of the shadow ray with this number; returns false if no light arrives along it.
bool shadow_ray(int number, vec3 position, vec3 normal, out vec3 wi, out float tmax)
{
#ifdef LIGHT_SAMPLES
    if (number >= light_count) {
        Incident light = light_sample(number - light_count, position, normal);
        wi = light.wi;
        tmax = sample_tmax(light);
        return is_lit(light.E);
    }
#endif
    PunctualRay ray = punctual_ray(number, position);
    wi = ray.wi;
    tmax = ray.tmax;
#ifdef SHADOW_BUFFERS
    if (!ray.distant) return false;
#endif
    return dot(normal, wi) > 0.0 && is_lit(ray.E);
}

uint asked_of_surface(uint word, int first, ivec2 pixel, int primitive, float eye_t)
{
#ifdef LIGHT_SAMPLES
    int rays = light_count + LIGHT_SAMPLES;
#else
    int rays = light_count;
#endif
    vec3 origin = eye_origin(pixel), direction = eye_direction(pixel);
    float t = eye_hit(primitive, pixel, origin, direction, eye_t);
    Surface s = surface_seen(primitive, pixel, origin, direction, t);
    vec3 normal = front_hit(s.normal, direction) ? s.normal : -s.normal;
    float rounding = rounding_at(s.position, t, rounding_of(origin));
    for (int k = 0; k < min(32, rays - first); ++k)
    {
        vec3 wi;
        float tmax;
        if ((word >> uint(k) & 1u) == 0u && shadow_ray(first + k, s.position, normal, wi, tmax)
            && blocked_by_part(s.position, wi, rounding, tmax, primitive)) word |= 1u << uint(k);
    }
    return word;
}

#ifdef HAS_GROUND
uint asked_of_ground(uint word, ivec2 pixel)
{
    vec3 origin = eye_origin(pixel), direction = eye_direction(pixel), start, to_light;
    bool asks = word == 0u && ground_shadow_ray(pixel, origin, direction, start, to_light);
    return asks && blocked_by_part(start, to_light, 0.0, NO_HIT, -1) ? 1u : word;
}
#endif

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), picture = at / eye_size, pixel = at - picture * eye_size;
    int number = picture.y * stream_shadow_columns + picture.x;
    blocked = texel(stream_shadows, at).r;
    uvec2 seen = texel(eye_buffer, pixel).rg;
    if (seen.x != 0u) blocked = asked_of_surface(blocked, 32 * number, pixel, int(seen.x) - 1, uintBitsToFloat(seen.y));
#ifdef HAS_GROUND
    else if (number == 0) blocked = asked_of_ground(blocked, pixel);
#endif
#ifdef COUNT_TESTS
    atomicAdd(tests_of_pixel[2 * (pixel.y * eye_size.x + pixel.x)], tests);
#endif
}
