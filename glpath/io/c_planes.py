"""Resample the intensities of a photometric file to the regular grid of a `LightProfile`, with all C planes.

Source: CIE 121, the system of C planes.
"""

from __future__ import annotations

import numpy as np

from glpath.scene.model import Float64
from glpath.scene.profile import LightProfile

#: Maximum number of C or gamma angles in a file: 360 degrees in steps of a twentieth of a degree.
MAX_ANGLES = 7201
#: Maximum number of intensities of a profile, both in the file and on the regular grid.
MAX_VALUES = 1 << 20
# Maximum number of grid steps per degree. Angles in files are usually multiples of a hundredth of a degree.
_PARTS = 100


def scaled(values: Float64, factor: float) -> Float64:
    """Return values >= 0 times a factor, either of which may be infinite; 0 times infinity is 0."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(values > 0, values * factor, 0.0)


def all_around(c: Float64, candela: Float64) -> tuple[Float64, Float64]:
    """Return C angles that begin at 0 and end at 360 degrees, and the candela in each plane.

    Planes that the file omits are mirror images of given planes. A single plane is used for all C angles.

    c       : (C,) degrees, one of the ranges 0 alone, 0 to 90, 0 to 180, 0 to 360, or 90 to 270
    candela : (C, gamma) intensities in the planes
    """
    if len(c) == 1:
        return np.array([0.0, 360.0]), np.concatenate([candela, candela])
    if c[0] == 90:  # symmetric about the plane through C = 90 and C = 270
        c, candela = _mirrored(c, candela, 270.0)  # C ranges from 90 to 450 degrees now
        c, candela = c[:-1] % 360.0, candela[:-1]
        order = np.argsort(c)
        c, candela = c[order], candela[order]
        if c[0] != 0:
            share = (360.0 - c[-1]) / (360.0 - c[-1] + c[0])
            c = np.insert(c, 0, 0.0)
            candela = np.insert(candela, 0, (1 - share) * candela[-1] + share * candela[0], axis=0)
        return np.append(c, 360.0), np.concatenate([candela, candela[:1]])
    for end in (90.0, 180.0):
        if c[-1] == end:
            c, candela = _mirrored(c, candela, end)
    return c, candela


def _mirrored(c: Float64, candela: Float64, at: float) -> tuple[Float64, Float64]:
    """Append the mirror image of each plane about `at`, which is the last angle; return all angles and candela."""
    return np.append(c, 2 * at - c[-2::-1]), np.concatenate([candela, candela[-2::-1]])


def on_regular_grid(c: Float64, candela: Float64, gamma: Float64) -> LightProfile:
    """Return the profile resampled to a regular grid.

    A grid has at most 1440 steps of the azimuth C, and `MAX_VALUES` intensities. If a grid within these limits
    contains all given angles, it is used. Otherwise the grid has the finest steps that the limits allow.

    c       : (C,) degrees, from 0 to 360
    candela : (C, gamma) intensities
    gamma   : (gamma,) degrees, ascending
    """
    span = (float(gamma[0]), float(gamma[-1]))
    rows = _steps(c, 360.0, 1440)
    columns = _steps(gamma, span[1] - span[0], max(1, MAX_VALUES // rows - 1))
    at = np.linspace(*span, columns + 1)
    along = np.stack([np.interp(at, gamma, row) for row in candela])
    around = np.arange(rows) * (360.0 / rows)
    grid = np.stack([np.interp(around, c, column) for column in along.T], axis=1)
    return LightProfile(np.ascontiguousarray(grid), span)


def _steps(angles: Float64, span: float, max_steps: int) -> int:
    """Return the smallest number of equal steps in `span` degrees such that every angle is a step boundary.

    Return `max_steps` if this takes steps smaller than a hundredth of a degree, or more than `max_steps` steps.
    """
    parts = np.rint(np.diff(angles) * _PARTS).astype(np.int64)
    if np.allclose(np.cumsum(parts) / _PARTS, angles[1:] - angles[0], rtol=0, atol=1e-6) and np.all(parts > 0):
        steps = round(span * _PARTS) // int(np.gcd.reduce(parts))
        if steps <= max_steps:
            return int(steps)
    return max_steps
