"""Choose a few of many punctual lights for each point, by their estimated irradiance near it, without bias."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64

Int64 = NDArray[np.int64]

#: Number of lights from which on a point samples only a few.
MANY = 9
#: Number of light samples of a point.
_SAMPLES = 4
# Weight of a light's irradiance at a point of the row, in the probability of the light.
_BRINGS = 0.6
# Weight of the bound of a light's irradiance near that point, in the same probability.
_MAY_BRING = 0.35
# Weight of a uniform choice in the same probability.
_ALIKE = 0.05
# Maximum number of probabilities in a table; larger tables are replaced by one row for all points.
_MAX_CHANCES = 1 << 22


class LightChoice(NamedTuple):
    """Probabilities of lights, in rows.

    edges  : (R L,) cumulative sums of the probabilities of row r, plus r
    lights : number L of lights
    """

    edges: Float64
    lights: int

    @classmethod
    def of(cls, brings: Float64, may_bring: Float64) -> LightChoice:
        """Build the probabilities from the lights' irradiances.

        brings, may_bring : (R, L), irradiance of each light at a point of the row, and its maximum near that point
        """
        lights = brings.shape[1]
        if not brings.size or brings.size > _MAX_CHANCES:
            brings, may_bring = (each.sum(axis=0, keepdims=True) for each in (brings, may_bring))
        chances = _BRINGS * _shares(brings) + _MAY_BRING * _shares(may_bring) + _ALIKE / lights
        sums = np.cumsum(chances, axis=1)
        edges: Float64 = sums / sums[:, -1:] + np.arange(len(sums), dtype=np.float64)[:, None]
        return cls(edges.ravel(), lights)

    def draw(self, rows: Int64, random: np.random.Generator) -> tuple[Int64, Float64]:
        """Return stratified lights (P, 4) for points of rows (P,), and the weight of each sample."""
        if len(self.edges) == self.lights:
            rows = np.zeros_like(rows)
        u = (np.arange(_SAMPLES) + random.random((len(rows), _SAMPLES))) / _SAMPLES
        first = rows[:, None] * self.lights
        found = np.searchsorted(self.edges, rows[:, None] + u, side="right")
        found = np.clip(found, first, first + self.lights - 1)
        before = np.where(found > first, self.edges[found - 1], rows[:, None])
        return found - first, 1.0 / (_SAMPLES * (self.edges[found] - before))


def _shares(worth: Float64) -> Float64:
    """Return (R, L), fractions of each row's sum; uniform if the sum is 0."""
    total = worth.sum(axis=1, keepdims=True)
    return np.asarray(np.where(total > 0, worth / np.maximum(total, np.finfo(float).tiny), 1.0 / worth.shape[1]))


class Chosen(NamedTuple):
    """Light choice of points.

    rows : (P,) row of `choice` for each point
    """

    choice: LightChoice
    rows: Int64
