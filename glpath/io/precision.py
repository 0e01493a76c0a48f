"""Warnings for 32-bit vertices far from the origin, where the spacing of numbers is too coarse for surfaces."""

from __future__ import annotations

import numpy as np

from glpath.errors import warn
from glpath.scene.geometry import Float64

#: Maximum spacing of 32-bit numbers, as a fraction of the geometry's diagonal. Above it a warning is printed.
COARSE = 1e-4


def step_at(low: Float64, high: Float64) -> float:
    """Return the spacing of 32-bit numbers at the largest absolute coordinate of a box with corners (3,)."""
    return float(np.spacing(np.float32(max(np.abs(low).max(), np.abs(high).max()))))


def warn_of_steps(source: object, step: float, low: Float64, high: Float64) -> None:
    """Warn if the spacing `step` is coarse compared with the box of corners (3,); `source` names the file."""
    if not step > COARSE * float(np.linalg.norm(high - low)):
        return
    farthest = max((*low, *high), key=abs)
    warn(
        f"{source} its vertices are numbers of 32 bits, which are {step:g} apart at {farthest:,.0f}, so far "
        f"from the origin: surfaces are off by up to {0.5 * step:g} scene units. Write the file nearer "
        "to it (glTF: with a translation of a node), or in a format with more digits: OBJ, or PLY of doubles."
    )
