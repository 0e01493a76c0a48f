"""What `glpath measure` has measured, where and of which scene: what reports, pictures and models are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.cli.point_files import Points

if TYPE_CHECKING:
    from glpath.rendering.points import Irradiance
    from glpath.rendering.uniformity import Spread
    from glpath.scene import Scene

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """All that a report, a picture or a model shows.

    at       : where
    found    : what
    scene    : of which, as it was measured
    quantity : such as Illuminance
    unit     : "lx", or "%" of a daylight factor, whose lux are per cent
    """

    at: Points
    found: Irradiance
    scene: Scene
    quantity: str
    unit: str = "lx"

    @property
    def title(self) -> str:
        return f"{self.quantity} in {self.scene.name}"

    @property
    def values(self) -> Float64:
        """(N,) lux, NaN at points without any light, which are inside of solids, as far as others have some."""
        lux = self.found.illuminance()
        return np.where(lux > 0, lux, np.nan if (lux > 0).any() else 0.0)

    @property
    def dark(self) -> int:
        """How many points have no light, of some that have."""
        return int(np.count_nonzero(np.isnan(self.values)))

    @property
    def spread(self) -> Spread:
        """Of the points that have light, or of all that have none."""
        lit = ~np.isnan(self.values)
        return self.found.spread(None if lit.all() else lit)
