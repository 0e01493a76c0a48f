"""Choose a few of many punctual lights for each point, without bias, by each light's irradiance near the point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64

Int64 = NDArray[np.int64]

#: Minimum number of punctual lights; with fewer, a point uses all lights instead of sampling a few.
MANY = 9
#: Number of lights sampled per point.
_SAMPLES = 4
# The probability of a light is a weighted sum of three terms, whose weights add up to 1.
# Weight of the light's irradiance at the row's point, as a fraction of all lights' irradiance there.
_BRINGS = 0.6
# Weight of an approximate maximum of the light's irradiance near that point, as a fraction of all lights' maxima.
_MAY_BRING = 0.35
# Weight of a uniform choice.
_ALIKE = 0.05
# Maximum number of probabilities in a table; larger tables are replaced by one row for all points.
_MAX_CHANCES = 1 << 22


class LightChoice(NamedTuple):
    """Probabilities of lights, in R rows.

    edges  : (R * L,) cumulative probabilities of each row; r is added to those of row r, so that all ascend
    lights : number L of lights
    """

    edges: Float64
    lights: int

    @classmethod
    def of(cls, brings: Float64, may_bring: Float64) -> LightChoice:
        """Build the probabilities from the lights' irradiances.

        brings    : (R, L) irradiance by each light at the point that a row stands for
        may_bring : (R, L) approximate maximum of this irradiance near the point
        """
        lights = brings.shape[1]
        if shares_row(len(brings), lights):
            brings, may_bring = (each.sum(axis=0, keepdims=True) for each in (brings, may_bring))
        chances = _BRINGS * _shares(brings) + _MAY_BRING * _shares(may_bring) + _ALIKE / lights
        sums = np.cumsum(chances, axis=1)
        edges: Float64 = sums / sums[:, -1:] + np.arange(len(sums), dtype=np.float64)[:, None]
        return cls(edges.ravel(), lights)

    def draw(self, rows: Int64, random: np.random.Generator) -> tuple[Int64, Float64]:
        """Draw four lights per point, stratified; return their indices (P, 4) and weights (P, 4).

        rows : (P,) row of probabilities for each point
        """
        if len(self.edges) == self.lights:
            rows = np.zeros_like(rows)
        u = (np.arange(_SAMPLES) + random.random((len(rows), _SAMPLES))) / _SAMPLES
        first = rows[:, None] * self.lights
        found = np.searchsorted(self.edges, rows[:, None] + u, side="right")
        found = np.clip(found, first, first + self.lights - 1)
        before = np.where(found > first, self.edges[found - 1], rows[:, None])
        return found - first, 1.0 / (_SAMPLES * (self.edges[found] - before))


def shares_row(points: int, lights: int) -> bool:
    """Return True if one row stands for all points, because a row for each would be too large a table, or none."""
    return not 0 < points * lights <= _MAX_CHANCES


def _shares(worth: Float64) -> Float64:
    """Return (R, L), fractions of each row's sum; uniform if the sum is 0."""
    total = worth.sum(axis=1, keepdims=True)
    return np.asarray(np.where(total > 0, worth / np.maximum(total, np.finfo(float).tiny), 1.0 / worth.shape[1]))


class Chosen(NamedTuple):
    """Light choice for some points.

    choice : probabilities of the lights
    rows   : (P,) row of `choice` for each point
    """

    choice: LightChoice
    rows: Int64
