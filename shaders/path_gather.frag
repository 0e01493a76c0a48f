// path_gather.frag: the end of a path at the radiosity solution [PB 4, A.4]: the light that arrives at the surface
// found is looked up and reflected; light that reaches the vertex before by emission was its light sample's, or found
// with the surface.
// Runs over: the pixels of the window. Output: the sums, see path_state.glsl
#include <CONSTANTS>
#include <SCENE>
#include "surface.glsl"
#include "random.glsl"
#include "direct.glsl"
#include "path_course.glsl"
#include "path_vertex.glsl"
#include "path_flight.glsl"
#include "path_arrival.glsl"
#include "radiosity.glsl"
#include "path_state.glsl"

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Arrival a = arrive(pixel);
    if (a.triangle >= 0) {
        vec3 reflectance = bsdf_at(a.surface, a.front).diffuse;
        a.radiance.rgb += a.throughput * reflectance * irradiance_at(a.triangle, a.position, a.front) / PI;
    }
    leave(pixel, ended(a.radiance.rgb), a.radiance.a);
}
