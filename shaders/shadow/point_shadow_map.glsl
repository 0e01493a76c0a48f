// point_shadow_map.glsl: conversion between directions and the cells of a point light's shadow-buffer.
// Frame:  world axes about the light. A buffer is one face (sphere) or six (cube) of shadow_cells. A position on a face is in
//         cells, with (0, 0) at its lower corner and centres of cells at halves.
// Needs:  SHADOW_CUBE: the cube; otherwise the sphere
// Source: [TB III.C, III.D], with three corrections. (4) uses theta over [0, pi], but (5) uses it as a latitude, and (7)
//         computes it by arcsin, in [-pi/2, pi/2]. As printed, half the sphere is never addressed. (7) also computes phi by
//         arccos, which cannot distinguish y from -y. Here, for an entry of row r and column c of r_max x c_max,
//             theta = ((r + 1/2) / r_max - 1/2) pi         the latitude, by atan2 of z and the distance from the axis
//             phi   = ((c + 1/2) / c_max) 2 pi             the longitude, by atan2 of y and x
//         at the centres of cells, through which their rays are shot. arcsin would suffice for theta, except for its rounding
//         at the poles.
#include "sampling/angles.glsl"

uniform vec2 shadow_cells;  // columns and rows of a face

struct ShadowPosition
{
    int face;
    vec2 at;  // position on the face, in cells
};

#ifdef SHADOW_CUBE
// Cells have equal angles across a face instead of equal lengths, so that all have similar sizes. The solid angle
// of the largest is 1.4 times that of the smallest, instead of 5.2 (Brown 2017, Equi-Angular Cubemaps). Faces 0 to
// 5 look along +x, -x, +y, -y, +z, -z. In the frame of a face, x and y are across it, and z is along its axis.
// Opposite faces are mirror images.
vec3 shadow_to_face(int face, vec3 d)
{
    vec3 f = face < 2 ? d.yzx : face < 4 ? d.zxy : d;
    return vec3(f.xy, (face & 1) == 0 ? f.z : -f.z);
}

vec3 shadow_from_face(int face, vec3 f)
{
    f.z = (face & 1) == 0 ? f.z : -f.z;
    return face < 2 ? f.zxy : face < 4 ? f.yzx : f;
}

ShadowPosition shadow_position(vec3 d)
{
    vec3 a = abs(d);
    int axis = a.x >= max(a.y, a.z) ? 0 : a.y >= a.z ? 1 : 2;
    int face = 2 * axis + int(d[axis] < 0.0);
    vec3 f = shadow_to_face(face, d);
    vec2 slope = f.xy / f.z;
    return ShadowPosition(face, (0.5 + vec2(arc_tangent(slope.x), arc_tangent(slope.y)) * (2.0 / PI)) * shadow_cells);
}

// Returns the direction through a position on a face, not normalised. A position beyond the face's edge, by less than half a
// face, gives a direction into the neighbouring face's cells.
vec3 shadow_direction(int face, vec2 at)
{
    vec2 right_angles = at / shadow_cells - 0.5;
    return shadow_from_face(face, vec3(tangent(right_angles.x), tangent(right_angles.y), 1.0));
}
#else
ShadowPosition shadow_position(vec3 d)
{
    float theta = arc_tangent(d.z, length(d.xy));
    float phi = arc_tangent(d.y, d.x);
    vec2 at = vec2(fract(phi / (2.0 * PI)), theta / PI + 0.5) * shadow_cells;
    return ShadowPosition(0, at);
}

// Returns the unit direction through a position. Positions beyond a pole continue on the other side of the pole, and positions
// beyond the seam continue behind the seam.
vec3 shadow_direction(int face, vec2 at)
{
    vec2 theta = cosine_sine(2.0 * (at.y / shadow_cells.y - 0.5));
    vec2 phi = cosine_sine(4.0 * (at.x / shadow_cells.x));
    return vec3(theta.x * phi, theta.y);
}
#endif

// Lower corner of the cell that contains a position on a face.
vec2 shadow_cell(vec2 at)
{
    return clamp(floor(at), vec2(0.0), shadow_cells - 1.0);
}
