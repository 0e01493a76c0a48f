"""A few of many punctual lights for each point, by what they are worth near it: an estimate without bias."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64

Int64 = NDArray[np.int64]

#: Lights from which on points look at a few of them.
MANY = 9
#: Of those, samples of a point.
_SAMPLES = 4
# Of the chances: by what lights bring to a point of the row, by what they may bring near it, and all alike.
_BRINGS, _MAY_BRING, _ALIKE = 0.6, 0.35, 0.05
# Chances in a table, at most: of more, all points have those of their mean.
_MAX_CHANCES = 1 << 22


class LightChoice(NamedTuple):
    """Chances of lights, in rows.

    edges  : (R L,) running sums of the chances of row r, plus r
    lights : L
    """

    edges: Float64
    lights: int

    @classmethod
    def of(cls, brings: Float64, may_bring: Float64) -> LightChoice:
        """brings, may_bring : (R, L), what each light brings to a point of the row, and at most to any near it"""
        lights = brings.shape[1]
        if not brings.size or brings.size > _MAX_CHANCES:
            brings, may_bring = (each.sum(axis=0, keepdims=True) for each in (brings, may_bring))
        chances = _BRINGS * _shares(brings) + _MAY_BRING * _shares(may_bring) + _ALIKE / lights
        sums = np.cumsum(chances, axis=1)
        edges: Float64 = sums / sums[:, -1:] + np.arange(len(sums), dtype=np.float64)[:, None]
        return cls(edges.ravel(), lights)

    def draw(self, rows: Int64, random: np.random.Generator) -> tuple[Int64, Float64]:
        """(P, 4) lights for points of rows (P,), stratified, and what a sample of each counts."""
        if len(self.edges) == self.lights:
            rows = np.zeros_like(rows)
        u = (np.arange(_SAMPLES) + random.random((len(rows), _SAMPLES))) / _SAMPLES
        first = rows[:, None] * self.lights
        found = np.searchsorted(self.edges, rows[:, None] + u, side="right")
        found = np.clip(found, first, first + self.lights - 1)
        before = np.where(found > first, self.edges[found - 1], rows[:, None])
        return found - first, 1.0 / (_SAMPLES * (self.edges[found] - before))


def _shares(worth: Float64) -> Float64:
    """(R, L) of each row's sum; all alike where that is 0."""
    total = worth.sum(axis=1, keepdims=True)
    return np.asarray(np.where(total > 0, worth / np.maximum(total, np.finfo(float).tiny), 1.0 / worth.shape[1]))


class Chosen(NamedTuple):
    """The choice of points. rows : (P,) of `choice`"""

    choice: LightChoice
    rows: Int64
