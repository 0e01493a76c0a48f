// lamp_rectangles.glsl: rectangular lamps of two triangles, sampled by solid angle; `glpath.lights.rectangles` selects them.
// Needs:  LAMP_RECTANGLES: number of these lamps
// Frame:  world.
#include "sampling/rectangle.glsl"
uniform vec3 lamp_rectangles[3 * LAMP_RECTANGLES];  // a corner and two edges of each; the cross product of the edges points out of the front
uniform int lamp_triangles[LAMP_RECTANGLES];        // index of the first of each rectangle's two triangles

// A position nearer to a lamp's plane than this fraction of its coordinates may be on either side of the plane, by
// rounding.
const float IN_PLANE = 1e-5;

// Returns the rectangular lamp of a triangle, seen from a position. The solid angle is 0 if points are sampled uniformly by area
// instead, because the lamp is not rectangular, appears too small, or its plane may contain the position.
SeenRectangle seen_lamp(int triangle, bool front, vec3 from)
{
    int lamp = -1;
    for (int k = 0; k < LAMP_RECTANGLES; ++k) if ((triangle - lamp_triangles[k]) >> 1 == 0) lamp = k;
    int first = 3 * max(lamp, 0);
    vec3 across = lamp_rectangles[first + 1], up = lamp_rectangles[first + 2];
    SeenRectangle r = seen_rectangle(lamp_rectangles[first], front ? across : up, front ? up : across, from);
    vec2 extent = r.high - r.low;
    bool in_plane = r.height < IN_PLANE * (length(from) + extent.x + extent.y);
    if (lamp < 0 || in_plane || r.solid_angle < MIN_SOLID_ANGLE) r.solid_angle = 0.0;
    return r;
}

// Density per area with which light samples choose the point of the lamp in a unit direction, at distance t.
// pdf_area: density if the lamp's points are sampled uniformly by area.
float lamp_pdf_area(SeenRectangle r, float pdf_area, vec3 direction, float t)
{
    vec2 extent = r.high - r.low;
    float by_angle = pdf_area * extent.x * extent.y * abs(dot(direction, r.normal)) / (r.solid_angle * t * t);
    return r.solid_angle > 0.0 ? by_angle : pdf_area;
}
