// split_light.glsl: of a sample's radiance, the direct light: reflected by one surface at most.
#ifdef SPLIT_LIGHT
vec3 direct_part = vec3(0.0);
#endif
