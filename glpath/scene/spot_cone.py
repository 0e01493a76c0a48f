"""Fading of a spot's light between the angle of full light and the angle at which the light ends.

Source: the glTF extension KHR_lights_punctual, "Inner and Outer Cone Angles".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]


def spot_fade(cosine: ArrayLike, full: ArrayLike, end: ArrayLike) -> Float64:
    """Return the fraction of a spot's intensity in a direction; `punctual.glsl` is the GPU version.

    cosine : cosine of the angle between direction and axis
    full   : cosine of the angle up to which the light is full
    end    : cosine of the angle beyond which there is no light
    """
    cosine, full, end = (np.asarray(each, np.float64) for each in (cosine, full, end))
    share = np.clip((cosine - end) / np.where(full > end, full - end, 1.0), 0.0, 1.0)
    return np.asarray(np.where(full > end, share**2, cosine >= end))


def spot_solid_angle(cone: tuple[float, float]) -> float:
    """Return the integral of `spot_fade`, which is the ratio of a spot's flux to its intensity, sr.

    cone : angles of full light and of the end, degrees
    """
    full, end = np.cos(np.radians(cone))
    return float(2.0 * np.pi * (1.0 - full + (full - end) / 3.0))
