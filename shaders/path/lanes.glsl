// lanes.glsl: which pixel's path a fragment traces, and with which pixels it shares its random numbers.
// Needs:  LANE_STRIDE: how far apart these are; LANES: how many, across and up; image_window. Without: each is its own
//
// A processor runs as many fragments as its vectors have lanes, and all wait for the one that takes longest. With the same
// random numbers their paths are alike: the same lobe, the same light, as long a path. Were they neighbours, a denoiser
// would take the noise they have in common for the picture; so they are pixels apart, and neighbours have nothing in common.
#ifdef LANE_STRIDE
const ivec2 LANE_TILE = LANES * LANE_STRIDE;
#endif

// Within the window; where no whole tile of lanes is left at its ends, the fragment's own.
ivec2 pixel_of_fragment(ivec2 fragment, ivec2 window_size)
{
#ifdef LANE_STRIDE
    ivec2 in_tile = fragment & (LANE_TILE - 1), start = fragment - in_tile;
    if (any(greaterThan(start + LANE_TILE, window_size))) return fragment;
    return start + (in_tile & (LANES - 1)) * LANE_STRIDE + in_tile / LANES;
#else
    return fragment;
#endif
}

// The number of a pixel's random numbers. By the whole image, so that a window has the bits of its part of the image.
uint shared_path(ivec2 pixel)
{
    ivec2 whole = pixel + image_window.xy;
#ifdef LANE_STRIDE
    ivec2 in_tile = whole & (LANE_TILE - 1);
    whole += (in_tile & (LANE_STRIDE - 1)) - in_tile;
#endif
    return uint(whole.y * image_window.z + whole.x);
}
