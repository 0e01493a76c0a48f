"""Find faces that overlap on a page. Texture coordinates of a file may overlap; those of a new atlas never do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.system.kernels import kernel


def overlapping(uv: NDArray[np.float64], size: tuple[int, int]) -> tuple[int, int] | None:
    """Return two faces of a page that contain the centre of the same texel, or None.

    uv   : (F, 3, 2) coordinates of the faces' corners, texels
    size : width and height of the page, texels
    """
    width, height = size
    first = np.full((height, width), -1, np.int32)
    found = np.zeros(2, np.int32)
    return (int(found[0]), int(found[1])) if _twice(uv, first, found) else None


@kernel
def _twice(uv, first, found):  # type: ignore[no-untyped-def]
    """Return True if the centre of a texel is well inside two faces, and store their indices in `found`."""
    height, width = first.shape
    for f in range(len(uv)):
        x0, y0, x1, y1, x2, y2 = uv[f, 0, 0], uv[f, 0, 1], uv[f, 1, 0], uv[f, 1, 1], uv[f, 2, 0], uv[f, 2, 1]
        doubled = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if doubled == 0:
            continue
        for row in range(max(int(min(y0, y1, y2)), 0), min(int(max(y0, y1, y2)) + 1, height)):
            for column in range(max(int(min(x0, x1, x2)), 0), min(int(max(x0, x1, x2)) + 1, width)):
                px, py = column + 0.5, row + 0.5
                e1 = ((px - x0) * (y2 - y0) - (x2 - x0) * (py - y0)) / doubled
                e2 = ((x1 - x0) * (py - y0) - (px - x0) * (y1 - y0)) / doubled
                if e1 > 1e-4 and e2 > 1e-4 and e1 + e2 < 1 - 1e-4:
                    if first[row, column] >= 0:
                        found[0], found[1] = first[row, column], f
                        return True
                    first[row, column] = f
    return False
