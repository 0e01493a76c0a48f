// object_bounds.glsl: bounds of the pixels whose rays can hit a primitive: a rectangle, slightly too large but never too small.
// Needs:  <SCENE>, camera.glsl
//
// The rectangle comes from exact tangent planes, plus a margin for rounding. The rays of all pixels whose centre is
// outside miss the primitive. A primitive that extends behind the eye has no bounds in projection, and may cover
// any pixel unless it is beyond a side of the view. With parallel rays (EYE_ORTHOGRAPHIC), slopes stand for
// coordinates in camera space.
const int HIDDEN = 0;   // the object covers no pixel
const int BOUNDED = 1;  // the object covers pixels from low to high, inclusive, inside the window
const int AROUND = 2;   // the object crosses the plane of the eye, so it may cover any pixel

const float NEARLY = 1e-3;  // an object nearer to the plane of the eye than this fraction of its extent is AROUND

// bound_margin() returns the margin of bounds in pixels, for a rasteriser's rounding of coordinates and for
// rounding of directions.
float max_focal() { return max(eye_focal.x, eye_focal.y); }

#ifdef EYE_ORTHOGRAPHIC
float bound_margin()
{
    vec3 far = abs(eye_position);
    return 0.03125 + 1e-6 * (max_focal() * max(far.x, max(far.y, far.z)) + float(eye_size.x + eye_size.y));
}
#else
float bound_margin() { return 0.03125 + 5e-7 * max_focal(); }
#endif

vec3 to_eye(vec3 direction)
{
    return vec3(dot(direction, eye_right), dot(direction, eye_up), dot(direction, eye_forward));
}

// Slopes (x / z in camera space) of the window's sides, through the centres of its outermost pixels.
vec4 window_slopes()
{
    vec2 first = vec2(eye_corner) + 0.5 - eye_centre;
    return vec4(first - bound_margin(), first + vec2(eye_size - 1) + bound_margin()) / eye_focal.xyxy;
}

// Converts slopes to the pixels of the window between them, first and last. Returns BOUNDED, or HIDDEN if there are
// none.
int pixels_between(vec2 low_corner, vec2 high_corner, out ivec2 low, out ivec2 high)
{
    vec2 shift = eye_centre - 0.5 - vec2(eye_corner), size = vec2(eye_size);
    vec2 first = ceil(low_corner * eye_focal + shift - bound_margin());
    vec2 last = floor(high_corner * eye_focal + shift + bound_margin());
    low = ivec2(clamp(first, vec2(0.0), size));
    high = ivec2(clamp(last, vec2(-1.0), size - 1.0));
    return all(lessThanEqual(low, high)) ? BOUNDED : HIDDEN;
}

#ifdef EYE_ORTHOGRAPHIC
// Bounds, for parallel rays, of a box given by two corners in the eye's axes. The box is enlarged by the corners'
// rounding error.
int parallel_bounds(vec3 low_corner, vec3 high_corner, out ivec2 low, out ivec2 high)
{
    vec3 far = max(abs(low_corner), abs(high_corner));
    float rounding = 5e-7 * max(far.x, max(far.y, far.z));
    low = ivec2(0);
    high = eye_size - 1;
    if (high_corner.z + rounding <= 0.0) return HIDDEN;
    return pixels_between(low_corner.xy - rounding, high_corner.xy + rounding, low, high);
}
#endif

// Slopes of the two planes that contain the eye and one axis of the image, and touch an ellipsoid. centre: its
// centre (x, z). X and Z are the x and z components of its three half axes. xz = X . Z, zz = Z . Z, square = |z X -
// x Z|^2 - |X x Z|^2.
vec2 tangent_slopes(vec2 centre, float xz, float zz, float square)
{
    float middle = centre.x * centre.y - xz, root = sqrt(max(square, 0.0));
    return vec2(middle - root, middle + root) / (centre.y * centre.y - zz);
}

// Returns true if a body is beyond a side of the window. support: its extent along the normals of the sides.
bool beyond_window(vec3 centre, vec4 support)
{
    vec4 s = window_slopes();
    vec4 inside = vec4(centre.xy - s.xy * centre.z, s.zw * centre.z - centre.xy);
    return any(lessThan(inside, -support * 1.00001));
}

int sphere_bounds(vec3 centre, float radius, out ivec2 low, out ivec2 high)
{
    vec3 c = to_eye(centre - eye_position);
#ifdef EYE_ORTHOGRAPHIC
    return parallel_bounds(c - radius, c + radius, low, high);
#else
    low = ivec2(0);
    high = eye_size - 1;
    if (c.z + radius <= 0.0) return HIDDEN;
    if (c.z <= radius * (1.0 + NEARLY))
    {
        vec4 s = window_slopes();
        return beyond_window(c, radius * sqrt(1.0 + s * s)) ? HIDDEN : AROUND;
    }
    float zz = radius * radius;
    vec2 square = zz * (c.xy * c.xy + (c.z - radius) * (c.z + radius));
    vec2 x = tangent_slopes(c.xz, 0.0, zz, square.x), y = tangent_slopes(c.yz, 0.0, zz, square.y);
    return pixels_between(vec2(x.x, y.x), vec2(x.y, y.y), low, high);
#endif
}

int ellipsoid_bounds(vec3 centre, vec3 axis0, vec3 axis1, vec3 axis2, out ivec2 low, out ivec2 high)
{
    vec3 c = to_eye(centre - eye_position);
    mat3 support = transpose(mat3(to_eye(axis0), to_eye(axis1), to_eye(axis2)));  // X, Y, Z: the axes' components
    vec3 X = support[0], Y = support[1], Z = support[2];
#ifdef EYE_ORTHOGRAPHIC
    vec3 extent = vec3(length(X), length(Y), length(Z));
    return parallel_bounds(c - extent, c + extent, low, high);
#else
    float zz = dot(Z, Z), deep = sqrt(zz);
    low = ivec2(0);
    high = eye_size - 1;
    if (c.z + deep <= 0.0) return HIDDEN;
    if (c.z <= deep * (1.0 + NEARLY))
    {
        vec4 s = window_slopes();
        vec4 far = vec4(length(X - s.x * Z), length(Y - s.y * Z), length(X - s.z * Z), length(Y - s.w * Z));
        return beyond_window(c, far) ? HIDDEN : AROUND;
    }
    vec3 across_x = c.z * X - c.x * Z, across_y = c.z * Y - c.y * Z, xz = cross(X, Z), yz = cross(Y, Z);
    vec2 x = tangent_slopes(c.xz, dot(X, Z), zz, dot(across_x, across_x) - dot(xz, xz));
    vec2 y = tangent_slopes(c.yz, dot(Y, Z), zz, dot(across_y, across_y) - dot(yz, yz));
    return pixels_between(vec2(x.x, y.x), vec2(x.y, y.y), low, high);
#endif
}

int triangle_bounds(vec3 corner0, vec3 corner1, vec3 corner2, out ivec2 low, out ivec2 high)
{
    vec3 a = to_eye(corner0 - eye_position), b = to_eye(corner1 - eye_position), c = to_eye(corner2 - eye_position);
#ifdef EYE_ORTHOGRAPHIC
    return parallel_bounds(min(a, min(b, c)), max(a, max(b, c)), low, high);
#else
    float nearest = min(a.z, min(b.z, c.z)), farthest = max(a.z, max(b.z, c.z));
    low = ivec2(0);
    high = eye_size - 1;
    if (farthest <= 0.0) return HIDDEN;
    if (nearest <= farthest * NEARLY)
    {
        vec4 s = window_slopes();
        bvec4 out_a = lessThan(vec4(a.xy - s.xy * a.z, s.zw * a.z - a.xy), vec4(0.0));
        bvec4 out_b = lessThan(vec4(b.xy - s.xy * b.z, s.zw * b.z - b.xy), vec4(0.0));
        bvec4 out_c = lessThan(vec4(c.xy - s.xy * c.z, s.zw * c.z - c.xy), vec4(0.0));
        return any(equal(ivec4(out_a) + ivec4(out_b) + ivec4(out_c), ivec4(3))) ? HIDDEN : AROUND;
    }
    vec2 p = a.xy / a.z, q = b.xy / b.z, r = c.xy / c.z;
    return pixels_between(min(p, min(q, r)), max(p, max(q, r)), low, high);
#endif
}
