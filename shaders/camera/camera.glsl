// camera.glsl: rays of the camera, one through each pixel; `glpath.gl.camera` sets the uniforms.
// Needs:  nothing for a pinhole; EYE_ORTHOGRAPHIC: parallel rays; EYE_PANORAMA: equirectangular; EYE_LENS: a thin lens, on
//         which each pixel has its own point (a lens whose rays share a point is a pinhole)
// Frame:  eye_right, eye_up, eye_forward unit; pixels of the whole image, y from the bottom, so that an image in tiles has the
//         same bits as a whole image.
#include "sampling/random.glsl"
uniform vec3 eye_position;  // common point of the rays, or a point ahead of it, see eye_ahead
uniform vec3 eye_right;
uniform vec3 eye_up;
uniform vec3 eye_forward;
// Distance of eye_position ahead of the eye; 0 if it is the eye. Rays start in the plane through eye_position,
// because hits far from the start of a ray lose digits.
uniform float eye_ahead;
uniform vec2 eye_focal;    // focal length: pixels per unit at distance 1, or pixels per scene unit for parallel rays
uniform vec2 eye_centre;   // image position of eye_forward, pixels, minus the sample's position in its pixel
uniform ivec2 eye_corner;  // lower left corner of the window in the image, pixels
uniform ivec2 eye_size;    // size of the window, pixels

#ifdef EYE_LENS
uniform uvec2 lens_point;  // lens point of the path set, in units of 2^-32
uniform uint lens_seed;    // seed of the shifts by which pixels move the lens point
uniform vec2 lens;         // x: radius of the lens; y: 1 / focus distance

// Point of the lens from which the pixel's ray starts, scene units. It is the set's point, shifted for each pixel,
// so that the points of each pixel are as evenly spread as the sequence. Source: Shirley & Chiu 1997, A Low
// Distortion Map Between Disk and Square.
vec2 lens_position(ivec2 pixel)
{
    uvec2 at = uvec2(pixel + eye_corner);
    uint first = pcg(at.x + pcg(at.y + lens_seed));
    uvec2 own = lens_point ^ uvec2(first, pcg(first));
    vec2 square = (vec2(own >> 8u) + 0.5) * (2.0 / 16777216.0) - 1.0;
    bool wide = abs(square.x) > abs(square.y);
    float radius = wide ? square.x : square.y;
    float angle = 0.78539816 * (wide ? square.y / square.x : 2.0 - square.x / square.y);
    return lens.x * radius * vec2(cos(angle), sin(angle));
}
#endif

#ifdef EYE_PANORAMA
uniform vec2 eye_angle;  // angle of a pixel to the right and up, radians
#endif

// Unit direction of the ray through the sample's position in a pixel of the window; beside: further offset in
// pixels.
vec3 eye_direction(ivec2 pixel, vec2 beside)
{
#if defined(EYE_ORTHOGRAPHIC)
    return eye_forward;
#elif defined(EYE_PANORAMA)
    precise vec2 angle = (vec2(pixel + eye_corner) + 0.5 - eye_centre + beside) * eye_angle;
    precise vec3 level = cos(angle.x) * eye_forward + sin(angle.x) * eye_right;
    precise vec3 d = cos(angle.y) * level + sin(angle.y) * eye_up;
    precise float scale = sqrt(dot(d, d));
    precise vec3 unit = d / scale;
    return unit;
#else
    precise vec2 q = (vec2(pixel + eye_corner) + 0.5 - eye_centre + beside) / eye_focal;
#ifdef EYE_LENS
    precise vec2 shift = lens_position(pixel) * lens.y;
    q -= shift;
#endif
    precise vec3 d = eye_forward + q.x * eye_right + q.y * eye_up;
    precise float scale = sqrt(dot(d, d));
    precise vec3 unit = d / scale;
    return unit;
#endif
}

vec3 eye_direction(ivec2 pixel)
{
    return eye_direction(pixel, vec2(0.0));
}

// Start of the ray whose direction eye_direction() returns.
vec3 eye_origin(ivec2 pixel, vec2 beside)
{
#if defined(EYE_ORTHOGRAPHIC)
    precise vec2 q = (vec2(pixel + eye_corner) + 0.5 - eye_centre + beside) / eye_focal;
    precise vec3 origin = eye_position + q.x * eye_right + q.y * eye_up;
    return origin;
#elif defined(EYE_LENS)
    precise vec2 start = lens_position(pixel);
    precise vec2 q = (vec2(pixel + eye_corner) + 0.5 - eye_centre + beside) / eye_focal;
    precise vec2 shift = start * lens.y;
    q -= shift;
    start += eye_ahead * q;
    precise vec3 origin = eye_position + start.x * eye_right + start.y * eye_up;
    return origin;
#elif defined(EYE_PANORAMA)
    return eye_position;
#else
    precise vec2 q = eye_ahead * ((vec2(pixel + eye_corner) + 0.5 - eye_centre + beside) / eye_focal);
    precise vec3 origin = eye_position + q.x * eye_right + q.y * eye_up;
    return origin;
#endif
}

vec3 eye_origin(ivec2 pixel)
{
    return eye_origin(pixel, vec2(0.0));
}

// Converts a position to the eye's axes, relative to eye_position.
vec3 eye_from_world(vec3 position)
{
    vec3 r = position - eye_position;
    return vec3(dot(r, eye_right), dot(r, eye_up), dot(r, eye_forward));
}

// Clip coordinates of the window, for a rasteriser that samples at pixel centres; range: near and far distance from
// eye_position. Rounding never moves a depth from before the far plane to behind it.
vec4 clip_from_eye(vec3 p, vec2 range)
{
    vec2 middle = eye_centre - vec2(eye_corner);
#ifdef EYE_ORTHOGRAPHIC
    return vec4(2.0 * (eye_focal * p.xy + middle) / vec2(eye_size) - 1.0, 2.0 * p.z / range.y - 1.0, 1.0);
#else
    float depth = p.z + eye_ahead;
    vec2 xy = 2.0 * (eye_focal * p.xy + middle * depth) / vec2(eye_size) - depth;
    float beyond = 2.0 * (range.x + eye_ahead) * ((range.y - p.z) / (range.y - range.x));
    return vec4(xy, depth - beyond, depth);
#endif
}
