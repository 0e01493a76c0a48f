// lanes.glsl: maps a fragment to the pixel whose path it traces, and to the pixels that share its random numbers.
// Needs:  LANE_STRIDE: distance between pixels that share numbers; LANES: number of such pixels, across and up; image_window. Without LANE_STRIDE no
//         pixels share numbers
//
// A processor runs as many fragments at once as its vectors have lanes, and all lanes wait for the slowest. With the same random
// numbers, their paths are similar in lobe, light and length. A denoiser would take the correlated noise of neighbouring pixels
// for image content. The fragments of a vector are therefore pixels apart, and neighbours are independent.
#ifdef LANE_STRIDE
const ivec2 LANE_TILE = LANES * LANE_STRIDE;
#endif

// Returns the pixel of a fragment, inside the window. At the window's ends, without room for a whole tile of lanes, it is the
// pixel of the fragment itself.
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

// Index of a pixel's random numbers. It refers to the whole image, so that a window has the same bits as that part of the
// image.
uint shared_path(ivec2 pixel)
{
    ivec2 whole = pixel + image_window.xy;
#ifdef LANE_STRIDE
    ivec2 in_tile = whole & (LANE_TILE - 1);
    whole += (in_tile & (LANE_STRIDE - 1)) - in_tile;
#endif
    return uint(whole.y * image_window.z + whole.x);
}
