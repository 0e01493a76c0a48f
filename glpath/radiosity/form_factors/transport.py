"""Transport of light between the surfaces of a mesh: patches shoot, elements receive, form factors are cached.

The solvers for progressive refinement and for the full matrix share this code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.form_factors.form_factor import FormFactors, Kind, ReceiverPoints
from glpath.radiosity.form_factors.lights import DirectLight
from glpath.radiosity.mesh.mesh import Int64, Mesh
from glpath.radiosity.mesh.sides import Sides
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.options import ShaftOptions, Statistics
from glpath.radiosity.shafts.visibility import Visibility
from glpath.scene.model import Float64
from glpath.system.machine import core_count

Float32 = NDArray[np.float32]

#: Minimum number of pairs of receiver point and emitter in a call, below which overhead dominates its time.
_WORTH_A_CALL = 100_000
_MAX_TOGETHER = 64
#: Minimum fraction of an element's area that counts as unburied, so that no element has the area 0.
_BURIED = 1e-6


@dataclass(frozen=True)
class FormFactorOptions:
    """Options of form factors, see `glpath.radiosity.form_factors.form_factor`.

    kind   : "polygon" or "disc"
    max_samples   : maximum number of samples of an emitter
    points : number of points of a receiver
    """

    kind: Kind = "polygon"
    max_samples: int = 25
    points: int = 4


class Transport:
    """Form factors from the elements of a mesh to its patches; each column belongs to one side of a patch.

    Parameters
    ----------
    mesh  : patches and elements
    cache : maximum size of cached columns in bytes; the oldest are removed first
    shafts : options of the search for occluders

    Attributes
    ----------
    sides    : Q sides of the patches, which shoot
    areas    : (Q,) areas of these sides without parts buried in solids
    elements : R sides of the elements, which receive
    patch    : (R,) index of the patch's side that each element's side is part of
    share    : (R,) unburied area of each element's side, as a fraction of the area of its patch's side
    """

    def __init__(
        self, mesh: Mesh, options: FormFactorOptions, cache: int, shafts: ShaftOptions | None = None
    ) -> None:
        scene = mesh.scene
        self.mesh = mesh
        self.cache = cache
        self.statistics = Statistics()
        self.sides = Sides.of(scene, mesh.patches)
        self.areas: Float64 = np.zeros(len(self.sides))
        self.elements = Sides.of(scene, mesh.elements)
        together = _WORTH_A_CALL // max(1, len(self.elements) * options.points)
        self.form_factors = FormFactors(
            scene,
            # One thread, because `FormFactors` already processes several batches of emitters in threads.
            Visibility(Occluders.of_scene(scene, culling=True), shafts or ShaftOptions(), threads=1),
            mesh.patches,
            self.sides,
            kind=options.kind,
            max_samples=options.max_samples,
            points=options.points,
            together=min(max(1, together), _MAX_TOGETHER),
        )
        self._lights = DirectLight(scene)
        self._columns: dict[int, Float32] = {}
        self._at = self._receive()

    def _receive(self) -> ReceiverPoints:
        """Return receiver points on the elements' sides, and update `elements`, `patch`, `areas` and `share`."""
        mesh = self.mesh
        self.elements = Sides.of(mesh.scene, mesh.elements)
        number = self.sides.number(len(mesh.patches))
        self.patch = number[mesh.patch[self.elements.element], self.elements.back]
        at = self.form_factors.receivers(mesh.elements, self.elements)
        areas = mesh.areas[self.elements.element] * np.maximum(at.open, _BURIED)
        self.areas = np.bincount(self.patch, areas, minlength=len(self.sides)).astype(np.float64)
        self.share = areas / self.areas[self.patch]
        return at

    def from_lights(self) -> Float64:
        """Return (R, 3), irradiance of the elements by lights that are not patches, see `DirectLight`."""
        return self._lit(self.elements, self._at)

    def _lit(self, sides: Sides, at: ReceiverPoints) -> Float64:
        triangle = self.mesh.elements.triangle[sides.element]
        return self._lights.of_sides(sides, triangle, at.lit.points, at.lit.number, at.each)

    def sent_on(self, irradiance: Float64) -> Float64:
        """Return (Q, 3), radiosity of the patches by reflection and transmission of irradiance (R, 3)."""
        found = self.mean_of_patches(self.elements.reflectance * irradiance)
        if self.elements.transmittance.any():
            through = self.mean_of_patches(self.elements.transmittance * irradiance)
            there = self.behind >= 0
            found[there] += through[self.behind[there]]
        return found

    @cached_property
    def behind(self) -> Int64:
        """Index (Q,) of the opposite side of each patch's side; -1 if the opposite side is black."""
        number = self.sides.number(len(self.mesh.patches))
        return np.asarray(number[self.sides.element, 1 - self.sides.back])

    def mean_of_patches(self, values: Float64) -> Float64:
        """Return (Q, 3), the area-weighted mean over each patch's side of its elements' values (R, 3)."""
        return np.stack(
            [np.bincount(self.patch, values[:, c] * self.share, minlength=len(self.sides)) for c in range(3)],
            axis=1,
        )

    def on_sides(self, irradiance: Float64) -> Float64:
        """Return irradiance (2, R, 3) in the layout of a solution, [direct or indirect, side, element, channel].

        Sides that neither reflect, transmit nor emit get 0. Negative values, which overshooting may leave, are
        clamped to 0.
        """
        found = np.zeros((2, 2, len(self.mesh.elements), 3))
        found[:, self.elements.back, self.elements.element] = np.maximum(irradiance, 0.0)
        return found

    def column(self, side: int, next_ones: Callable[[], list[int]] = list) -> Float32:
        """Return (R,) float32, form factors from all element sides to one side of a patch.

        next_ones : function that returns the sides needed next; if this column is not cached, the other cores
                    compute the columns of those sides meanwhile
        """
        found = self._columns.get(side)
        return found if found is not None else self._find(side, next_ones)

    def _find(self, side: int, next_ones: Callable[[], list[int]]) -> Float32:
        f = self.form_factors
        cores = core_count()
        batches = [int(f.batch_of[side])]
        for other in next_ones():
            if len(batches) == cores:
                break
            batch = int(f.batch_of[other])
            if batch not in batches and other not in self._columns:
                batches.append(batch)
        wanted: Float32 | None = None
        for batch, (columns, took) in zip(batches, f.of_batches(batches, self._at), strict=True):
            self.statistics += took
            for one, column in zip(f.batches[batch].tolist(), columns, strict=True):
                self._columns[one] = column
                if one == side:
                    wanted = column
        while len(self._columns) > 1 and len(self._columns) * 4 * len(self.elements) > self.cache:
            del self._columns[next(iter(self._columns))]
        assert wanted is not None
        return wanted

    def matrix(self) -> Float32:
        """Return (R, Q) float32, all form factors."""
        f = self.form_factors
        found = np.empty((len(self.elements), len(self.sides)), np.float32)
        cores = core_count()
        for first in range(0, len(f.batches), cores):
            some = range(first, min(first + cores, len(f.batches)))
            for batch, (columns, took) in zip(some, f.of_batches(some, self._at), strict=True):
                self.statistics += took
                found[:, f.batches[batch]] = columns.T
        return found

    def refine(self, which: NDArray[np.bool_], irradiance: Float64, shot: Float64) -> Float64:
        """Split elements in four; return the irradiance (2, R', 3) of all sides of elements after the split.

        Unsplit elements keep their irradiance. New ones gather the radiosity that patches have shot before.

        which      : (E,) bool, True for elements to split
        irradiance : (2, R, 3) direct and indirect irradiance before the split
        shot       : (2, Q, 3) radiosity shot by each patch's side, which becomes direct and indirect irradiance
        """
        before = self.elements
        kept = ~which[before.element]
        self.mesh = self.mesh.refine(which)
        # `Sides` lists fronts before backs. In each, unsplit elements come before new ones.
        staying = int(np.count_nonzero(~which))
        at_all = self._receive()
        fresh = self.elements.element >= staying
        now = np.zeros((2, len(self.elements), 3))
        now[:, ~fresh] = irradiance[:, kept]
        numbers = np.flatnonzero(fresh)
        new = Sides(*(getattr(self.elements, n)[numbers] for n in Sides.__dataclass_fields__))
        self._at = self.form_factors.receivers(self.mesh.elements, new)
        now[0, numbers] = self._lit(new, self._at)
        old, self._columns = self._columns, {}
        self._gather(numbers, kept, fresh, shot, now, old)
        self._at = at_all
        return now

    def _gather(
        self,
        numbers: Int64,
        kept: NDArray[np.bool_],
        fresh: NDArray[np.bool_],
        shot: Float64,
        now: Float64,
        old: dict[int, Float32],
    ) -> None:
        """Gather light at the new elements from patches that have shot; add it to `now`, and extend cached columns.

        numbers : indices of the new elements' sides
        kept    : (R,) True for old sides that are not split
        fresh   : (R',) True for new sides
        shot    : (2, Q, 3) radiosity shot by each patch's side
        now     : (2, R', 3) irradiance
        old     : columns cached before the split
        """
        f = self.form_factors
        batches = np.unique(f.batch_of[np.flatnonzero(shot.any(axis=(0, 2)))]).tolist()
        cores = core_count()
        for first in range(0, len(batches), cores):
            some = batches[first : first + cores]
            for batch, (columns, took) in zip(some, f.of_batches(some, self._at), strict=True):
                self.statistics += took
                now[:, numbers] += columns.T.astype(np.float64) @ shot[:, f.batches[batch]]
                for one, column in zip(f.batches[batch].tolist(), columns, strict=True):
                    if one in old:
                        whole = np.empty(len(fresh), np.float32)
                        whole[~fresh], whole[fresh] = old.pop(one)[kept], column
                        self._columns[one] = whole
