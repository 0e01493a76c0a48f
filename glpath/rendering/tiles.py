"""The parts of an image that are traced one after another, as a device holds so many pixels at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

from glpath.buffers.path_buffer import MAX_PATHS


@dataclass(frozen=True)
class Tile:
    """A part of the image that is traced at once.

    window : (x, y, width, height) of what is traced, pixels of the whole image; every tile has the same size
    keep   : rows and columns of it that belong to the film
    target : where in the film these are
    """

    window: tuple[int, int, int, int]
    keep: tuple[slice, slice]
    target: tuple[slice, slice]


def cover(window: tuple[int, int, int, int], limit: int) -> list[Tile]:
    """Tiles of one size that cover the window; the last of a row or column overlaps the one before."""
    x0, y0, width, height = window
    side = min(limit, math.isqrt(MAX_PATHS))
    # A flat image may be as wide as the device allows.
    across = -(-width // side) if height > side else -(-width // min(limit, MAX_PATHS // height))
    w = -(-width // across)
    down = -(-height // min(limit, MAX_PATHS // w))
    h = -(-height // down)
    found = []
    for i in range(down):
        for j in range(across):
            x, y = min(j * w, width - w), min(i * h, height - h)
            # Columns x..j * w were the neighbour's.
            keep = slice(i * h - y, h), slice(j * w - x, w)
            target = slice(i * h, y + h), slice(j * w, x + w)
            found.append(Tile((x0 + x, y0 + y, w, h), keep, target))
    return found
