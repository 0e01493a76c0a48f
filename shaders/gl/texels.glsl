// texels.glsl: textures that are read texel by texel and never filtered.
//   TEXELS(format, name)       declares one of floats
//   UINT_TEXELS(format, name)  one of unsigned integers
//   texel(name, at)            fetches
// Where TEXELS_ARE_IMAGES is set they are images: llvmpipe calls a function of some 180 instructions for every
// texelFetch, but a third as many for imageLoad. Cards have too few units of images, and texture caches.
#ifdef TEXELS_ARE_IMAGES
#define TEXELS(format, name) layout(format) readonly uniform image2D name
#define UINT_TEXELS(format, name) layout(format) readonly uniform uimage2D name
#define texel(name, at) imageLoad(name, at)
#else
#define TEXELS(format, name) uniform sampler2D name
#define UINT_TEXELS(format, name) uniform usampler2D name
#define texel(name, at) texelFetch(name, at, 0)
#endif
