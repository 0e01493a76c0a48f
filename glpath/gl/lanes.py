"""Lanes of a vector that share their random numbers: the order in which the pixels of a window are traced.

A pixel's error is what it was, and so is that of its neighbourhood, as the pixels that share numbers are `STRIDE`
apart. benchmarks/experiments.md has what it is worth. See shaders/path/lanes.glsl.

Poor at:  means over a few pixels that happen to share numbers; so points that are measured do not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Fragments of a vector, across and up: two quads of llvmpipe's eight lanes.
LANES = (4, 2)
#: How far apart the pixels are that share their random numbers.
STRIDE = 8
#: The defines of programs that include path/lanes.glsl.
LANE_DEFINES: dict[str, object] = {"LANES": f"ivec2({LANES[0]}, {LANES[1]})", "LANE_STRIDE": STRIDE}


def fragments_of_pixels(size: tuple[int, int]) -> NDArray[np.int64]:
    """(h, w) the fragment that traces each pixel of a window, as y * w + x; row 0 at the bottom."""
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
