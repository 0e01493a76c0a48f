// split_light.glsl: of a sample's radiance, the direct light: what has met one surface at most on its way to the eye.
#ifdef SPLIT_LIGHT
vec3 direct_part = vec3(0.0);
#endif
