"""Split an image into tiles that are traced one after another, because devices hold a limited number of pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

from glpath.buffers.path_buffer import MAX_PATHS


@dataclass(frozen=True)
class Tile:
    """Part of the image that is traced at once.

    window : (x, y, width, height) of the traced pixels in the whole image; every tile has the same size
    keep   : rows and columns of the window that are added to the film
    target : rows and columns of the film to which they are added
    """

    window: tuple[int, int, int, int]
    keep: tuple[slice, slice]
    target: tuple[slice, slice]


def cover(window: tuple[int, int, int, int], limit: int) -> list[Tile]:
    """Return tiles of one size that cover the window.

    The last tile in a row or column of tiles overlaps the tile before it.
    """
    x0, y0, width, height = window
    side = min(limit, math.isqrt(MAX_PATHS))
    # A tile of a low image may be as wide as the device's limit.
    across = -(-width // side) if height > side else -(-width // min(limit, MAX_PATHS // height))
    w = -(-width // across)
    down = -(-height // min(limit, MAX_PATHS // w))
    h = -(-height // down)
    found = []
    for i in range(down):
        for j in range(across):
            x, y = min(j * w, width - w), min(i * h, height - h)
            # The tile overlaps its left neighbour in columns x to j * w, and its upper neighbour likewise. The
            # neighbours keep the shared pixels.
            keep = slice(i * h - y, h), slice(j * w - x, w)
            target = slice(i * h, y + h), slice(j * w, x + w)
            found.append(Tile((x0 + x, y0 + y, w, h), keep, target))
    return found
