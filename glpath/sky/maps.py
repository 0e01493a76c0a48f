"""Environment maps of analytic skies: directions of texels, and irradiance of open ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.sky.sky import Environment, Sky

Float64 = NDArray[np.float64]

#: Default rows and columns of an analytic sky's environment map.
SKY_SIZE = (256, 512)
# Number of Gauss quadrature points between the centres of two rows, between which the filtered map is linear.
_POINTS = 8


def texel_directions(up: Float64, size: tuple[int, int] = SKY_SIZE) -> Float64:
    """Return the (h, w, 3) unit directions of an environment map's texel centres, without a rotation."""
    height, width = size
    rows = (np.arange(height) + 0.5) * (np.pi / height)
    turns = (0.5 - (np.arange(width) + 0.5) / width) * 2 * np.pi
    middle, left, up = Environment(np.zeros((1, 1, 3), np.float32), up).frame
    sine, cosine = np.sin(rows)[:, None, None], np.cos(rows)[:, None, None]
    around = np.cos(turns)[:, None] * middle + np.sin(turns)[:, None] * left
    return np.asarray(sine * around + cosine * up)


def open_ground(sky: Sky | Environment) -> Float64:
    """Return the (3,) irradiance of a surface that faces up and sees all of the sky above the horizon."""
    up = sky.up / np.linalg.norm(sky.up)
    height, width = SKY_SIZE
    nodes, weights = np.polynomial.legendre.leggauss(height)
    sine = 0.5 * (nodes + 1)  # sine of the elevation, of which equal steps have equal solid angles
    level = texel_directions(up, (2, width))[0]
    level -= (level @ up)[:, None] * up
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    along = np.sqrt(1 - sine**2)[:, None, None] * level + sine[:, None, None] * up
    seen = sky.radiance(along).mean(axis=1)
    return np.asarray(2 * np.pi * (0.5 * weights * sine) @ seen)


def horizontal_irradiance(seen: Float64) -> float:
    """Return the irradiance of a surface that faces up, from an environment map (h, w) of one channel.

    Only the upper half counts, filtered as if the map were cut at the horizon.
    """
    step = np.pi / len(seen)
    above = seen[: len(seen) // 2].mean(axis=1)
    u, weight = np.polynomial.legendre.leggauss(_POINTS)
    # Intervals from the zenith to the centre of the first row, from row to row, and from the last row to the
    # horizon.
    ends = np.concatenate([[0.0], (np.arange(len(above)) + 0.5) * step, [np.pi / 2]])
    half = 0.5 * np.diff(ends)[:, None]
    angle = ends[:-1, None] + half * (1 + u)
    mean = np.interp(angle / step - 0.5, np.arange(len(above)), above)
    return float(2 * np.pi * np.sum(half * weight * mean * np.sin(angle) * np.cos(angle)))
