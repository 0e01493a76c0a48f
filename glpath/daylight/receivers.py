"""What small receivers make of light from a direction: irradiance for unit radiance and solid angle.

A plane has the cosine of the angle to its normal, on one side. A cylinder has the mean over all directions across
its axis, the sine of the angle to it over pi; a sphere the mean over all directions, a quarter (EN 12464-1).
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

Receiver = Literal["plane", "cylinder", "sphere"]
RECEIVERS: tuple[Receiver, ...] = get_args(Receiver)


def response(receiver: Receiver, normals: Float64, directions: Float64) -> NDArray[np.float32]:
    """(N, D) float32, of normals (N, 3), a cylinder's axes, and directions (D, 3), all unit."""
    if receiver == "sphere":
        return np.full((len(normals), len(directions)), 0.25, np.float32)
    cosine = normals.astype(np.float32) @ directions.astype(np.float32).T
    if receiver == "plane":
        return np.asarray(np.maximum(cosine, np.float32(0.0)), np.float32)
    sine = np.sqrt(np.maximum(np.float32(0.0), np.float32(1.0) - cosine * cosine))
    return np.asarray(sine / np.float32(np.pi), np.float32)
