"""Rays against streamed triangles, and a test for points of surfaces below them, such as the walls of a cellar.

Streamed triangles have no texels, but they cover texels of other surfaces. No camera sees the light of covered
texels. Below an open sheet of terrain, it is dark or comes from the sky. Like texels inside of other geometry,
covered texels get the light of the texels beside them, so that no fringe shows at the line where a wall enters the
ground.

A point is covered if it is below the stream and its surface faces the ground. The first condition leaves out
surfaces above the ground, and the second leaves out the rooms of a cellar.
- The point is below if most of a few rays first meet backs of streamed triangles. The rays go upwards for a sheet,
  and in all directions for a closed stream. Triangles in memory do not stop them.
- The surface faces the ground if a quarter of sixteen rays meet such backs, or leave the scene below the sheet.
  Also, fewer rays reach the open, or fronts of streamed triangles, than reach the ground.

The fronts of a sheet face upwards. Up is therefore the direction of the sum of its area vectors. The
sum is zero for a closed surface.

Cost:     four or five reads of the chunks, with a new BVH for each part that fits into the budget. That takes about
          three seconds for a million triangles. If no point is below, only the chunks above the points are read.
Poor at:  sheets whose fronts face the ground, because no point counts as below them. Backs that some light reaches,
          such as those of a roof over open ground, cover nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings
from glpath.integrators.settings import GEOMETRY_BUDGET, IntegratorSettings
from glpath.radiosity.shafts.rays import Rays, rays_through
from glpath.rendering.choice import chosen
from glpath.rendering.sides import Backs, Sides, around, first_hits, hemisphere, points_before
from glpath.scene import Scene
from glpath.scene.geometry import Float64, Shapes
from glpath.scene.model import unit_normals
from glpath.scene.stream import triangles_in_budget
from glpath.scene.triangulate import check_resident
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Bytes per triangle of a part in memory: corners and BVH (240 measured), and the temporary memory of their build.
_BYTES_A_TRIANGLE = 400
#: Bytes per triangle of a chunk during reading, in 64 bits, before and after its placement and checks.
_BYTES_IN_THE_READING = 400
#: Minimum length of the sum of all area vectors, as a fraction of the total area, for streams to count as a sheet.
_SHEET = 0.05
#: Angle between upward rays and the up direction of a sheet, degrees.
_LEANING = 20.0
#: Number of rays from a point that test if its surface faces the ground.
_LOOKS = 16
#: Minimum fraction of a point's rays that meet the ground. With less, the point is not covered.
_GROUND = 0.25
#: Number of points on backs from which rays look for light.
_SAMPLES = 1024
#: Minimum fraction, weighted by area, of rays from the backs of a stream that find light if these backs are lit.
_LIT = 0.25
#: Number of points in one batch; each has a dozen rays of 100 bytes.
_TOGETHER = 1 << 17


class StreamedHits(NamedTuple):
    """First hits of N rays with streamed triangles.

    stream   : (N,) index of the triangle's stream in `Shapes.streams`; -1 without a hit
    back     : (N,) bool, True if the ray hits the triangle's back
    distance : (N,) scene units, infinite without a hit
    """

    stream: Int64
    back: Bools
    distance: Float64


class _Part(NamedTuple):
    rays: Rays
    backs: Backs
    stream: Int64  # (T,) index of each triangle's stream


class StreamedRays:
    """Streams of a scene in parts that fit into a budget. Each part has a BVH on the CPU while rays are traced.

    scene  : triangulated scene, centred
    budget : maximum MiB of a part

    Raises UsageError if the largest chunk does not fit into the budget.
    """

    def __init__(self, scene: Scene, budget: int) -> None:
        self.scene = scene
        streams = [stream for _, stream in scene.shapes.streams]
        self._chunks = [(k, number) for k, stream in enumerate(streams) for number in range(len(stream.counts))]
        self._streams = streams
        self._counts = np.concatenate([stream.counts for stream in streams])
        self.lower = np.concatenate([stream.lower for stream in streams])
        self.upper = np.concatenate([stream.upper for stream in streams])
        self._culled = [scene.materials[scene.shapes[index].material].culled for index, _ in scene.shapes.streams]
        low, high = scene.bounds
        self._extent = float(np.max(high - low))
        self._room = triangles_in_budget(self._counts, budget, _BYTES_A_TRIANGLE, _BYTES_IN_THE_READING)
        self._last: tuple[tuple[int, ...], _Part] | None = None

    def cast(self, origins: Float64, directions: Float64, crossed: Bools | None = None) -> StreamedHits:
        """Return the first hits of rays (N, 3). Rays pass through culled backs (`Material.culled`).

        crossed : (chunks,) bool, True for chunks that a ray may cross; None for all
        """
        count = len(origins)
        stream, back = np.full(count, -1), np.zeros(count, np.bool_)
        distance = np.full(count, np.inf)
        own = np.full(count, -1)
        for part in self._parts(np.ones(len(self._chunks), np.bool_) if crossed is None else crossed):
            check_time()
            hit, side, far = first_hits(part.rays, part.backs, origins, directions, own)
            nearer = (hit >= 0) & (far < distance)
            stream[nearer], back[nearer] = part.stream[hit[nearer]], side[nearer] == 1
            distance[nearer] = far[nearer]
        return StreamedHits(stream, back, distance)

    def forget(self) -> None:
        """Free the triangles and the BVH of the last part."""
        self._last = None

    def chunks(self) -> Iterator[tuple[int, Float64]]:
        """Yield the index of the stream and the triangles (F, 3, 3) of each chunk."""
        for which, number in self._chunks:
            yield which, self._streams[which].triangles(number)

    def crossed_by(self, origins: Float64, directions: Float64) -> Bools:
        """Return (chunks,) bool: True if a ray from any origin (N, 3) along any direction (D, 3) may cross it."""
        low, high = origins.min(axis=0), origins.max(axis=0)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        found = np.zeros(len(self.lower), np.bool_)
        for direction in directions:
            with np.errstate(divide="ignore", invalid="ignore"):
                a = (self.lower - half - middle) / direction
                b = (self.upper + half - middle) / direction
            near, far = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
            found |= (near <= far) & (far >= 0)
        return found

    def _parts(self, crossed: Bools) -> Iterator[_Part]:
        """Yield parts of the chunks that are crossed. The last part is cached until other chunks are requested."""
        wanted = np.flatnonzero(crossed)
        ends = np.cumsum(self._counts[wanted])
        first = 0
        while first < len(wanted):
            done = int(ends[first - 1]) if first else 0
            last = first + max(1, int(np.searchsorted(ends[first:] - done, self._room, side="right")))
            numbers = tuple(wanted[first:last].tolist())
            if self._last is None or self._last[0] != numbers:
                self._last = None  # frees memory before the next part is built
                self._last = numbers, self._part(numbers)
            yield self._last[1]
            first = last

    def _part(self, numbers: tuple[int, ...]) -> _Part:
        triangles = np.empty((int(self._counts[list(numbers)].sum()), 3, 3))
        stream = np.empty(len(triangles), np.int64)
        at = 0
        for which, number in (self._chunks[k] for k in numbers):
            found = self._streams[which].triangles(number)
            triangles[at : at + len(found)], stream[at : at + len(found)] = found, which
            at += len(found)
        culled = np.array(self._culled, np.bool_)[stream]
        return _Part(rays_through(triangles, self._extent), Backs(unit_normals(triangles), culled), stream)


class Covered:
    """Test for points of surfaces that streamed triangles cover; the module's docstring defines "covered"."""

    def __init__(self, rays: StreamedRays, sides: Sides | None) -> None:
        """Prepare the test.

        sides : sides of the triangles in memory; None if no triangle is in memory
        """
        self._rays, self._sides = rays, sides
        area, up, self._samples = _surveyed(rays)
        length = float(np.linalg.norm(up))
        self._up = up / length if length > _SHEET * area else None  # None for a closed stream
        self._lit: Bools | None = None

    def __call__(self, triangle: Int64, side: Int64, points: Float64) -> Bools:
        """Return (N,) bool: True if streamed triangles cover a point.

        triangle, side : (N,) triangles in memory that the points are on, and their sides
        points         : (N, 3)
        """
        found = np.zeros(len(points), np.bool_)
        for first in range(0, len(points), _TOGETHER):
            some = slice(first, first + _TOGETHER)
            below = first + np.flatnonzero(self.below(points[some]))
            if len(below):
                found[below] = self._faces_ground(triangle[below], side[below], points[below], below)
        return found

    def below(self, points: Float64) -> Bools:
        """Return (N,) bool: True if a point (N, 3) is below streamed triangles, on the side of unlit backs."""
        directions = _corners_of_a_cube() if self._up is None else _upwards(self._up)
        count = len(directions)
        crossed = self._rays.crossed_by(points, directions)
        if not crossed.any():
            return np.zeros(len(points), np.bool_)
        hits = self._rays.cast(np.repeat(points, count, axis=0), np.tile(directions, (len(points), 1)), crossed)
        if not hits.back.any():
            return np.zeros(len(points), np.bool_)
        return np.asarray(self._dark(hits).reshape(-1, count).mean(axis=1) > 0.5)

    def ground(self, hits: StreamedHits, directions: Float64, distance: Float64) -> tuple[Bools, Bools]:
        """Return (N,) bool for rays that reach the ground, and (N,) bool for rays that reach the open.

        Both are False for a ray that first meets a triangle in memory.

        distance : (N,) distance of that triangle in memory; infinite if there is none
        """
        streamed = hits.distance < distance
        nothing = ~streamed & np.isinf(distance)
        behind = np.zeros(len(directions), np.bool_) if self._up is None else directions @ self._up < 0
        dark = self._dark(hits)
        return (streamed & dark) | (nothing & behind), (streamed & ~dark) | (nothing & ~behind)

    def _faces_ground(self, triangle: Int64, side: Int64, points: Float64, number: Int64) -> Bools:
        """Return bool: True for points from which enough rays reach the ground, and fewer reach the open."""
        assert self._sides is not None, "whose surfaces these are"
        normals, origins = points_before(self._sides, triangle, side, points)
        directions = np.concatenate([hemisphere(normals, number, look, _LOOKS) for look in range(_LOOKS)])
        starts, own = np.tile(origins, (_LOOKS, 1)), np.tile(triangle, _LOOKS)
        _, _, distance = self._sides.cast(starts, directions, own)
        ground, into_open = self.ground(self._rays.cast(starts, directions), directions, distance)
        ground, into_open = ground.reshape(_LOOKS, -1), into_open.reshape(_LOOKS, -1)
        # Rays past the edge of a sheet reach the open, however far the edge is.
        share = ground.mean(axis=0)
        return np.asarray((share >= _GROUND) & (share > into_open.mean(axis=0)))

    def _dark(self, hits: StreamedHits) -> Bools:
        """Return (N,) bool: True for rays that meet backs without light."""
        if self._lit is None:
            self._lit = self._lit_backs()
        return np.asarray((hits.stream >= 0) & hits.back & ~self._lit[hits.stream])

    def _lit_backs(self) -> Bools:
        """Return (streams,) bool: True if enough rays from the backs of a stream reach the open or lit surfaces."""
        scene, (stream, weight, points, normals) = self._rays.scene, self._samples
        size = float(np.linalg.norm(np.subtract(*scene.bounds)))
        origins = points - 1e-6 * size * normals
        directions = around(-normals, np.random.default_rng(0).random((len(points), 2)))
        hits = self._rays.cast(origins, directions)
        beyond = (hits.stream < 0) & (self._up is None or directions @ self._up > 0)
        found = beyond | ((hits.stream >= 0) & ~hits.back)
        if self._sides is not None:
            hit, side, distance = self._sides.cast(origins, directions, np.full(len(points), -1))
            found = np.where(distance < hits.distance, self._sides.lit[hit, side], found)
        count = len(scene.shapes.streams)
        share = np.bincount(stream, weight * found, count) / np.bincount(stream, weight, count)
        sends = [scene.materials[scene.shapes[index].material].two_sided for index, _ in scene.shapes.streams]
        return np.asarray((share >= _LIT) & sends)


def budget_for(scene: Scene, integrator: str | IntegratorSettings, options: Mapping[str, Any]) -> int:
    """Return the budget in MiB that an integrator has for streamed triangles of a scene.

    options : options of the integrator; None for an option that is not given

    Raises UsageError. Raises SceneError if the scene has streams that the integrator cannot render.
    """
    if scene.shapes.streams:
        given = {name: value for name, value in options.items() if value is not None}
        settings = chosen(integrator, given, scene)
        if isinstance(settings, PathBufferSettings | GatherSettings) and settings.by_path_buffer:
            return settings.geometry_budget
        check_resident(scene)
    return GEOMETRY_BUDGET


def in_memory(scene: Scene) -> Scene:
    """Return the scene without its streams, in the same coordinates; the scene itself if it has no streams."""
    if not scene.shapes.streams:
        return scene
    kept = Shapes(shape for shape in scene.shapes if shape.primitive != "stream")
    return replace(scene, shapes=kept, centred_by=scene.origin)


def _surveyed(rays: StreamedRays) -> tuple[float, Float64, tuple[Int64, Float64, Float64, Float64]]:
    """Return the area of all streamed triangles, the sum (3,) of their area vectors, and points on them.

    The points are four arrays: index of the stream, area that the point stands for, position and normal.
    """
    random = np.random.default_rng(0)
    total = sum(stream.count for _, stream in rays.scene.shapes.streams)
    area, up, made = 0.0, np.zeros(3), []
    for which, triangles in rays.chunks():
        vectors = 0.5 * np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(vectors, axis=1)
        area, up = area + float(lengths.sum()), up + vectors.sum(axis=0)
        count = math.ceil(_SAMPLES * len(triangles) / total)
        some = random.integers(len(triangles), size=count)
        b = random.random((count, 2))
        b = np.where(b.sum(axis=1, keepdims=True) > 1, 1 - b, b)
        corner = triangles[some, 0]
        edges = triangles[some, 1:] - corner[:, None]
        points = corner + np.einsum("nk,nkx->nx", b, edges)
        weight = lengths[some] * (len(triangles) / count)
        made.append((np.full(count, which), weight, points, unit_normals(triangles[some])))
    stream, weight, points, normals = (np.concatenate(part) for part in zip(*made, strict=True))
    return area, up, (stream, weight, points, normals)


def _upwards(up: Float64) -> Float64:
    """Return (5, 3) unit directions: the unit vector `up`, and four that lean from it by `_LEANING` all around."""
    angle = np.pi / 2 * (np.arange(4) + 0.3)
    r = math.sin(math.radians(_LEANING)) ** 2
    leaning = around(np.tile(up, (4, 1)), np.stack([np.full(4, r), angle / (2 * np.pi)], axis=1))
    return np.concatenate([up[None], leaning])


def _corners_of_a_cube() -> Float64:
    """Return (8, 3) unit directions to corners of a shifted cube. None is along an axis or a diagonal."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0 + np.array([0.17, -0.11, 0.05])
    return np.asarray(corners / np.linalg.norm(corners, axis=1, keepdims=True))
