"""Light that reaches sensors after reflections: for all patches of the sky and all suns at once.

Surfaces are cut into elements, which are sensors themselves: what each direction gives to them directly is found as
for others. Rays between the elements make a matrix F of shares, and one solution has all columns as right-hand
sides. Rays from the sensors are cast once; what they meet weighs the solution's columns.

    H = E + F B,  B = rho H,  indirect = W B

H is the irradiance of the elements' sides and B their radiosity. To the solution all surfaces are diffuse, metal
too, and reflectance is a luminance: colours do not bleed.

Cost:     a microsecond of a core for each ray; of R sides a dense matrix, or beyond `DENSE` of them a sparse one.
Poor at:  light that mirrors or solid glass throw; sun patches smaller than elements near the sensors.
Source:   Goral et al. 1984, Modeling the interaction of light between diffuse surfaces; McNeil & Lee 2013, for
          daylight coefficients with reflections.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.daylight.hits import BATCHES, Hits, cast_hits
from glpath.daylight.indirect import Indirect
from glpath.daylight.receivers import Receiver
from glpath.film.image import LUMINANCE
from glpath.gl.constants import RAY_ROUNDING
from glpath.radiosity.mesh.mesh import Elements, divisions_of_size, occluder_of_triangle, size_for_count, surfaces
from glpath.radiosity.mesh.sides import Sides, open_points
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.rays import rays_of
from glpath.radiosity.solvers.particles import Surfaces
from glpath.scene import Scene

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Elements where their number is not given, rays of each point of their sides and of a sensor.
DEFAULT_ELEMENTS, SIDE_RAYS, GATHER_RAYS = 2000, 128, 1024
#: Points of a side.
POINTS = 4
#: Sides up to which the matrix is dense: 144 MB.
DENSE = 6000
# Of the largest column's sum, by which a sparse solution changes at last; and the limit of reflections.
_CHANGE, _MAX_REFLECTIONS = 1e-4, 500
# Floats of some columns of the sides: 32 MiB.
_COLUMNS = 1 << 23


class ReflectingSides:
    """The sides of a scene's elements that reflect.

    scene    : in triangles, in memory
    elements : their number, about
    seed     : of the points in them

    points, normals : (R POINTS, 3), off the surfaces, and unit; those of a side one behind the other
    """

    def __init__(self, scene: Scene, elements: int, seed: int = 0) -> None:
        surface = surfaces(scene)
        size = size_for_count(scene, surface, elements, by_size=True)
        divisions = divisions_of_size(scene, surface, size)
        made = Elements.of_lattices(divisions)
        self.sides = sides = Sides.of(scene, made)
        self.surfaces = Surfaces.of(scene, rays_of(scene), divisions, from_eye=True)
        number = sides.number(len(made))
        self._number = number.ravel()  # twice the element and its back
        occluders = Occluders.of_scene(scene)
        solid = occluders.solid[occluder_of_triangle(occluders.parallelogram)]
        points, _ = open_points(scene, solid, made, sides, POINTS, seed)
        lower, upper = scene.bounds
        self.lift = RAY_ROUNDING * float(np.abs([lower, upper]).max() + np.linalg.norm(upper - lower))
        self.normals = np.repeat(sides.normal, POINTS, axis=0)
        self.points = points.reshape(-1, 3) + self.lift * self.normals
        triangle = made.triangle[sides.element]
        # Of glass without what its surface mirrors, which rays follow.
        self._reflectance = self.surfaces.reflectance[sides.back, triangle] @ LUMINANCE
        self._transmittance = sides.transmittance @ LUMINANCE
        self._behind = number[sides.element, 1 - sides.back]

    def __len__(self) -> int:
        return len(self.sides)

    def sent_on(self) -> Any:
        """(R, R) sparse: radiosity of the sides by their irradiance."""
        from scipy import sparse

        count = len(self)
        some = np.flatnonzero((self._behind >= 0) & (self._transmittance > 0))
        # What arrives on a side leaves from the one behind it.
        rows = np.concatenate([np.arange(count), self._behind[some]])
        columns = np.concatenate([np.arange(count), some])
        values = np.concatenate([self._reflectance, self._transmittance[some]])
        return sparse.csr_array((values.astype(np.float32), (rows, columns)), shape=(count, count))

    def weights(self, hits: Hits, each: int = 1) -> Any:
        """(n / each, R) sparse: irradiance of points, or of `each` in a row together, by radiosity."""
        from scipy import sparse

        number = self._number[np.maximum(hits.side, 0)]
        some = (hits.side >= 0) & (number >= 0)
        count, rays = hits.side.shape
        row = np.broadcast_to(np.arange(count)[:, None] // each, hits.side.shape)[some]
        values = hits.weight[some] / np.float32(rays * each)
        found = sparse.coo_array((values, (row, number[some])), shape=(count // each, len(self)), dtype=np.float32)
        return found.tocsr()

    def spread(self, hits: Hits, radiosity: Float32) -> Float32:
        """(n,) standard errors of the irradiance of points by sides of one radiosity each (R,)."""
        number = self._number[np.maximum(hits.side, 0)]
        light = np.where((hits.side >= 0) & (number >= 0), radiosity[np.maximum(number, 0)], 0.0) * hits.weight
        means = light.reshape(len(light), BATCHES, -1).mean(axis=2)
        return np.asarray(means.std(axis=1, ddof=1) / np.sqrt(BATCHES), np.float32)

    def between(self, rays: int, seed: int) -> Any:
        """(R, R) sparse, F: by rays of each point of the sides."""
        from scipy import sparse

        parts = [
            self.weights(hits, POINTS)
            for hits in cast_hits(self.surfaces, self.points, self.normals, "plane", rays, seed)
        ]
        return sparse.vstack(parts, format="csr") if parts else sparse.csr_array((0, 0), dtype=np.float32)


def solved(sides: ReflectingSides, direct: Float32, max_depth: int | None, seed: int) -> Float32:
    """(R, C) float32: radiosity of the sides.

    direct    : (R, C), their irradiance straight from sky and sun; it is overwritten
    max_depth : 1 is direct light, 2 one reflection, and so on; None for all
    """
    from scipy import linalg

    sent = sides.sent_on()
    if max_depth is not None:
        return _series(sent, sides.between(SIDE_RAYS, seed) if max_depth > 2 else None, direct, max_depth - 2)
    between = sides.between(SIDE_RAYS, seed)
    if len(sides) <= DENSE:
        first = np.asarray(sent @ direct, np.float32)
        system = np.eye(len(sides), dtype=np.float32) - (sent @ between).toarray()
        return np.asarray(linalg.solve(system, first, overwrite_a=True, check_finite=False), np.float32)
    return _series(sent, between, direct, _MAX_REFLECTIONS)


def _series(sent: Any, between: Any, direct: Float32, reflections: int) -> Float32:
    """The sum of so many reflections, or of as many as change it; some columns at a time, over those of direct."""
    sums = np.asarray(sent.sum(axis=0)).ravel() @ direct
    limit = _CHANGE * float(np.abs(sums).max(initial=0.0))
    step = max(1, _COLUMNS // max(1, len(direct)))
    for begin in range(0, direct.shape[1], step):
        some = slice(begin, begin + step)
        first = np.asarray(sent @ np.ascontiguousarray(direct[:, some]), np.float32)
        direct[:, some] = _sum_of_series(sent, between, first, reflections, limit)
    return direct


def _sum_of_series(sent: Any, between: Any, first: Float32, reflections: int, limit: float) -> Float32:
    found, last = first.copy(), first
    for _ in range(reflections):
        last = np.asarray(sent @ (between @ last), np.float32)
        found += last
        if float(np.abs(last.sum(axis=0)).max(initial=0.0)) <= limit:
            break
    return found


def gathered(
    sides: ReflectingSides,
    radiosity: Float32,
    points: Float64,
    normals: Float64,
    receiver: Receiver,
    in_sky: int,
    rays: int,
    seed: int,
    report: Callable[[int], None],
    number: int = 0,
) -> Indirect:
    """What the sides give to sensors.

    in_sky : columns of ground and sky, which come first
    report : called with the number of sensors that are done
    number : of the first sensor, which random numbers follow from
    """
    from scipy import sparse

    at = points + sides.lift * normals if receiver == "plane" else points
    of_sky = radiosity[:, :in_sky].sum(axis=1)
    parts, errors = [], []
    for hits in cast_hits(sides.surfaces, at, normals, receiver, rays, seed + 1, number):
        parts.append(sides.weights(hits))
        errors.append(sides.spread(hits, of_sky))
        report(hits.first + len(hits.side))
    weights = sparse.vstack(parts, format="csr")
    if points.shape[0] * radiosity.shape[1] < 2 * weights.nnz + radiosity.size:
        rows = np.asarray(weights @ radiosity, np.float32)
        weights, radiosity = sparse.eye_array(len(points), dtype=np.float32, format="csr"), rows
    return Indirect(weights, radiosity, np.concatenate(errors))
