// classic_eye.frag: primary rays by the classical algorithm: every ray is tested against every primitive, one range
// of primitives for each draw. Writes the contents of a T-buffer: number of the primitive + 1 (0 for none), and the
// bits of t. Between draws the depth test keeps the nearest hit, by t * DEPTH_SCALE, which has all bits of t.
#include <SCENE>
#include "scene/object_classic.glsl"
#include "camera/camera.glsl"

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };
#endif

uniform int begin;  // first primitive of this draw
uniform int end;    // index after the last primitive of this draw

layout(location = 0) out uvec2 found;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float t;
#ifdef HAS_ALPHA
    new_opacity_key(pixel + eye_corner, 0u);
#endif
    int primitive = nearest_of(begin, end, eye_origin(pixel), eye_direction(pixel), 0.0, -1, t);
#ifdef COUNT_TESTS
    tests_of_pixel[pixel.y * eye_size.x + pixel.x] += tests;
#endif
    if (primitive < 0) discard;
    found = uvec2(primitive + 1, floatBitsToUint(t));
    gl_FragDepth = t * DEPTH_SCALE;
}
