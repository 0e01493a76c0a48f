// camera.glsl: the pinhole camera, whose rays go one through each pixel; `glpath.gl.camera` sets it.
// Frame:  eye_right, eye_up, eye_forward unit; pixels of the whole image, y from the bottom, so that a picture in
//         tiles has the bits of the picture in one.
uniform vec3 eye_position;
uniform vec3 eye_right;
uniform vec3 eye_up;
uniform vec3 eye_forward;
uniform float eye_focal;   // pixels at distance 1
uniform vec2 eye_centre;   // the pixel position that eye_forward goes through, the sub-pixel position taken off
uniform ivec2 eye_corner;  // of the window in the image, pixels
uniform ivec2 eye_size;    // of the window, pixels

// Unit, through the sub-pixel position of a pixel of the window, and so many pixels beside it.
vec3 eye_direction(ivec2 pixel, vec2 beside)
{
    precise vec2 q = (vec2(pixel + eye_corner) + 0.5 - eye_centre + beside) / eye_focal;
    precise vec3 d = eye_forward + q.x * eye_right + q.y * eye_up;
    precise float scale = sqrt(dot(d, d));
    precise vec3 unit = d / scale;
    return unit;
}

vec3 eye_direction(ivec2 pixel)
{
    return eye_direction(pixel, vec2(0.0));
}

// From the world to the eye's axes, about the eye.
vec3 eye_from_world(vec3 position)
{
    vec3 r = position - eye_position;
    return vec3(dot(r, eye_right), dot(r, eye_up), dot(r, eye_forward));
}

// Clip coordinates of the window, whose rasteriser asks at the centres of pixels; near and far distance.
vec4 clip_from_eye(vec3 p, vec2 range)
{
    vec2 middle = eye_centre - vec2(eye_corner);
    vec2 xy = 2.0 * (eye_focal * p.xy + middle * p.z) / vec2(eye_size) - p.z;
    return vec4(xy, ((range.y + range.x) * p.z - 2.0 * range.y * range.x) / (range.y - range.x), p.z);
}
