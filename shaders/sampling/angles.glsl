// angles.glsl: sine, cosine, tangent and arc tangent from sums and products only.
// GLSL guarantees no accuracy for its own functions. A driver may implement them by those of Vulkan, whose errors
// are 2^-11 for sin and cos and 4096 ULP for atan. A lookup could then miss the cell of its ray in a shadow-buffer.
// The functions here have errors below 3e-7 everywhere, and equal results on devices with equal sums and products.
// Source: Moshier 1989, Cephes Mathematical Library (sinf, cosf, atanf).
#include <CONSTANTS>

// (cosine, sine) of an angle that is given in right angles. It is first reduced to at most half a right angle,
// without rounding.
vec2 cosine_sine(float right_angles)
{
    float nearest = floor(right_angles + 0.5);
    float x = (right_angles - nearest) * (0.5 * PI), z = x * x;
    float sine = ((-1.9515295891e-4 * z + 8.3321608736e-3) * z - 1.6666654611e-1) * z * x + x;
    float cosine = ((2.443315711809948e-5 * z - 1.388731625493765e-3) * z + 4.166664568298827e-2) * z * z - 0.5 * z + 1.0;
    int quarter = int(nearest) & 3;
    vec2 turned = (quarter & 1) == 0 ? vec2(cosine, sine) : vec2(-sine, cosine);
    return quarter >= 2 ? -turned : turned;
}

float tangent(float right_angles)
{
    vec2 f = cosine_sine(right_angles);
    return f.y / f.x;
}

// Arc tangent of x in [-1, 1]; radians, in [-pi/4, pi/4].
float arc_tangent(float x)
{
    float a = abs(x);
    bool upper = a > 0.41421356;  // tan pi/8
    float q = upper ? (a - 1.0) / (a + 1.0) : a, z = q * q;
    float angle = (((8.05374449538e-2 * z - 1.38776856032e-1) * z + 1.99777106478e-1) * z - 3.33329491539e-1) * z * q + q;
    if (upper) angle += 0.25 * PI;
    return x < 0.0 ? -angle : angle;
}

// Angle of the direction (x, y); radians, in [-pi, pi]; 0 for a zero vector.
float arc_tangent(float y, float x)
{
    float a = abs(x), b = abs(y), longer = max(a, b);
    float angle = longer > 0.0 ? arc_tangent(min(a, b) / longer) : 0.0;
    if (b > a) angle = 0.5 * PI - angle;
    if (x < 0.0) angle = PI - angle;
    return y < 0.0 ? -angle : angle;
}
