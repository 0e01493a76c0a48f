"""Order in which the pixels of a window are traced, so that the lanes of a vector share their random numbers.

Sharing changes neither the error of a pixel nor that of its neighbourhood, because pixels that share numbers are
`STRIDE` apart. benchmarks/experiments.md has the gain. See shaders/path/lanes.glsl.

Poor at:  averages of a few pixels that share numbers; therefore measurement points do not share any.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Fragments of a vector, across and up: two quads, for llvmpipe's eight lanes.
LANES = (4, 2)
#: Distance between pixels that share their random numbers, in pixels.
STRIDE = 8
#: Defines of programs that include path/lanes.glsl.
LANE_DEFINES: dict[str, object] = {"LANES": f"ivec2({LANES[0]}, {LANES[1]})", "LANE_STRIDE": STRIDE}


def fragments_of_pixels(size: tuple[int, int]) -> NDArray[np.int64]:
    """Return (h, w) the fragment that traces each pixel of a window, as y * w + x; row 0 at the bottom."""
    width, height = size
    columns = [LANES[0] * STRIDE, LANES[1] * STRIDE]
    fragment = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    in_tile = fragment % columns
    start = fragment - in_tile
    pixel = start + in_tile % LANES * STRIDE + in_tile // LANES
    whole = (start + columns <= size).all(axis=-1, keepdims=True)
    pixel = np.where(whole, pixel, fragment)
    found = np.empty((height, width), np.int64)
    found[pixel[..., 1], pixel[..., 0]] = fragment[..., 1] * width + fragment[..., 0]
    return found
