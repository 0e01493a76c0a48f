"""Response of small receivers to light from a direction: irradiance for unit radiance and unit solid angle.

The response of a plane is the cosine of the angle to its normal, on one side. For a cylinder it is the mean over
planes around its axis: the sine of the angle to the axis over pi. For a sphere it is the mean over planes in all
directions, a quarter (EN 12464-1).
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

Receiver = Literal["plane", "cylinder", "sphere"]
RECEIVERS: tuple[Receiver, ...] = get_args(Receiver)


def response(receiver: Receiver, normals: Float64, directions: Float64) -> NDArray[np.float32]:
    """Return responses (N, D) float32 to unit directions (D, 3); unit normals (N, 3) are the axes of cylinders."""
    if receiver == "sphere":
        return np.full((len(normals), len(directions)), 0.25, np.float32)
    cosine = normals.astype(np.float32) @ directions.astype(np.float32).T
    if receiver == "plane":
        return np.asarray(np.maximum(cosine, np.float32(0.0)), np.float32)
    sine = np.sqrt(np.maximum(np.float32(0.0), np.float32(1.0) - cosine * cosine))
    return np.asarray(sine / np.float32(np.pi), np.float32)
