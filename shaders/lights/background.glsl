// background.glsl: background that the eye sees behind all shapes, `glpath.scene.background`: a colour, or the sky.
// Needs:  sky.glsl, if HAS_SKY is set or HAS_BACKGROUND is not
// Units:  radiance W sr^-1 m^-2, linear Rec. 709.
#if defined(HAS_BACKGROUND)
uniform vec3 background;

vec3 seen_behind(vec3 direction) { return background; }
#else
vec3 seen_behind(vec3 direction) { return sky(direction); }
#endif
