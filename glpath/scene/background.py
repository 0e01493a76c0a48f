"""What the camera sees behind all shapes instead of the sky: plain, with a ground that catches the shadow."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Background:
    """A background of a colour of its own. It lights nothing, and no mirror and no solid glass shows it.

    radiance    : (3,) float64, linear Rec. 709; of a transparent one zeros
    transparent : pictures have an alpha channel instead of a background
    ground      : (3,) float64, a point of the ground, which only the eye sees: its radiance is the background's,
                  times the sky's light on it with the shapes' shadow over that without. None: there is no ground
    up          : (3,) float64 unit, the normal of the ground
    """

    radiance: Float64 = field(default_factory=lambda: np.zeros(3))
    transparent: bool = False
    ground: Float64 | None = None
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
