// path_advance.frag: UpdateImage [PB table 6]: from what the scan found to the next vertex of every path.
// Runs over: the pixels of the window. Output: see path_state.glsl; in radiance.a, casts + 1024 * losses of the path.
#include "texels.glsl"
#include "constants.glsl"
#include <TRIANGLE>
#include "random.glsl"
#include "direct.glsl"
#include "path_course.glsl"
#include "path_vertex.glsl"
#include "path_flight.glsl"
#include "path_result.glsl"
#include "path_state.glsl"

TEXELS(rgba32f, path_position);
TEXELS(rgba32f, path_beta);
TEXELS(rgba32f, path_radiance);
uniform vec3 path_d[VIEWS];
uniform ivec4 image_window;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 gathered = texel(path_radiance, pixel);
    float weight;
    int triangle = path_result(pixel, weight);
    if (triangle != PATH_DEAD) gathered.a += triangle == PATH_LOST ? 1025.0 : 1.0;
    if (triangle < 0) {
        leave(pixel, ended(gathered.rgb), gathered.a);
        return;
    }
    vec4 from = texel(path_position, pixel);
    vec3 throughput = texel(path_beta, pixel).rgb * weight;
    vec3 d = path_d[course_view(from.w)] * sign(from.w);
    vec4 plane = triangle_texel(triangle, TRIANGLE_PLANE);
    float t = max(0.0, (plane.w - dot(plane.xyz, from.xyz)) / dot(plane.xyz, d));
    vec3 x = from.xyz + t * d;
    float side = side_hit(plane, d);

    // Emission is shared with the light sample of the vertex before [Veach 1997]; alone, it would be counted twice.
    vec4 emission = triangle_texel(triangle, TRIANGLE_EMISSION);
    float density = direction_density(course_cosine(from.w));
    if (density > 0.0) {
        float light = abs(emission.w) * t * t / max(abs(dot(plane.xyz, d)), 1e-9);
        gathered.rgb += throughput * emitted(emission, side) * power_heuristic(density, light);
    }

    ivec2 whole = pixel + image_window.xy;
    uint path = uint(whole.y * image_window.z + whole.x);
    leave(pixel, path_vertex(path, x, triangle, plane, side, throughput, gathered.rgb), gathered.a);
}
