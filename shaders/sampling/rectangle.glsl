// rectangle.glsl: directions towards a rectangle, uniform in its solid angle.
// Needs:  angles.glsl
// Source: Urena, Fajardo & King 2013, An area-preserving parametrization for spherical rectangles.
#include "sampling/angles.glsl"

// Solid angle, sr, below which points are sampled uniformly by area instead. The solid angle is a difference of
// four angles, each exact to some 1e-7, so a small one would have a visible relative error. A small rectangle has
// nearly the same density by both methods.
const float MIN_SOLID_ANGLE = 0.01;

// Rectangle as seen from a position in front of it.
struct SeenRectangle
{
    vec3 x, y, normal;   // unit vectors along the edges, and out of the front side
    vec2 low, high;      // corners along x and y, relative to the position's projection
    float height;        // height of the position above the rectangle's plane
    float first;         // angle for u.x = 0 in towards_rectangle(), radians
    float solid_angle;   // solid angle, sr; 0 if the position is behind
};

// Signed solid angle of the rectangle between the projection of the position and one corner.
float corner_angle(vec2 corner, float height)
{
    return arc_tangent(corner.x * corner.y, height * sqrt(dot(corner, corner) + height * height));
}

SeenRectangle seen_rectangle(vec3 corner, vec3 across, vec3 up, vec3 from)
{
    SeenRectangle r;
    vec2 extent = vec2(length(across), length(up));
    r.x = across / extent.x;
    r.y = up / extent.y;
    r.normal = cross(r.x, r.y);
    vec3 d = corner - from;
    r.height = -dot(d, r.normal);
    r.low = vec2(dot(d, r.x), dot(d, r.y));
    r.high = r.low + extent;
    float z = max(r.height, 1e-30), left = corner_angle(r.low, z), left_high = corner_angle(vec2(r.low.x, r.high.y), z);
    r.first = left_high - left;
    float angle = corner_angle(r.high, z) - corner_angle(vec2(r.high.x, r.low.y), z) - r.first;
    r.solid_angle = r.height > 0.0 ? max(angle, 0.0) : 0.0;
    return r;
}

// Unit direction to a point of the rectangle, from two uniform numbers.
vec3 towards_rectangle(SeenRectangle r, vec2 u)
{
    vec2 at = mix(r.low, r.high, u);
    if (r.solid_angle > MIN_SOLID_ANGLE) {
        float z2 = r.height * r.height;
        vec2 b = vec2(-r.low.y, r.high.y) * inversesqrt(vec2(r.low.y * r.low.y, r.high.y * r.high.y) + z2);
        vec2 f = cosine_sine((u.x * r.solid_angle + r.first) * (2.0 / PI));
        float over = f.x * b.x + b.y;
        float c = (over < 0.0 ? -f.y : f.y) * inversesqrt(max(over * over + b.x * b.x * f.y * f.y, 1e-30));
        at.x = clamp(c * r.height * inversesqrt(max(1.0 - c * c, 1e-14)), r.low.x, r.high.x);
        float d2 = at.x * at.x + z2;
        vec2 h = vec2(r.low.y, r.high.y) * inversesqrt(vec2(r.low.y * r.low.y, r.high.y * r.high.y) + d2);
        float hv = mix(h.x, h.y, u.y);
        at.y = clamp(hv * sqrt(d2) * inversesqrt(max(1.0 - hv * hv, 1e-14)), r.low.y, r.high.y);
    }
    return normalize(at.x * r.x + at.y * r.y - r.height * r.normal);
}

// Density of `towards_rectangle` per solid angle; 0 for a unit direction that misses.
float rectangle_pdf(SeenRectangle r, vec3 direction)
{
    float cosine = -dot(direction, r.normal);
    if (!(r.solid_angle > 0.0 && cosine > 0.0)) return 0.0;
    float t = r.height / cosine;
    vec2 at = vec2(dot(direction, r.x), dot(direction, r.y)) * t, extent = r.high - r.low;
    if (any(lessThan(at, r.low)) || any(greaterThan(at, r.high))) return 0.0;
    return r.solid_angle > MIN_SOLID_ANGLE ? 1.0 / r.solid_angle : t * t / (extent.x * extent.y * cosine);
}
