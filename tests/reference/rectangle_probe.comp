// rectangle_probe.comp: directions towards a rectangle and their density, for tests/gl/test_rectangle.py.
#include "sampling/rectangle.glsl"

layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Numbers { vec2 numbers[]; };
layout(std430, binding = 1) writeonly buffer Found { vec4 found[]; };  // directions and densities; two of each number
uniform vec3 corner, across, up, from;

void main()
{
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(numbers.length())) return;
    SeenRectangle r = seen_rectangle(corner, across, up, from);
    vec3 drawn = towards_rectangle(r, numbers[i]);
    found[2u * i] = vec4(drawn, rectangle_pdf(r, drawn));
    // And of a direction uniform on the sphere.
    float z = 1.0 - 2.0 * numbers[i].x;
    vec2 turned = cosine_sine(4.0 * numbers[i].y);
    vec3 any_direction = vec3(sqrt(max(1.0 - z * z, 0.0)) * turned, z);
    found[2u * i + 1u] = vec4(any_direction, rectangle_pdf(r, any_direction));
}
