"""Streamed triangles in parts that fit into a budget, each with its BVH: one reading pass serves all rays.

Chunks are taken along a Z curve through the centres of their boxes, so that the box around a part is small.
`StreamParts` is for rays along directions that many points share, `glpath.gl.stream_occluders` for the shadow rays
of pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glpath.gl.parallel_rays import along_z_curve
from glpath.gl.ray_bvh import PartBvh
from glpath.scene import Scene
from glpath.scene.stream import triangles_in_budget

Float64 = NDArray[np.float64]

#: Bytes per triangle of a part during the build of its BVH: corners, items, nodes, their order, and the device's
#: copy.
BYTES_A_TRIANGLE = 580
#: Bytes per triangle of the largest chunk while it is read: in 64 bits, before and after transformation and checks.
BYTES_IN_THE_READING = 400
# Minimum number of streamed triangles for which compiled code builds the trees.
_MANY = 200_000


class PartTriangles(NamedTuple):
    """Triangles of some chunks of a scene's streams.

    corners : (T, 3, 3) float32
    number  : (T,) int64, index among all streamed triangles, in the order of the scene
    chunk   : (T,) int64, index of each triangle's chunk along the curve
    first, last : range of chunks, the end excluded
    """

    corners: NDArray[np.float32]
    number: NDArray[np.int64]
    chunk: NDArray[np.int64]
    first: int
    last: int


class ChunksInOrder:
    """Chunks of all streams of a scene, ordered along a Z curve.

    scene  : centred scene in the space of the rays

    lower, upper : (N, 3) corners of the chunks' boxes
    counts  : (N,) int64, number of triangles of each chunk
    """

    def __init__(self, scene: Scene) -> None:
        streams = [stream for _, stream in scene.shapes.streams]
        chunks = [(stream, number) for stream in streams for number in range(len(stream.counts))]
        counts = np.concatenate([stream.counts for stream in streams])
        lower = np.concatenate([stream.lower for stream in streams])
        upper = np.concatenate([stream.upper for stream in streams])
        order = along_z_curve(0.5 * (lower + upper))
        self._chunks = [chunks[k] for k in order]
        self._firsts = (np.cumsum(counts) - counts)[order]
        self.counts, self.lower, self.upper = counts[order], lower[order], upper[order]

    def parts(self, room: int, first: int = 0) -> Iterator[PartTriangles]:
        """Yield parts from chunk `first` on, each of at most `room` triangles, or of one chunk."""
        while first < len(self.counts):
            last = first + max(1, int(np.searchsorted(np.cumsum(self.counts[first:]), room, side="right")))
            # The part is not assigned to a name, which would keep it in memory during the next read.
            yield self._read(first, last)
            first = last

    def _read(self, first: int, last: int) -> PartTriangles:
        counts = self.counts[first:last]
        corners = np.empty((int(counts.sum()), 3, 3), np.float32)
        at = 0
        for stream, number in self._chunks[first:last]:
            triangles = stream.triangles(number)
            corners[at : at + len(triangles)] = triangles
            at += len(triangles)
            del triangles
        begin = np.cumsum(counts) - counts
        numbers = np.repeat(self._firsts[first:last] - begin, counts) + np.arange(len(corners))
        return PartTriangles(corners, numbers, np.repeat(np.arange(first, last), counts), first, last)


class Part(NamedTuple):
    """Some chunks of a scene's streams.

    bvh   : BVH over their triangles
    lower, upper : (3,) corners of the box around them
    done  : number of chunks up to the end of this part
    """

    bvh: PartBvh
    lower: Float64
    upper: Float64
    done: int


class StreamParts:
    """Streams of a scene in parts.

    scene  : centred scene in the space of the rays
    budget : MiB for a part, on the device and in main memory

    chunks : number of chunks of all streams
    Raises UsageError if the budget has no room for the largest chunk.
    """

    def __init__(self, scene: Scene, budget: int) -> None:
        self._source = scene.source or scene.name
        self._order = ChunksInOrder(scene)
        counts = self._order.counts
        self.chunks = len(counts)
        self._room = triangles_in_budget(counts, budget, BYTES_A_TRIANGLE, BYTES_IN_THE_READING)
        self._compiled = int(counts.sum()) >= _MANY

    def __call__(self, gl: moderngl.Context, far: float, first: int = 0) -> Iterator[Part]:
        """Yield parts from chunk `first` on; the caller must keep only one at a time.

        far : maximum absolute coordinate of a ray's start
        """
        order = self._order
        for part in order.parts(self._room, first):
            bvh = PartBvh(gl, part.corners, part.chunk, far, self._compiled, self._source)
            which = slice(part.first, part.last)
            del part
            yield Part(bvh, order.lower[which].min(axis=0), order.upper[which].max(axis=0), which.stop)
            del bvh
