// texels.glsl: textures that are read texel by texel and never filtered.
//   TEXELS(format, name)       declares a texture of floats
//   UINT_TEXELS(format, name)  declares a texture of unsigned integers
//   texel(name, at)            fetches a texel
// With TEXELS_ARE_IMAGES they are images, because llvmpipe calls a function of some 180 instructions for every
// texelFetch, and only a third as many for imageLoad. On graphics cards they stay textures, because these have too
// few image units, and have texture caches.
#ifdef TEXELS_ARE_IMAGES
#define TEXELS(format, name) layout(format) readonly uniform image2D name
#define UINT_TEXELS(format, name) layout(format) readonly uniform uimage2D name
#define texel(name, at) imageLoad(name, at)
#else
#define TEXELS(format, name) uniform sampler2D name
#define UINT_TEXELS(format, name) uniform usampler2D name
#define texel(name, at) texelFetch(name, at, 0)
#endif
