// t_buffer.vert: draws the part of the window in which a primitive's rays are shot [TB II.B].
// A sphere or ellipsoid is drawn as a rectangle of pixels, a triangle as itself, slightly enlarged, and a plane as
// the window on its side of the horizon. Data shared by the rays are passed as flat outputs. With SQUARES a
// rectangle is drawn as square points, which the table `squares` lists. A small one then needs one vertex instead
// of six.
#include "t_buffer/t_buffer_ray.glsl"

uniform int first;  // index of the first primitive of this kind

#ifdef SQUARES
uniform int square_side;
// For each square: x: index of its sphere, counted from `first`. y, low 20 bits: index of the square among those of
// the sphere; high 12 bits: number of squares in a row of them. See buffers/t_buffer.py.
uniform usampler2D squares;
flat out ivec4 own_pixels;   // first and last pixel of the square; others are discarded
#endif

flat out int primitive;
flat out Target aim;

const vec4 NOWHERE = vec4(2.0, 2.0, 0.0, 1.0);

// Clip position of a corner of the window's pixel grid.
vec4 at_pixel(ivec2 corner) { return vec4(2.0 * vec2(corner) / vec2(eye_size) - 1.0, 0.0, 1.0); }

#if defined(KIND_PLANE)
// Draws the part of the window on the plane's side of the horizon, as a triangle that covers the window and is clipped.
void draw_plane(int corner)
{
    vec2 corner_position = vec2((corner & 1) * 4 - 1, (corner >> 1) * 4 - 1);
    gl_Position = vec4(corner_position, 0.0, 1.0);
    vec2 slope = ((0.5 * corner_position + 0.5) * vec2(eye_size) + vec2(eye_corner) - eye_centre) / eye_focal;
    vec3 normal = to_eye(aim.plane.xyz);
#ifdef EYE_ORTHOGRAPHIC
    // A ray hits the plane if the plane lies ahead of the ray's start.
    float height = aim.plane.w - dot(normal.xy, slope), off = dot(abs(normal.xy), bound_margin() / eye_focal);
    gl_ClipDistance[0] = normal.z == 0.0 ? -1.0 : sign(normal.z) * height + off + 1e-5 * abs(aim.plane.w);
#else
    float towards = dot(normal, vec3(slope, 1.0));
    float margin = dot(abs(normal.xy), bound_margin() / eye_focal);
    gl_ClipDistance[0] = aim.plane.w == 0.0 ? -1.0 : sign(aim.plane.w) * towards + margin + 1e-5;
#endif
}
#elif defined(KIND_TRIANGLE)
const int VERTICES = 3;

// Returns a corner of a right triangle that covers the rectangle.
vec4 around_rectangle(int corner, ivec2 low, ivec2 high)
{
    return at_pixel(low + ivec2(corner & 1, corner >> 1) * 2 * (high + 1 - low));
}

#ifdef EYE_ORTHOGRAPHIC
vec4 triangle_corner(int item, int corner, ivec2 low, ivec2 high) { return around_rectangle(corner, low, high); }
#else
// Returns a corner of the triangle in homogeneous coordinates, moved so that both adjacent edges move outwards. It
// is valid behind the eye, too, because the clipper handles it. own, next, previous: corners in camera space,
// scaled to pixels.
// Source: Hasselgren, Akenine-Möller & Ohlsson 2005, Conservative Rasterization.
vec4 grown(vec3 own, vec3 next, vec3 previous, float side)
{
    vec3 ahead = side * cross(own, next - own), behind = side * cross(previous, own - previous);
    ahead.z += bound_margin() * (abs(ahead.x) + abs(ahead.y));
    behind.z += bound_margin() * (abs(behind.x) + abs(behind.y));
    vec3 p = cross(behind, ahead) * side;
    // The window's middle is the origin of clip space.
    vec2 shift = 2.0 * (eye_centre - vec2(eye_corner)) / vec2(eye_size) - 1.0;
    return vec4(2.0 * p.xy / vec2(eye_size) + shift * p.z, 0.0, p.z);
}

vec4 triangle_corner(int item, int corner, ivec2 low, ivec2 high)
{
    vec3 pixels = vec3(eye_focal, 1.0);
    uvec3 face = corners_of(first + item);
    vec3 a = pixels * to_eye(vertex_position(face.x) - eye_position);
    vec3 b = pixels * to_eye(vertex_position(face.y) - eye_position);
    vec3 c = pixels * to_eye(vertex_position(face.z) - eye_position);
    // Scale the corners, because products of three vectors would exceed the range of floats in large scenes. Only
    // the corners' directions are used.
    vec3 max_abs = max(abs(a), max(abs(b), abs(c)));
    float scale = 1.0 / max(max(max_abs.x, max_abs.y), max(max_abs.z, 1e-30));
    a *= scale;
    b *= scale;
    c *= scale;
    float volume = dot(cross(a, b - a), c - a);
    float side = volume < 0.0 ? -1.0 : 1.0;
    vec4 moved = corner == 0 ? grown(a, b, c, side) : corner == 1 ? grown(b, c, a, side) : grown(c, a, b, side);
    // If the triangle is seen nearly edge-on, its moved edges may intersect anywhere, and its volume may be mere
    // rounding. A right triangle that covers the rectangle is then drawn instead.
    vec3 edges = vec3(
        length(cross(a, b - a).xy * c.z), length(cross(b, c - b).xy * a.z), length(cross(c, a - c).xy * b.z));
    float max_edge = max(edges.x, max(edges.y, edges.z)), rounding = 1e-6 * length(a) * length(b - a) * length(c - a);
    bool wide = abs(volume) > 0.1 * max_edge + rounding;  // the triangle's smallest altitude exceeds 0.1 pixels
    return wide ? moved : around_rectangle(corner, low, high);
}
#endif
#elif defined(SQUARES)
const int VERTICES = 1;

// Draws a square of the rectangle as a point; returns false if it has no pixels.
bool draw_square(uint square, ivec2 low, ivec2 high)
{
    int across = int(square >> 20), number = int(square & 0xfffffu);
    ivec2 begin = low + square_side * ivec2(number % across, number / across);
    ivec2 end = min(begin + square_side - 1, high);
    int side = max(max(end.x - begin.x, end.y - begin.y) + 1, 1);
    own_pixels = ivec4(begin, end);
    // A point is drawn only if its centre is inside the window, so the point is moved inside.
    gl_Position = vec4((vec2(2 * min(begin, eye_size - side)) + float(side)) / vec2(eye_size) - 1.0, 0.0, 1.0);
    gl_PointSize = float(side);
    return !any(lessThan(end, begin));
}
#else
const int VERTICES = 6;

vec4 rectangle_corner(int corner, ivec2 low, ivec2 high)
{
    ivec2 which = ivec2(corner & 1, corner == 2 || corner >= 4 ? 1 : 0);
    if (corner == 3) which = ivec2(1, 0);
    if (corner == 4) which = ivec2(0, 1);
    if (corner == 5) which = ivec2(1, 1);
    return at_pixel(ivec2(which.x == 0 ? low.x : high.x + 1, which.y == 0 ? low.y : high.y + 1));
}
#endif

void main()
{
#ifdef KIND_PLANE
    int item = gl_InstanceID, corner = gl_VertexID;
#else
    int item = gl_VertexID / VERTICES, corner = gl_VertexID - VERTICES * item;
#endif
#ifdef SQUARES
    uvec2 square = texelFetch(squares, ivec2(item % SQUARES_WIDTH, item / SQUARES_WIDTH), 0).xy;
    item = int(square.x);
#endif
    primitive = first + item;
    aim = target(primitive);

#ifdef KIND_PLANE
    draw_plane(corner);
#else
    ivec2 low, high;
    bool hidden = bounds(primitive, low, high) == HIDDEN;
#if defined(KIND_TRIANGLE)
    gl_Position = triangle_corner(item, corner, low, high);
#elif defined(SQUARES)
    hidden = !draw_square(square.y, low, high) || hidden;
#else
    gl_Position = rectangle_corner(corner, low, high);
#endif
    if (hidden) gl_Position = NOWHERE;
#endif
}
