"""Photometric webs of files on the grid of a `LightProfile`: all planes of C, and steps that are alike.

Source: CIE 121, the planes of type C.
"""

from __future__ import annotations

import numpy as np

from glpath.scene.model import Float64
from glpath.scene.profile import LightProfile

#: Angles of each kind in a file: steps of a twentieth of a degree.
MAX_ANGLES = 7201
#: Values of a profile: in the file, and on its regular grid.
MAX_VALUES = 1 << 20
# The finest steps of the regular grid, parts of a degree; angles of files are multiples of such.
_PARTS = 100


def all_around(c: Float64, candela: Float64) -> tuple[Float64, Float64]:
    """Angles of C from 0 to 360, both included, and their candela, by symmetry where half or less is there.

    c       : (C,) degrees: 0 alone, 0 to 90, to 180 or to 360, or 90 to 270
    candela : (C, gamma)
    """
    if len(c) == 1:
        return np.array([0.0, 360.0]), np.concatenate([candela, candela])
    if c[0] == 90:  # alike on both sides of the plane through 90 and 270
        c, candela = _mirrored(c, candela, 270.0)  # from 90 to 450
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
    """On to the other side of an angle, the last one."""
    return np.append(c, 2 * at - c[-2::-1]), np.concatenate([candela, candela[-2::-1]])


def on_regular_grid(c: Float64, candela: Float64, gamma: Float64) -> LightProfile:
    """The profile of angles that are as they are: exact where they are multiples of a hundredth of a degree, as far
    as the grid may be so fine; else of finest steps."""
    span = (float(gamma[0]), float(gamma[-1]))
    rows = _steps(c, 360.0, 1440)
    columns = _steps(gamma, span[1] - span[0], max(1, MAX_VALUES // rows - 1))
    at = np.linspace(*span, columns + 1)
    along = np.stack([np.interp(at, gamma, row) for row in candela])
    around = np.arange(rows) * (360.0 / rows)
    grid = np.stack([np.interp(around, c, column) for column in along.T], axis=1)
    return LightProfile(np.ascontiguousarray(grid), span)


def _steps(angles: Float64, span: float, max_steps: int) -> int:
    """Into how many equal parts a span of angles is divided, so that each of them is at an end of one."""
    parts = np.rint(np.diff(angles) * _PARTS).astype(np.int64)
    if np.allclose(np.cumsum(parts) / _PARTS, angles[1:] - angles[0], rtol=0, atol=1e-6) and np.all(parts > 0):
        steps = round(span * _PARTS) // int(np.gcd.reduce(parts))
        if steps <= max_steps:
            return int(steps)
    return max_steps
