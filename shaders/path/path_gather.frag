// path_gather.frag: end of a path, where the radiosity solution replaces further bounces [PB 4, A.4]. The
// irradiance of the hit surface is looked up and reflected. Direct light comes from the light sample, except for a
// fraction that the solution includes. Emission was added on arrival, with its MIS weight.
// A path continues instead if its last segment is so short that the element size of the solution would be visible.
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

// A path continues if its segment is shorter than this, times a random number in [0, 1), times min_lookup_distance.
uniform float lookup_distance;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Arrival a = arrive(pixel);
    PathState next = ended(a.radiance.rgb);
    if (a.triangle >= 0) {
        PathVertex v = path_vertex(a.surface, a.triangle, a.plane, a.front, a.wo);
        uint path = path_in_image(pixel);
#ifdef STREAMED
        // The solution was computed on a proxy mesh, which has no elements for streamed triangles.
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
