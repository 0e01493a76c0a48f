"""Reflected light at sensors, for all patches of the sky and all sun positions at once.

Surfaces are divided into elements, whose direct light is computed as for sensors. Rays between the elements give a
matrix F of form factors, for one linear system. Rays from the sensors are cast once, and give a matrix W of weights
of the elements that they hit.

    H = E + F B,  B = rho H,  indirect = W B

E is the direct irradiance of the elements' sides, H their total irradiance, B their radiosity and rho their
reflectance. E, H and B have one row for each side, and one column for each patch and sun position. All surfaces
count as diffuse, even metal. Reflectance is a luminance, so colours do not bleed. Columns are solved in groups, so
that only the sensors' results of a large scene stay in memory.

Cost:     a core microsecond for each ray; a dense matrix of R x R sides, or a sparse one beyond `DENSE` sides.
Poor at:  caustics of mirrors or solid glass; sun patches smaller than the elements near the sensors.
Source:   Goral et al. 1984, Modeling the interaction of light between diffuse surfaces; McNeil & Lee 2013, for
          daylight coefficients with reflections.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight.hits import BATCHES, Hits, cast_hits, ray_count
from glpath.apps.daylight.indirect import Indirect
from glpath.apps.daylight.receivers import Receiver
from glpath.gl.constants import RAY_ROUNDING
from glpath.radiosity.mesh.mesh import Elements, divisions_of_size, occluder_of_triangle, size_for_count, surfaces
from glpath.radiosity.mesh.sides import Sides, Solids
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.rays import rays_of
from glpath.radiosity.solvers.particles import ParticleSurfaces
from glpath.scene import Scene
from glpath.system.colour import LUMINANCE

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Default number of elements.
DEFAULT_ELEMENTS = 2000
#: Number of rays from each point of an element's side.
SIDE_RAYS = 128
#: Default number of rays from each sensor.
GATHER_RAYS = 1024
#: Number added to the seed for the rays from sensors, so that they differ from the rays between element sides.
GATHER_SEED = 1
#: Number of sample points on an element's side.
POINTS = 4
#: Maximum number of element sides for a dense matrix (144 MB).
DENSE = 6000
# Maximum number of element sides for a matrix of 64-bit floats (32 MB).
_DOUBLE = 2000
# The iteration of a sparse system stops when it changes no column's sum by more than this fraction.
_CHANGE = 1e-4
# Maximum number of reflections in this iteration.
_MAX_REFLECTIONS = 500
# Maximum number of floats of the columns that are solved together: 32 MiB.
_COLUMNS = 1 << 23


class ReflectingSides:
    """Sides of a scene's elements that reflect light.

    scene    : triangulated scene in memory
    elements : approximate number of elements
    seed     : seed of the sample points

    points, normals : (R POINTS, 3) points just above the surfaces, and unit normals; POINTS rows for each side
    reflected, transmitted : (2, T) reflectance and transmittance (luminance) of fronts and backs of triangles
    """

    def __init__(self, scene: Scene, elements: int, seed: int = 0) -> None:
        surface = surfaces(scene)
        size = size_for_count(scene, surface, elements, by_size=True)
        divisions = divisions_of_size(scene, surface, size)
        made = Elements.of_lattices(divisions)
        self.sides = sides = Sides.of(scene, made)
        self.surfaces = ParticleSurfaces.of(scene, rays_of(scene), divisions, from_eye=True)
        number = sides.number(len(made))
        self._number = number.ravel()  # index of each reflecting side, by 2 * element + back; -1 for other sides
        occluders = Occluders.of_scene(scene)
        solid = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
        points, _ = Solids.of(scene, solid).open_points(made, sides, POINTS, seed)
        lower, upper = scene.bounds
        self.lift = RAY_ROUNDING * float(np.abs([lower, upper]).max() + np.linalg.norm(upper - lower))
        self.normals = np.repeat(sides.normal, POINTS, axis=0)
        self.points = points.reshape(-1, 3) + self.lift * self.normals
        triangle = made.triangle[sides.element]
        # The mirror reflection of glass is not included, because rays follow it.
        self.reflected = np.ascontiguousarray(self.surfaces.reflectance @ LUMINANCE)
        self.transmitted = np.ascontiguousarray(self.surfaces.transmittance @ LUMINANCE)
        self._reflectance = self.reflected[sides.back, triangle]
        self._transmittance = sides.transmittance @ LUMINANCE
        self._behind = number[sides.element, 1 - sides.back]

    def __len__(self) -> int:
        return len(self.sides)

    def sent_on(self) -> Any:
        """Return the sparse matrix (R, R) that maps the irradiance of element sides to their radiosity."""
        from scipy import sparse

        count = len(self)
        some = np.flatnonzero((self._behind >= 0) & (self._transmittance > 0))
        # Transmitted light arrives on a side and leaves from the side behind it.
        rows = np.concatenate([np.arange(count), self._behind[some]])
        columns = np.concatenate([np.arange(count), some])
        values = np.concatenate([self._reflectance, self._transmittance[some]])
        return sparse.csr_array((values.astype(np.float32), (rows, columns)), shape=(count, count))

    def weights(self, hits: Hits, each: int = 1) -> Any:
        """Return the sparse matrix (n / each, R) that maps radiosity to the irradiance of points.

        each : number of consecutive points whose mean irradiance is one row
        """
        from scipy import sparse

        number = self._number[np.maximum(hits.side, 0)]
        some = (hits.side >= 0) & (number >= 0)
        count, rays = hits.side.shape
        row = np.broadcast_to(np.arange(count)[:, None] // each, hits.side.shape)[some]
        values = hits.weight[some] / np.float32(rays * each)
        found = sparse.coo_array((values, (row, number[some])), shape=(count // each, len(self)), dtype=np.float32)
        return found.tocsr()

    def looked_up(self, hits: Hits, radiosity: Float32) -> Float32:
        """Return (n, R) radiosity of the element sides that rays hit, times the rays' weights.

        It is 0 for a ray that hits no reflecting side.
        """
        if not len(self):
            return np.zeros(hits.side.shape, np.float32)
        number = self._number[np.maximum(hits.side, 0)]
        lit = (hits.side >= 0) & (number >= 0)
        return np.asarray(np.where(lit, radiosity[np.maximum(number, 0)], 0.0) * hits.weight, np.float32)

    def spread(self, hits: Hits, radiosity: Float32) -> Float32:
        """Return (n,) standard errors of the irradiance that points get from element sides with radiosity (R,)."""
        light = self.looked_up(hits, radiosity)
        means = light.reshape(len(light), BATCHES, -1).mean(axis=2)
        return np.asarray(means.std(axis=1, ddof=1) / np.sqrt(BATCHES), np.float32)

    def between(self, rays: int, seed: int) -> tuple[Any, Float32]:
        """Trace rays from all reflecting element sides.

        Returns sparse form factors (R, R), and the sides' irradiance (R,) under a sky and a ground of radiance 1.
        """
        of_sky = np.zeros(len(self), np.float32)
        found = _Rows(len(self), len(self), POINTS * ray_count(rays))
        for hits in cast_hits(self.surfaces, self.points, self.normals, "plane", rays, seed):
            left = np.where(hits.side < 0, hits.weight, np.float32(0)).mean(axis=1)
            begin = hits.first // POINTS
            of_sky[begin : begin + len(left) // POINTS] = np.pi * left.reshape(-1, POINTS).mean(axis=1)
            found.append(self.weights(hits, POINTS))
        return found.whole(), of_sky


class _Rows:
    """Sparse matrix that is built a few rows at a time; reserved but unused space takes no memory.

    rows, columns : shape of the matrix
    max_values    : maximum number of values in a row
    """

    def __init__(self, rows: int, columns: int, max_values: int) -> None:
        room = rows * min(max_values, columns)
        self._shape = (rows, columns)
        self._values, self._columns = np.empty(room, np.float32), np.empty(room, np.int32)
        self._begin = np.zeros(rows + 1, np.int64)
        self._done = 0

    def append(self, part: Any) -> None:
        """Append the rows of `part`, an (n, C) csr_array."""
        first = int(self._begin[self._done])
        last = first + part.nnz
        self._values[first:last], self._columns[first:last] = part.data, part.indices
        self._begin[self._done + 1 : self._done + 1 + part.shape[0]] = first + part.indptr[1:]
        self._done += part.shape[0]

    def whole(self) -> Any:
        """Return the matrix as an (R, C) csr_array."""
        from scipy import sparse

        assert self._done == self._shape[0], "rows are missing"
        last = int(self._begin[-1])
        return sparse.csr_array((self._values[:last], self._columns[:last], self._begin), shape=self._shape)


class Reflections:
    """Linear system that maps direct irradiance of element sides to their radiosity, for any number of columns.

    max_depth : 1: direct light, 2: one reflection, and so on; None: all reflections

    of_sky : (R,) radiosity under a sky and a ground of radiance 1, from the rays between the sides; for errors and
             bias
    max_reflections : maximum number of reflections between sky and sensor
    """

    def __init__(self, sides: ReflectingSides, max_depth: int | None, seed: int) -> None:
        self._sent = sides.sent_on()
        self._between, of_sky = sides.between(SIDE_RAYS, seed)
        self.max_reflections = _MAX_REFLECTIONS if max_depth is None else max_depth - 1
        self._factors = self._factored() if max_depth is None and 0 < len(sides) <= DENSE else None
        self.of_sky = self.radiosity(of_sky[:, None])[:, 0]

    def _factored(self) -> Any:
        from scipy import linalg

        # The last bits of a solution depend on the number of BLAS threads, which is 1 in workers of a cluster.
        # Rounding a 64-bit solution to 32 bits hides that. Large systems have 32 bits, to save memory.
        kind = np.float64 if len(self._sent.indptr) <= _DOUBLE else np.float32
        system = (self._sent @ self._between).toarray().astype(kind)
        np.negative(system, out=system)
        system.ravel()[:: len(system) + 1] += 1
        return linalg.lu_factor(system, overwrite_a=True, check_finite=False)

    def columns(self) -> int:
        """Number of columns (patches and sun positions) that are solved together."""
        return max(1, _COLUMNS // max(1, len(self.of_sky)))

    def radiosity(self, direct: Float32) -> Float32:
        """Return radiosity (R, c) float32 for the direct irradiance of the sides by sky and sun."""
        from scipy import linalg

        first = np.asarray(self._sent @ direct, np.float32)
        if self._factors is not None:
            return np.asarray(
                linalg.lu_solve(self._factors, first.astype(self._factors[0].dtype), check_finite=False), np.float32
            )
        found, last = first.copy(), first
        limit = _CHANGE * np.abs(first.sum(axis=0))
        for _ in range(self.max_reflections - 1):
            last = np.asarray(self._sent @ (self._between @ last), np.float32)
            found += last
            if (np.abs(last.sum(axis=0)) <= limit).all():
                break
        return found


def gathered(
    sides: ReflectingSides,
    reflections: Reflections,
    direct: Iterable[Float32],
    count: int,
    points: Float64,
    normals: Float64,
    receiver: Receiver,
    rays: int,
    seed: int,
    report: Callable[[int], None],
    number: int = 0,
) -> Indirect:
    """Return the light that the reflecting sides give to sensors.

    direct : direct irradiance (R,) of the sides by sky and sun, column by column
    count : number of columns (patches and sun positions)
    report : called with the number of finished sensors
    number : index of the first sensor, from which random numbers are derived
    """
    from scipy import sparse

    at = points + sides.lift * normals if receiver == "plane" else points
    made, errors = _Rows(len(points), len(sides), ray_count(rays)), np.zeros(len(points), np.float32)
    for hits in cast_hits(sides.surfaces, at, normals, receiver, rays, seed + GATHER_SEED, number):
        last = hits.first + len(hits.side)
        made.append(sides.weights(hits))
        errors[hits.first : last] = sides.spread(hits, reflections.of_sky)
        report(last)
    weights = made.whole()
    as_rows = len(points) * count < 2 * weights.nnz + len(sides) * count
    found = np.empty((len(points) if as_rows else len(sides), count), np.float32)
    begin = 0
    for block in _blocks(direct, reflections.columns()):
        radiosity = reflections.radiosity(block)
        end = begin + block.shape[1]
        found[:, begin:end] = weights @ radiosity if as_rows else radiosity
        begin = end
    if as_rows:
        weights = sparse.eye_array(len(points), dtype=np.float32, format="csr")
    return Indirect(weights, found, errors)


def _blocks(columns: Iterable[Float32], width: int) -> Iterator[Float32]:
    """Yield arrays (R, c) of successive columns: `width` in each array, or fewer in the last."""
    held: list[Float32] = []
    for column in columns:
        held.append(column)
        if len(held) == width:
            yield np.stack(held, axis=1)
            held = []
    if held:
        yield np.stack(held, axis=1)
