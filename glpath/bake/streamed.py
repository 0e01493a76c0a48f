"""Rays against streamed triangles, and which points of surfaces are below them, as a cellar's walls are.

Streamed triangles have no texels, but they cover some. Such texels are lit by nothing that anybody sees: they are
dark, or have the sky below an open sheet of terrain. As those inside of other geometry, they get the light beside
them, so that no fringe shows where a wall enters the ground.

A point is covered where two things hold. It is below: most of a few rays, upwards from a sheet, or all around where
the stream is closed, first meet backs of streamed triangles; what is in memory stops none of them. And what its
surface faces is the ground: of sixteen rays a quarter meet such backs, or leave the scene below the sheet, and
fewer get into the open or to streamed fronts. The first keeps what stands free, the second the rooms of a cellar.

Up is where the fronts of a sheet face: the sum of its area vectors, which is zero for a closed surface.

Cost:     the chunks are read four times or five, and a BVH is made of them each time, in parts as large as the
          budget allows: about three seconds for a million triangles. Where no point is below, only the chunks above
          them are read for this.
Poor at:  sheets whose fronts face the ground: nothing is below those. Backs that some light was found to get to,
          as those of a roof over open ground, cover nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.bake.sides import Backs, Sides, around, first_hits, hemisphere, points_before
from glpath.integrators.gather_settings import GatherSettings
from glpath.integrators.path_settings import PathBufferSettings
from glpath.integrators.settings import GEOMETRY_BUDGET, IntegratorSettings
from glpath.radiosity.shafts.rays import Rays, rays_through
from glpath.rendering.choice import chosen
from glpath.scene import Scene
from glpath.scene.geometry import Float64, Shapes
from glpath.scene.model import unit_normals
from glpath.scene.stream import triangles_in_budget
from glpath.scene.triangulate import check_resident

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Bytes a triangle of a part: corners and BVH, 240 measured, and what making it takes for a while. And of a chunk
#: as it is read, in 64 bits, before and after it is placed and checked.
_BYTES_A_TRIANGLE, _BYTES_IN_THE_READING = 400, 400
#: Of the area of all triangles, how long the sum of their area vectors is for them to be a sheet.
_SHEET = 0.05
#: Rays upwards from a sheet lean by so many degrees.
_LEANING = 20.0
#: Rays of a point on a surface, and the share of them that meets the ground where it is covered.
_LOOKS, _GROUND = 16, 0.25
#: Points on backs from which light is looked for, and the share of them that finds some where the backs are lit.
_SAMPLES, _LIT = 1024, 0.25
#: Points that are asked for together: each has a dozen rays of 100 bytes.
_TOGETHER = 1 << 17


class StreamedHits(NamedTuple):
    """What rays meet first of streamed triangles.

    stream   : (N,) number of the stream, of `Shapes.streams`; -1 for none
    back     : (N,) whether it is its back
    distance : (N,) scene units, infinite for none
    """

    stream: Int64
    back: Bools
    distance: Float64


class _Part(NamedTuple):
    rays: Rays
    backs: Backs
    stream: Int64  # (T,) of each triangle


class StreamedRays:
    """The streams of a scene in parts that fit into a budget, each with a BVH on the CPU while rays go through it.

    scene  : in triangles, centred
    budget : MiB for a part

    Raises UsageError for a budget that has no room for the largest chunk.
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
        """What rays (N, 3) meet first; backs that are not there (`Material.culled`) left out.

        crossed : (chunks,) those that a ray may cross; all
        """
        count = len(origins)
        stream, back = np.full(count, -1), np.zeros(count, np.bool_)
        distance = np.full(count, np.inf)
        own = np.full(count, -1)
        for part in self._parts(np.ones(len(self._chunks), np.bool_) if crossed is None else crossed):
            hit, side, far = first_hits(part.rays, part.backs, origins, directions, own)
            nearer = (hit >= 0) & (far < distance)
            stream[nearer], back[nearer] = part.stream[hit[nearer]], side[nearer] == 1
            distance[nearer] = far[nearer]
        return StreamedHits(stream, back, distance)

    def forget(self) -> None:
        """Keep no triangle in memory."""
        self._last = None

    def chunks(self) -> Iterator[tuple[int, Float64]]:
        """The number of its stream and the triangles (F, 3, 3) of each chunk."""
        for which, number in self._chunks:
            yield which, self._streams[which].triangles(number)

    def crossed_by(self, origins: Float64, directions: Float64) -> Bools:
        """(chunks,): those that rays from all origins (N, 3) along each of directions (D, 3) may cross."""
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
        """Of the chunks that are crossed; the last one is kept until others are asked for."""
        wanted = np.flatnonzero(crossed)
        ends = np.cumsum(self._counts[wanted])
        first = 0
        while first < len(wanted):
            done = int(ends[first - 1]) if first else 0
            last = first + max(1, int(np.searchsorted(ends[first:] - done, self._room, side="right")))
            numbers = tuple(wanted[first:last].tolist())
            if self._last is None or self._last[0] != numbers:
                self._last = None  # before the next is made
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
    """Which points of surfaces streamed triangles cover, see the module."""

    def __init__(self, rays: StreamedRays, sides: Sides | None) -> None:
        """sides : of the scene in memory; None where nothing is"""
        self._rays, self._sides = rays, sides
        area, up, self._samples = _surveyed(rays)
        length = float(np.linalg.norm(up))
        self._up = up / length if length > _SHEET * area else None  # None: closed
        self._lit: Bools | None = None

    def __call__(self, triangle: Int64, side: Int64, points: Float64) -> Bools:
        """(N,): whether streamed triangles cover points (N, 3) of sides of triangles of the scene in memory."""
        found = np.zeros(len(points), np.bool_)
        for first in range(0, len(points), _TOGETHER):
            some = slice(first, first + _TOGETHER)
            below = first + np.flatnonzero(self.below(points[some]))
            if len(below):
                found[below] = self._faces_ground(triangle[below], side[below], points[below], below)
        return found

    def below(self, points: Float64) -> Bools:
        """(N,): whether points (N, 3) are below streamed triangles, on the side of their unlit backs."""
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
        """(N,): whether rays come to the ground, and whether into the open; neither where something is before it.

        distance : (N,) to what is in memory, infinite for nothing
        """
        streamed = hits.distance < distance
        nothing = ~streamed & np.isinf(distance)
        behind = np.zeros(len(directions), np.bool_) if self._up is None else directions @ self._up < 0
        dark = self._dark(hits)
        return (streamed & dark) | (nothing & behind), (streamed & ~dark) | (nothing & ~behind)

    def _faces_ground(self, triangle: Int64, side: Int64, points: Float64, number: Int64) -> Bools:
        """Whether of the rays from points enough come to the ground, and fewer into the open."""
        assert self._sides is not None, "whose surfaces these are"
        normals, origins = points_before(self._sides, triangle, side, points)
        directions = np.concatenate([hemisphere(normals, number, look, _LOOKS) for look in range(_LOOKS)])
        starts, own = np.tile(origins, (_LOOKS, 1)), np.tile(triangle, _LOOKS)
        _, _, distance = self._sides.cast(starts, directions, own)
        ground, into_open = self.ground(self._rays.cast(starts, directions), directions, distance)
        ground, into_open = ground.reshape(_LOOKS, -1), into_open.reshape(_LOOKS, -1)
        # Some do by the edge of a sheet, however far that is.
        share = ground.mean(axis=0)
        return np.asarray((share >= _GROUND) & (share > into_open.mean(axis=0)))

    def _dark(self, hits: StreamedHits) -> Bools:
        """(N,): whether rays meet backs to which no light gets."""
        if self._lit is None:
            self._lit = self._lit_backs()
        return np.asarray((hits.stream >= 0) & hits.back & ~self._lit[hits.stream])

    def _lit_backs(self) -> Bools:
        """(streams,): whether a ray from the backs often comes to the open, or to what is lit."""
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
    """MiB for streamed triangles of a scene, by an integrator with options that may be None.

    Raises SceneError for a scene with streams, where the integrator does not know them, and UsageError.
    """
    if scene.shapes.streams:
        given = {name: value for name, value in options.items() if value is not None}
        settings = chosen(integrator, given, scene)
        if isinstance(settings, PathBufferSettings | GatherSettings) and settings.by_path_buffer:
            return settings.geometry_budget
        check_resident(scene)
    return GEOMETRY_BUDGET


def in_memory(scene: Scene) -> Scene:
    """The scene with what is in memory alone, where it is; itself where that is all."""
    if not scene.shapes.streams:
        return scene
    kept = Shapes(shape for shape in scene.shapes if shape.primitive != "stream")
    return replace(scene, shapes=kept, centred_by=scene.origin)


def _surveyed(rays: StreamedRays) -> tuple[float, Float64, tuple[Int64, Float64, Float64, Float64]]:
    """The area of all streamed triangles, the sum of their area vectors (3,), and points on them.

    Of the points the stream, the weight, the position and the normal.
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
    """(5, 3) unit: along a unit vector (3,), and leaning from it to four sides."""
    angle = np.pi / 2 * (np.arange(4) + 0.3)
    r = math.sin(math.radians(_LEANING)) ** 2
    leaning = around(np.tile(up, (4, 1)), np.stack([np.full(4, r), angle / (2 * np.pi)], axis=1))
    return np.concatenate([up[None], leaning])


def _corners_of_a_cube() -> Float64:
    """(8, 3) unit, turned so that none is along an axis or a diagonal."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0 + np.array([0.17, -0.11, 0.05])
    return np.asarray(corners / np.linalg.norm(corners, axis=1, keepdims=True))
