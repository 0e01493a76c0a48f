"""Background that the camera sees instead of the sky: a colour, with a ground that catches shadows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glpath.system.arguments import checked_fields
from glpath.system.vectors import vector

Float64 = NDArray[np.float64]


@checked_fields
@dataclass(frozen=True, eq=False)
class Background:
    """Background with its own colour. It emits no light, and mirrors and solid glass do not show it.

    radiance    : (3,) float64, linear Rec. 709; zeros for a transparent background
    transparent : True if images have an alpha channel instead of a background
    ground      : (3,) float64, a point of the ground, or None for no ground. Only the camera sees the ground. Its
                  radiance is that of the background, times the ratio of sky light with the shapes' shadows to sky
                  light without them
    up          : (3,) float64 unit, the normal of the ground

    Raises SceneError for vectors of another shape, negative radiance, and numbers that are not finite.
    """

    radiance: Float64 = field(default_factory=lambda: np.zeros(3))
    transparent: bool = False
    ground: Float64 | None = None
    up: Float64 = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))

    def __post_init__(self) -> None:
        object.__setattr__(self, "radiance", vector("Background.radiance", self.radiance, 0.0))
        for name in ("ground", "up"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, vector(f"Background.{name}", getattr(self, name)))
