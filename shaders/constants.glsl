// constants.glsl: numbers that are nobody's choice.
const float PI = 3.14159265358979;
const float INFINITE_DEPTH = 1e30;
