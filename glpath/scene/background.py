"""What the camera sees behind all shapes instead of the sky: plain, with a ground that catches the shadow."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Background:
    """A background of a colour of its own. It lights nothing, and no mirror and no solid glass shows it.

    radiance    : (3,) float64, linear Rec. 709; of a transparent one zeros
    transparent : pictures have an alpha channel instead of a background
    """

    radiance: Float64 = field(default_factory=lambda: np.zeros(3))
    transparent: bool = False
