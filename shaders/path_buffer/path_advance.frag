// path_advance.frag: UpdateImage [PB table 6]: advances every path to its next vertex, on the triangle that the
// scan found.
// Runs over: the pixels of the window. Output: see path_state.glsl; radiance.a has the path's events (accumulate.glsl).
#include <CONSTANTS>
#include <SCENE>
#include "scene/surface.glsl"
#include "sampling/random.glsl"
#include "lights/direct.glsl"
#include "path/direction_code.glsl"
#include "path/path_vertex.glsl"
#include "path/path_next.glsl"
#include "path/ray_record.glsl"
#include "path/path_arrival.glsl"
#include "path/path_state.glsl"

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Arrival a = arrive(pixel);
    if (a.triangle < 0) {
        leave(pixel, ended(a.radiance.rgb), a.radiance.a);
        return;
    }
    PathVertex v = path_vertex(a.surface, a.triangle, a.plane, a.front, a.wo);
    leave(pixel, lit_and_gone_on(v, path_in_image(pixel), a.throughput, a.radiance.rgb), a.radiance.a);
}
