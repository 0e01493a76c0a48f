// lanes.glsl: maps a fragment to the pixel whose path it traces, and to the pixels that share its random numbers.
// Needs:  LANE_STRIDE: distance in pixels between pixels that share random numbers; without it, no pixels share
//         them
//         LANES: number of pixels that share random numbers, horizontally and vertically; image_window
//
// A processor runs as many fragments at once as its vectors have lanes, and all lanes wait for the slowest. With the same random
// numbers, their paths are similar in lobe, light and length. A denoiser would take the correlated noise of neighbouring pixels
// for image content. The fragments of a vector are therefore pixels apart, and neighbours are independent.
#ifdef LANE_STRIDE
const ivec2 LANE_TILE = LANES * LANE_STRIDE;
#endif

// Returns the pixel whose path a fragment traces, inside the window. If a whole tile of lanes would extend beyond
// the window, it is the fragment's own pixel.
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

// Returns the index that selects a pixel's random numbers. It is computed from coordinates in the whole image, so a
// window rendered alone has the same bits as that part of the whole image.
uint shared_path(ivec2 pixel)
{
    ivec2 whole = pixel + image_window.xy;
#ifdef LANE_STRIDE
    ivec2 in_tile = whole & (LANE_TILE - 1);
    whole += (in_tile & (LANE_STRIDE - 1)) - in_tile;
#endif
    return uint(whole.y * image_window.z + whole.x);
}
