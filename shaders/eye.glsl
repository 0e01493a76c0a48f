// eye.glsl: the pinhole camera, in the window of pixels that is rendered.
// Frame: eye_right, eye_up, eye_forward unit; gl_FragCoord.y counts from the bottom.
uniform vec3 eye_position;
uniform vec3 eye_right;
uniform vec3 eye_up;
uniform vec3 eye_forward;
uniform vec4 eye_window;  // xy: scale, zw: shift of window coordinates, the sub-pixel jitter included
uniform vec2 eye_size;    // window, pixels
uniform vec2 eye_range;   // near and far distance

// Through the centre of the fragment; its component along eye_forward is 1.
vec3 eye_direction(vec2 fragment)
{
    vec2 q = (2.0 * fragment / eye_size - 1.0 - eye_window.zw) / eye_window.xy;
    return eye_forward + q.x * eye_right + q.y * eye_up;
}
