// start_points.frag: writes the number + 1 of the triangle that each point lies on; 0 for none.
// Needs:  <SCENE>, <RAY_BVH>
// Runs over: the points of the window. Frame: world
#include "gl/texels.glsl"
#include <CONSTANTS>
#include <SCENE>
#include "scene/ray_bvh.glsl"
#include "camera/start_points.glsl"

layout(location = 0) out uint seen;

// Maximum distance of a point from its surface, above or below, as a multiple of the rounding error.
const float NEAR = 4.0;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 position = texel(start_positions, pixel);
    vec3 normal = texel(start_normals, pixel).xyz;
    float near = NEAR * RAY_ROUNDING * start_distance(position.xyz);
    vec3 origin = position.xyz + near * normal;
    seen = 0u;
    if (position.w == 0.0) return;
    int triangle = nearest_triangle(origin, -normal, -1);
    if (triangle < 0) return;
    vec4 plane = facet_texel(triangle, FACET_PLANE);
    float t = (plane.w - dot(plane.xyz, origin)) / -dot(plane.xyz, normal);
    if (t <= 2.0 * near) seen = uint(triangle + 1);
}
