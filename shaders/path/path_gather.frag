// path_gather.frag: the end of a path at the radiosity solution [PB 4, A.4]: the light that arrives at the surface
// found is looked up and reflected. Direct light is the light sample's, but for a share that the solution has; emission
// was the light sample's of the vertex before, or found with the surface.
// A path that ended so near to its start that an element's width shows continues instead.
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

uniform float lookup_distance;  // in minimum distances of the element; nearer than a random share of it, a path continues

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Arrival a = arrive(pixel);
    PathState next = ended(a.radiance.rgb);
    if (a.triangle >= 0) {
        PathVertex v = path_vertex(a.surface, a.triangle, a.plane, a.front, a.wo);
        uint path = path_in_image(pixel);
#ifdef STREAMED
        // The solution is of a proxy, whose elements a streamed triangle does not have.
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
