"""A test case: a scene, the points to measure, their exact values, and the measurement."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import glpath
from benchmarks.cie171.exact import Float64
from glpath.system.colour import luminance
from glpath.system.units import conversion

#: A value may be off by this fraction of the exact one, or by this number of standard errors if those are small.
TOLERANCE, ERRORS = 0.01, 3.0
#: Number of paths of the first round, for each copy of a point.
_FIRST = 64
#: Limits below which an exact and a measured value count as 0, as fractions of the case's largest exact value.
#: A shadow ray ends a little before the lamp, so a lamp's edge shines through a wall that it touches.
_DARK, _MEASURED_DARK = 1e-6, 1e-3


@dataclass(frozen=True, eq=False)
class Case:
    """One scene of a test case, and the points to measure in it.

    number  : number of the case in the report, such as 5.9
    variant : name of the scene among those of the case
    scene   : description of a scene for `glpath.irradiance`, with unit "photometric"
    points  : (N, 3); their normals are (N, 3)
    names   : names of the values, as in the report
    exact   : (M,) exact values, in `unit`
    sum     : (M, N) weights of the points' illuminances in each value; None: the values are the illuminances
    sky     : number of the sky, 1 to 16; 0: no sky
    copies  : number of copies of each point, each of which gets other paths
    """

    number: str
    variant: str
    scene: Any
    points: Float64
    normals: Float64
    names: tuple[str, ...]
    exact: Float64
    unit: str = "lx"
    sum: Float64 | None = None
    sky: int = 0
    copies: int = 64
    options: dict[str, Any] = field(default_factory=lambda: {"max_depth": 1})

    @property
    def name(self) -> str:
        return f"{self.number}, {self.variant}" + (f", sky {self.sky}" if self.sky else "")

    def measured(self, target: float = 0.003, limit: int = 4096, seed: int = 171) -> Measured:
        """Measure with `glpath.irradiance`, doubling the number of paths until the error is small enough.

        target : largest relative standard error to accept
        limit  : largest number of paths for each copy of a point
        """
        points, normals = (np.repeat(each, self.copies, axis=0) for each in (self.points, self.normals))
        spp, film = _FIRST, None
        while True:
            how = {"spp": spp, "seed": seed, "film": film, **self.options}
            found = glpath.irradiance(self.scene, points, normals, **how)
            measured = self._batches(found)
            if spp >= limit or measured.largest_error <= target:
                return measured
            spp, film = 2 * spp, found.film

    def _batches(self, found: glpath.Irradiance) -> Measured:
        counts = found.film.batch_counts
        used = counts > 0
        lux = luminance(found.film.radiance_sums[used]).reshape(int(used.sum()), -1)[:, : found.count]
        lux = conversion(found.unit, "photometric") * np.pi * lux / counts[used][:, None]
        batches = lux.reshape(len(lux), -1, self.copies).mean(axis=2)
        if self.sum is not None:
            batches = batches @ self.sum.T
        return Measured(self, batches)


@dataclass(frozen=True, eq=False)
class Measured:
    """The values of a case, from independent batches of equally many path sets.

    batches : (B, M)
    """

    case: Case
    batches: Float64

    @cached_property
    def values(self) -> Float64:
        """Return (M,) means over the batches."""
        return np.asarray(self.batches.mean(axis=0))

    @cached_property
    def errors(self) -> Float64:
        """Return (M,) standard errors of the values."""
        return np.asarray(self.batches.std(axis=0, ddof=1) / np.sqrt(len(self.batches)))

    @property
    def lit(self) -> NDArray[np.bool_]:
        """Return (M,) booleans: whether the exact value is above 0."""
        return np.asarray(self.case.exact > _DARK * self.case.exact.max())

    @property
    def largest_error(self) -> float:
        """Return the largest relative standard error of the values that are lit."""
        return float((self.errors[self.lit] / self.case.exact[self.lit]).max())

    @property
    def off(self) -> Float64:
        """Return (M,) relative errors; those of dark values are relative to the largest value of the case."""
        whole = np.where(self.lit, self.case.exact, self.case.exact.max())
        return np.asarray((self.values - self.case.exact) / whole)

    @property
    def passes(self) -> NDArray[np.bool_]:
        """Return (M,) booleans: whether each value passes.

        A lit value must be within 1 %, or within three standard errors of at most 1 % each. A dark value must be
        measured as dark.
        """
        exact, found, errors = self.case.exact, np.abs(self.values - self.case.exact), self.errors
        near = found <= TOLERANCE * exact
        chance = (errors <= TOLERANCE * exact) & (found <= ERRORS * errors)
        return np.asarray(np.where(self.lit, near | chance, self.values <= _MEASURED_DARK * exact.max()))

    def row(self) -> dict[str, Any]:
        """Return a row of a report, with numbers of five digits."""
        lists = {"exact": self.case.exact, "value": self.values, "error": self.errors}
        return {
            "case": self.case.number,
            "variant": self.case.variant,
            "sky": self.case.sky or "",
            "values": len(self.values),
            "off, %": float(100 * np.abs(self.off).max()),
            "error, %": 100 * self.largest_error,
            "missed": int(np.count_nonzero(~self.passes)),
            "unit": self.case.unit,
            "names": list(self.case.names),
            **{name: [float(f"{x:.5g}") for x in each] for name, each in lists.items()},
        }
