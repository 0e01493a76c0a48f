// lanes.glsl: maps a fragment to the pixel whose path it traces, and to the pixels that share its random numbers.
// Needs:  LANE_STRIDE: distance of these pixels; LANES: their number, across and up; image_window. Without LANE_STRIDE no
//         pixels share numbers
//
// A processor runs as many fragments as its vectors have lanes, and all wait for the slowest. With the same random numbers
// their paths are similar: the same lobe, the same light, the same length. If they were neighbours, a denoiser would take their
// correlated noise for image content. They are therefore pixels apart, and neighbours are independent.
#ifdef LANE_STRIDE
const ivec2 LANE_TILE = LANES * LANE_STRIDE;
#endif

// The pixel is within the window. At its ends, without room for a whole tile of lanes, it is the fragment's own.
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
