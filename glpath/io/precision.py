"""Files whose vertices have 32 bits: far from the origin these are too far apart for the surfaces they are of."""

from __future__ import annotations

import numpy as np

from glpath.errors import warn
from glpath.scene.geometry import Float64

#: In diagonals of a file's geometry: a larger step between neighbouring numbers is reported.
COARSE = 1e-4


def step_at(low: Float64, high: Float64) -> float:
    """How far numbers of 32 bits are apart at the farther of two corners (3,), where it is farthest."""
    return float(np.spacing(np.float32(max(np.abs(low).max(), np.abs(high).max()))))


def warn_of_steps(source: object, step: float, low: Float64, high: Float64) -> None:
    """Warn where a step is coarse compared with the box between two corners (3,); `source` names the file."""
    if not step > COARSE * float(np.linalg.norm(high - low)):
        return
    farthest = max((*low, *high), key=abs)
    warn(
        f"{source} its vertices are numbers of 32 bits, which are {step:g} apart at {farthest:,.0f}, so far "
        f"from the origin: surfaces are off by up to {0.5 * step:g} scene units. Write the file nearer "
        "to it (glTF: with a translation of a node), or in a format with more digits: OBJ, or PLY of doubles."
    )
