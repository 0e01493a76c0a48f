"""Streamed triangles as a mesh that fits into memory: proxy geometry, for what needs all triangles at once.

The corners that lie in one cell of a grid become one vertex, their mean weighted by the areas of their triangles
(vertex clustering, Rossignac & Borrel 1993). Triangles with two corners in a cell vanish, and what is left of a
closed surface is closed. A stream of few triangles is its own proxy, to the bit.

Cost:     one pass over the stream, a microsecond a triangle, and some hundred bytes for each cell of a fine grid.
Poor at:  what is smaller than a cell: a fence, a railing. It is lost, as is what it throws shadows on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.geometry import Float64, Mesh, Shape, Shapes
from glpath.scene.model import Scene
from glpath.scene.stream import Stream
from glpath.scene.tessellate import without_area

Int64 = NDArray[np.int64]

#: Triangles of all proxies of a scene: what a radiosity solution takes seconds for.
TRIANGLES = 16_384
# Cells along the longest side of the box around all streams: of the first grid, and as a bound of the search.
_FINEST = 256
# Steps of the search for the size of a cell, each of which halves its range in the logarithm.
_STEPS = 8


class _Surface(NamedTuple):
    """Triangles that share vertices, and of each vertex the area of its triangles."""

    vertices: Float64
    weights: Float64
    faces: Int64


@dataclass(frozen=True)
class Proxies:
    """A scene whose streams are meshes.

    scene : the shapes that are no streams in their order, then a mesh for each stream that has any triangles left;
            so triangles that were in memory keep their numbers
    first : number of the first triangle of a proxy
    cell  : side of a cell, scene units; 0 where proxies have all triangles
    area  : of all proxies, as a share of that of the streams
    """

    scene: Scene
    first: int
    cell: float
    area: float


def with_proxies(scene: Scene, triangles: int = TRIANGLES) -> Proxies:
    """The scene with about so many triangles instead of those that it streams, or all where these are fewer."""
    resident = [shape for shape in scene.shapes if not isinstance(shape.geometry, Stream)]
    streamed = [scene.shapes[index] for index, _ in scene.shapes.streams]
    surfaces, cell = _proxies(
        [shape.geometry for shape in streamed if isinstance(shape.geometry, Stream)], triangles
    )
    shapes = [*resident, *(_as_mesh(*pair) for pair in zip(streamed, surfaces, strict=True) if len(pair[1].faces))]
    found, first = replace(scene, shapes=Shapes(shapes)), Shapes(resident).total("triangle")
    # Each corner had the area of its triangle.
    streamed_area = sum(float(surface.weights.sum()) for surface in surfaces) / 3.0
    return Proxies(found, first, cell, float(found.areas[first:].sum()) / streamed_area)


def _as_mesh(shape: Shape, surface: _Surface) -> Shape:
    mesh = Mesh(surface.vertices, surface.faces.astype(np.int32))
    flat = without_area(mesh.vertices[mesh.faces])
    return replace(shape, geometry=mesh.without_faces(flat), kind="mesh")


def _proxies(streams: list[Stream], triangles: int) -> tuple[list[_Surface], float]:
    if sum(stream.count for stream in streams) <= triangles:
        return [_whole(stream) for stream in streams], 0.0
    lower = np.min([stream.bounds[0] for stream in streams], axis=0)
    extent = float(np.max([stream.bounds[1] - lower for stream in streams]))
    finest = extent / _FINEST
    fine = [_clustered_stream(stream, lower, finest) for stream in streams]
    # The smallest cells that leave so few triangles; the fine ones are in memory, and quickly clustered again.
    small, large = np.log(finest), np.log(extent)
    found, cell = [_clustered(surface, lower, extent) for surface in fine], extent
    for _ in range(_STEPS):
        middle = 0.5 * (small + large)
        tried = [_clustered(surface, lower, float(np.exp(middle))) for surface in fine]
        if sum(len(surface.faces) for surface in tried) <= triangles:
            large, found, cell = middle, tried, float(np.exp(middle))
        else:
            small = middle
    return found, cell


def _whole(stream: Stream) -> _Surface:
    triangles = np.concatenate(list(stream))
    corners = triangles.reshape(-1, 3)
    return _Surface(corners, _corner_areas(triangles), np.arange(len(corners)).reshape(-1, 3))


def _clustered_stream(stream: Stream, lower: Float64, cell: float) -> _Surface:
    """One pass over a stream; never are more than a chunk and what is left of those before it in memory."""
    made = _Merged(stream, lower, cell)
    return _Surface(made.sums / made.weights[:, None], made.weights, np.searchsorted(made.cells, made.faces))


class _Merged:
    """The clusters of a stream.

    cells   : (C,) their numbers, ascending
    sums    : (C, 3) of the corners in each, weighted by the areas of their triangles
    weights : (C,) of these areas
    faces   : (F, 3) cells of the triangles that are left, each once
    """

    def __init__(self, stream: Stream, lower: Float64, cell: float) -> None:
        self.cells, self.faces = np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
        self.sums, self.weights = np.zeros((0, 3)), np.zeros(0)
        waiting: list[tuple[Int64, Float64, Float64, Int64]] = []
        for triangles in stream:
            corners, areas = triangles.reshape(-1, 3), _corner_areas(triangles)
            keys = _keys(corners, lower, cell)
            waiting.append((*_summed(keys, corners * areas[:, None], areas), _distinct(keys.reshape(-1, 3))))
            # Not after each chunk, or the time would grow with the square of their number.
            if sum(len(part[0]) for part in waiting) > len(self.cells):
                self._merge(waiting)
        self._merge(waiting)

    def _merge(self, waiting: list[tuple[Int64, Float64, Float64, Int64]]) -> None:
        parts = [(self.cells, self.sums, self.weights, self.faces), *waiting]
        cells, sums, weights, faces = (np.concatenate(column) for column in zip(*parts, strict=True))
        self.cells, self.sums, self.weights = _summed(cells, sums, weights)
        self.faces = _distinct(faces)
        waiting.clear()


def _summed(keys: Int64, values: Float64, weights: Float64) -> tuple[Int64, Float64, Float64]:
    """The different keys (N,), ascending, and of each the sums of values (N, 3) and of weights (N,)."""
    found, which = np.unique(keys, return_inverse=True)
    sums = np.empty((len(found), 3))
    for axis in range(3):
        sums[:, axis] = np.bincount(which, values[:, axis], len(found))
    return found, sums, np.asarray(np.bincount(which, weights, len(found)), np.float64)


def _clustered(surface: _Surface, lower: Float64, cell: float) -> _Surface:
    keys = _keys(surface.vertices, lower, cell)
    cells, sums, weights = _summed(keys, surface.vertices * surface.weights[:, None], surface.weights)
    faces = np.searchsorted(cells, _distinct(keys[surface.faces]))
    return _Surface(sums / weights[:, None], weights, faces)


def _keys(points: Float64, lower: Float64, cell: float) -> Int64:
    """(N,) numbers of the cells that points (N, 3) lie in."""
    x, y, z = np.maximum(np.floor((points - lower) / cell), 0).astype(np.int64).T
    return np.asarray(x | y << 20 | z << 40)


def _corner_areas(triangles: Float64) -> Float64:
    """(3 F,) for each corner of triangles (F, 3, 3) the area."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.repeat(0.5 * np.linalg.norm(cross, axis=1), 3)


def _distinct(faces: Int64) -> Int64:
    """Those of faces (F, 3) with three different corners, each once; the least corner is the first."""
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    first = faces.argmin(axis=1)[:, None]
    rows = np.ascontiguousarray(np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1))
    # A row as one item is sorted faster than by its columns.
    once = np.unique(rows.view(np.dtype((np.void, rows.strides[0]))).ravel()) if len(rows) else rows
    return once.view(np.int64).reshape(-1, 3)
