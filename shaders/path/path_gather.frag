// path_gather.frag: end of a path at the radiosity solution [PB 4, A.4]: the irradiance of the found surface is looked up and
// reflected. Direct light comes from the light sample, except for a fraction that the solution includes. Emission came from the
// previous vertex's light sample, or was found with the surface.
// A path continues instead if its last segment is so short that the width of the solution's element would be visible.
// Runs over: the pixels of the window. Output: see path_state.glsl
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
#include "radiosity/radiosity.glsl"
#ifdef STREAMED
#include "radiosity/irradiance_volume.glsl"
#endif
#include "path/path_state.glsl"

uniform float lookup_distance;  // maximum distance at which a path continues, in the element's minimum distances, before a random factor

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Arrival a = arrive(pixel);
    PathState next = ended(a.radiance.rgb);
    if (a.triangle >= 0) {
        PathVertex v = path_vertex(a.surface, a.triangle, a.plane, a.front, a.wo);
        uint path = path_in_image(pixel);
#ifdef STREAMED
        // The solution is of a proxy, and a streamed triangle has no elements in it.
        bool streamed = a.triangle >= first_streamed;
#else
        const bool streamed = false;
#endif
        LatticePosition in_lattice = lattice_position(streamed ? 0 : a.triangle, a.position);
        float width = min_lookup_distance(in_lattice, a.front);
#ifdef STREAMED
        if (streamed) width = volume_cell;
#endif
        bool near = a.t < lookup_distance * random_number(path, USE_LOOKUP) * width;
#ifdef LAST_VERTEX
        near = false;
#endif
        vec4 found = vec4(0.0);
        if (!near && !streamed) found = irradiance_at(in_lattice, a.front);
#ifdef STREAMED
        if (!near && streamed) found = volume_irradiance(a.position, a.front ? a.plane.xyz : -a.plane.xyz, a.front);
#endif
        vec3 looked_up = a.throughput * (diffuse_reflectance(v.bsdf, dot(v.n, v.wo)) * found.rgb / PI);
        next.radiance += looked_up + lit(v, path, a.throughput * (1.0 - found.a), near ? next_views : 0);
#ifndef LAST_VERTEX
        if (near) next = go_on(v, path, a.throughput, next.radiance);
#endif
    }
    leave(pixel, next, a.radiance.a);
}
