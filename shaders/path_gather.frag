// path_gather.frag: the end of a path at the radiosity solution [PB 4, A.4]: what the surface found reflects is looked
// up; light that reaches the vertex before by emission was its light sample's, or found with the surface.
// Runs over: the pixels of the window. Output: the sums, see path_state.glsl
#include "constants.glsl"
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
    if (a.triangle >= 0) a.radiance.rgb += a.throughput * reflected_radiance(a.triangle, a.position, a.front);
    leave(pixel, ended(a.radiance.rgb), a.radiance.a);
}
