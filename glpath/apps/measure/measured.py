"""Results of `glpath measure`, from which reports, pictures and models are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.apps.measure.points import Points

if TYPE_CHECKING:
    from glpath.rendering.points import Irradiance
    from glpath.rendering.uniformity import Spread
    from glpath.scene import Scene

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """Measured irradiance with its points and scene.

    at       : points of the measurement
    found    : measured irradiance
    scene    : measured scene
    quantity : name of the quantity, such as Illuminance
    unit     : "lx", or "%" for a daylight factor
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
        """Illuminance, (N,) float64, lx. A point without light is taken to be inside a solid and is NaN; if no
        point has light, all values are 0.
        """
        lux = self.found.illuminance()
        return np.where(lux > 0, lux, np.nan if (lux > 0).any() else 0.0)

    @property
    def dark(self) -> int:
        """Number of points without light; 0 if no point has light."""
        return int(np.count_nonzero(np.isnan(self.values)))

    @property
    def spread(self) -> Spread:
        """Statistics of the points that have light, or of all points if none has."""
        lit = ~np.isnan(self.values)
        return self.found.spread(None if lit.all() else lit)
