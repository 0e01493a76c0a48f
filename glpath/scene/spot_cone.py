"""The edge of a spot, between the cosines of the angles of full light and of its end.

Source: the glTF extension KHR_lights_punctual, "Inner and Outer Cone Angles".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]


def spot_fade(cosine: ArrayLike, full: ArrayLike, end: ArrayLike) -> Float64:
    """Fraction of a spot's intensity; `punctual.glsl` is the same for the GPU.

    cosine : of the angle to the axis
    full   : cosine of the angle up to which there is full light
    end    : cosine of the angle beyond which there is none
    """
    cosine, full, end = (np.asarray(each, np.float64) for each in (cosine, full, end))
    share = np.clip((cosine - end) / np.where(full > end, full - end, 1.0), 0.0, 1.0)
    return np.asarray(np.where(full > end, share**2, cosine >= end))


def spot_solid_angle(cone: tuple[float, float]) -> float:
    """Flux of a spot over its intensity, sr: the integral of `spot_fade`. cone: degrees of full light and end."""
    full, end = np.cos(np.radians(cone))
    return float(2.0 * np.pi * (1.0 - full + (full - end) / 3.0))
