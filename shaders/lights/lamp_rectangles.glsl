// lamp_rectangles.glsl: rectangular lamps of two triangles, sampled by the solid angle that they fill; which these are says
// `glpath.lights.rectangles`.
// Needs:  LAMP_RECTANGLES: their number
// Frame:  world.
#include "sampling/rectangle.glsl"
uniform vec3 lamp_rectangles[3 * LAMP_RECTANGLES];  // of each a corner and two edges, whose cross product is out of the front
uniform int lamp_triangles[LAMP_RECTANGLES];        // the first of its two triangles

// Nearer to its plane than this share of coordinates, no position knows on which side of a lamp it is.
const float IN_PLANE = 1e-5;

// The lamp that a triangle is of, seen from a position; a solid angle of 0 where points of it are uniform by area: it is
// no such lamp, or is seen so small, or the position may as well be in its plane.
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

// Per area of a point in a unit direction at a distance; pdf_area: of the same point by area.
float lamp_pdf_area(SeenRectangle r, float pdf_area, vec3 direction, float t)
{
    vec2 extent = r.high - r.low;
    float by_angle = pdf_area * extent.x * extent.y * abs(dot(direction, r.normal)) / (r.solid_angle * t * t);
    return r.solid_angle > 0.0 ? by_angle : pdf_area;
}
