// constants.glsl: numbers that are nobody's choice.
const float PI = 3.14159265358979;
const float INFINITE_DEPTH = 1e30;
// Bits of the least float that is not denormal. Integers from here on are floats of the same order, which blending keeps.
const uint LEAST_NORMAL = 0x00800000u;
