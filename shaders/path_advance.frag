// path_advance.frag: UpdateImage [PB table 6]: from what the scan found to the next vertex of every path.
// Runs over: the pixels of the window. Output: path states; in radiance.a casts + 1024 * losses of the path so far.
#include "constants.glsl"
#include <TRIANGLE>
#include "random.glsl"
#include "direct.glsl"
#include "path_vertex.glsl"
#include "path_flight.glsl"
#include "path_result.glsl"

uniform sampler2D path_position;
uniform sampler2D path_beta;
uniform sampler2D path_radiance;
uniform vec3 path_d;
uniform ivec4 image_window;

layout(location = 0) out vec4 position;
layout(location = 1) out vec4 beta;
layout(location = 2) out vec4 radiance;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    position = vec4(0.0);
    beta = vec4(0.0);
    radiance = texelFetch(path_radiance, pixel, 0);
    float weight;
    int triangle = path_result(pixel, weight);
    if (triangle == PATH_DEAD) return;
    radiance.a += triangle == PATH_LOST ? 1025.0 : 1.0;
    if (triangle < 0) return;

    vec4 from = texelFetch(path_position, pixel, 0);
    vec3 throughput = texelFetch(path_beta, pixel, 0).rgb * weight;
    vec3 d = path_d * from.w;
    vec4 plane = triangle_texel(triangle, TRIANGLE_PLANE);
    float t = max(0.0, (plane.w - dot(plane.xyz, from.xyz)) / dot(plane.xyz, d));
    vec3 x = from.xyz + t * d;
    float side = side_hit(plane, d);

    // Emission is shared with the light sample of the vertex before [Veach 1997]; alone, it would be counted twice.
    vec4 emission = triangle_texel(triangle, TRIANGLE_EMISSION);
    vec3 Le = emitted(emission, side);
    if (direction_density > 0.0 && Le != vec3(0.0)) {
        float light = abs(emission.w) * t * t / max(abs(dot(plane.xyz, d)), 1e-9);
        radiance.rgb += throughput * Le * power_heuristic(direction_density, light);
    }

    ivec2 whole = pixel + image_window.xy;
    uint path = uint(whole.y * image_window.z + whole.x);
    PathState state = path_vertex(path, x, triangle, plane, side, throughput, radiance.rgb);
    position = state.position;
    beta = vec4(state.beta, 0.0);
    radiance.rgb = state.radiance;
}
