// split_light.glsl: direct part of a sample's radiance: light that at most one surface has reflected.
#ifdef SPLIT_LIGHT
vec3 direct_part = vec3(0.0);
#endif
