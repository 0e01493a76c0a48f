// classic_eye.frag: primary rays by the classical algorithm: each against every primitive.
// Writes what a T-buffer holds: primitive + 1 (0 for none) and t.
#include <SCENE>
#include "object_classic.glsl"
#include "object_eye.glsl"

#ifdef COUNT_TESTS
layout(std430, binding = 0) buffer Tests { uint tests_of_pixel[]; };
#endif

layout(location = 0) out vec2 found;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float t;
    int primitive = nearest_classic(eye_position, eye_direction(pixel), 0.0, -1, t);
    found = vec2(primitive + 1, t);
#ifdef COUNT_TESTS
    tests_of_pixel[pixel.y * eye_size.x + pixel.x] += tests;
#endif
}
