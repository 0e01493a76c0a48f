"""Proxy geometry: streamed triangles as a mesh that fits into memory, for code that needs all triangles at once.

Corners in the same cell of a grid become one vertex, their mean weighted by the areas of their triangles (vertex
clustering, Rossignac & Borrel 1993). Triangles with two corners in one cell vanish. A closed surface stays closed.
A stream of few triangles is its own proxy, bit for bit.

Cost:     one pass over the stream, a microsecond a triangle, and some hundred bytes for each cell of a fine grid.
Poor at:  objects smaller than a cell, such as fences and railings: they are lost with their shadows.
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
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]

#: Maximum number of triangles of all proxies in a scene, for which a radiosity solution takes seconds.
TRIANGLES = 16_384
# Number of cells along the longest side of the box around all streams in the first grid. The search tries no
# smaller cells.
_FINEST = 256
# Number of bisection steps in the search for the cell size, on a logarithmic scale.
_STEPS = 8


class _Surface(NamedTuple):
    """Triangles that share vertices, and for each vertex the total area of its triangles."""

    vertices: Float64
    weights: Float64
    faces: Int64


@dataclass(frozen=True)
class Proxies:
    """Scene whose streams are replaced by meshes.

    scene : first the shapes that are not streams, in order; then a mesh for each stream with remaining triangles.
            So resident triangles keep their numbers
    first : number of the first proxy triangle
    cell  : side of a cell, scene units; 0 if the proxies have all triangles
    area  : area of all proxies, as a fraction of that of the streams
    """

    scene: Scene
    first: int
    cell: float
    area: float


def with_proxies(scene: Scene, triangles: int = TRIANGLES) -> Proxies:
    """Return the scene with at most `triangles` proxy triangles instead of its streams.

    If the streams have no more triangles than that, all are used unchanged.
    """
    resident = [shape for shape in scene.shapes if not isinstance(shape.geometry, Stream)]
    streamed = [scene.shapes[index] for index, _ in scene.shapes.streams]
    surfaces, cell = _proxies(
        [shape.geometry for shape in streamed if isinstance(shape.geometry, Stream)], triangles
    )
    shapes = [*resident, *(_as_mesh(*pair) for pair in zip(streamed, surfaces, strict=True) if len(pair[1].faces))]
    found, first = replace(scene, shapes=Shapes(shapes)), Shapes(resident).total("triangle")
    # The weights contain the area of each triangle three times, once for each corner.
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
    # Find the smallest cells that leave few enough triangles. The fine surfaces are in memory, so clustering them
    # again is quick.
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
    """Return a stream clustered in one pass. Only a chunk and the clusters of earlier chunks are in memory."""
    made = _Merged(stream, lower, cell)
    return _Surface(made.sums / made.weights[:, None], made.weights, np.searchsorted(made.cells, made.faces))


class _Merged:
    """Clusters of a stream.

    cells : (C,) keys of the cells, ascending, see `_keys`
    sums    : (C, 3) sum of the corners in each cell, weighted by the areas of their triangles
    weights : (C,) sum of these areas
    faces   : (F, 3) cells of the remaining triangles, each once
    """

    def __init__(self, stream: Stream, lower: Float64, cell: float) -> None:
        self.cells, self.faces = np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
        self.sums, self.weights = np.zeros((0, 3)), np.zeros(0)
        waiting: list[tuple[Int64, Float64, Float64, Int64]] = []
        for triangles in stream:
            check_time()
            corners, areas = triangles.reshape(-1, 3), _corner_areas(triangles)
            keys = _keys(corners, lower, cell)
            waiting.append((*_summed(keys, corners * areas[:, None], areas), _distinct(keys.reshape(-1, 3))))
            # Merging after each chunk would take time proportional to the square of the number of chunks.
            if sum(len(part[0]) for part in waiting) > len(self.cells):
                self._merge(waiting)
        self._merge(waiting)

    def _merge(self, waiting: list[tuple[Int64, Float64, Float64, Int64]]) -> None:
        parts = [(self.cells, self.sums, self.weights, self.faces), *waiting]
        cells, sums, weights, faces = (np.concatenate(column) for column in zip(*parts, strict=True))
        self.cells, self.sums, self.weights = _summed(cells, sums, weights)
        check_time()
        self.faces = _distinct(faces)
        check_time()
        waiting.clear()


def _summed(keys: Int64, values: Float64, weights: Float64) -> tuple[Int64, Float64, Float64]:
    """Return the distinct keys, ascending, and for each the sums of values (N, 3) and of weights (N,)."""
    check_time()
    found, which = np.unique(keys, return_inverse=True)
    sums = np.empty((len(found), 3))
    for axis in range(3):
        check_time()
        sums[:, axis] = np.bincount(which, values[:, axis], len(found))
    return found, sums, np.asarray(np.bincount(which, weights, len(found)), np.float64)


def _clustered(surface: _Surface, lower: Float64, cell: float) -> _Surface:
    keys = _keys(surface.vertices, lower, cell)
    cells, sums, weights = _summed(keys, surface.vertices * surface.weights[:, None], surface.weights)
    check_time()
    faces = np.searchsorted(cells, _distinct(keys[surface.faces]))
    check_time()
    return _Surface(sums / weights[:, None], weights, faces)


def _keys(points: Float64, lower: Float64, cell: float) -> Int64:
    """Return (N,) for each point (N, 3) the key of its cell: the cell's indices along x, y and z, 20 bits each."""
    x, y, z = np.maximum(np.floor((points - lower) / cell), 0).astype(np.int64).T
    return np.asarray(x | y << 20 | z << 40)


def _corner_areas(triangles: Float64) -> Float64:
    """Return (3 F,) areas of triangles (F, 3, 3), repeated for each of the three corners."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.repeat(0.5 * np.linalg.norm(cross, axis=1), 3)


def _distinct(faces: Int64) -> Int64:
    """Return the faces (F, 3) with three distinct corners, each once, rotated to start at the smallest corner."""
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    first = faces.argmin(axis=1)[:, None]
    rows = np.ascontiguousarray(np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1))
    check_time()
    # Rows viewed as single items sort faster than by columns.
    once = np.unique(rows.view(np.dtype((np.void, rows.strides[0]))).ravel()) if len(rows) else rows
    return once.view(np.int64).reshape(-1, 3)
