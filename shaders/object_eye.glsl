// object_eye.glsl: the pinhole camera that rays are shot from, one through each pixel.
// Frame:  eye_right, eye_up, eye_forward unit; pixels of the whole image, y from the bottom, so that a picture in
//         tiles has the bits of the picture in one.
uniform vec3 eye_position;
uniform vec3 eye_right;
uniform vec3 eye_up;
uniform vec3 eye_forward;
uniform float eye_focal;   // pixels at distance 1
uniform vec2 eye_centre;   // the pixel place that eye_forward goes through, the sub-pixel position taken off
uniform ivec2 eye_corner;  // of the window in the image, pixels
uniform ivec2 eye_size;    // of the window, pixels

// Unit, through the sub-pixel position of a pixel of the window.
vec3 eye_direction(ivec2 pixel)
{
    precise vec2 q = (vec2(pixel + eye_corner) + 0.5 - eye_centre) / eye_focal;
    precise vec3 d = eye_forward + q.x * eye_right + q.y * eye_up;
    precise float scale = sqrt(dot(d, d));
    precise vec3 unit = d / scale;
    return unit;
}
