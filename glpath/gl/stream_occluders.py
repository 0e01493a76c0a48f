"""Streamed triangles as occluders of the ray tracer's shadow rays: part after part, each with a BVH.

A ray is blocked where any part blocks it, so parts may come in any order. They are kept from path set to path set
where the budget has room for all, and are else read and built again for each.

Cost:     a microsecond of a core a triangle, for the BVH. Up to 400 bytes a triangle of a part while that is built,
          then up to 130, on the device.
Poor at:  budgets that cannot keep all parts, when there are many path sets.
"""

from __future__ import annotations

from collections.abc import Iterator

import moderngl

from glpath.gl.device_bvh import StreamedBvh
from glpath.gl.geometry_stream import GeometryStream
from glpath.gl.stream_parts import BYTES_IN_THE_READING, ChunksInOrder
from glpath.scene import Scene

#: Bytes a triangle of a part, while its BVH is built, and when it is kept: of a tree with a triangle a leaf, though
#: most have two or three.
OCCLUDER_BYTES, KEPT_OCCLUDER_BYTES = 400, 130


class StreamOccluders:
    """The streams of a scene in parts, for rays from pixels of the ray tracer.

    They are kept from pass to pass where the budget has room for all. A triangle is hit with the same bits as the
    same one of a mesh, whatever the parts are.

    gl, scene : as the device has it
    """

    def __init__(self, gl: moderngl.Context, scene: Scene) -> None:
        self._gl, self._source = gl, scene.source or scene.name
        self._order = ChunksInOrder(scene)
        self._kept: list[StreamedBvh] = []
        self._room = 0
        self._keeps = False

    def take_share(self, stream: GeometryStream) -> None:
        """Have a share of the budget of the triangles' chunks, when all their records are made.

        stream : of the same triangles

        Raises UsageError for a budget that has no room for the largest chunk.
        """
        count, largest = int(self._order.counts.sum()), int(self._order.counts.max())
        reading, while_built = BYTES_IN_THE_READING * largest, OCCLUDER_BYTES - KEPT_OCCLUDER_BYTES
        kept = KEPT_OCCLUDER_BYTES * count
        self._keeps = stream.left >= kept + max(while_built * largest + reading, stream.making)
        if not self._keeps:
            kept, while_built, self._kept = 0, OCCLUDER_BYTES, []
        # A part of all at most, and of the largest chunk at least.
        working = min(stream.left, kept + while_built * count + reading)
        working = max(working, kept + while_built * largest + reading)
        stream.leave_room(working, kept)
        self._room = min((working - kept - reading) // while_built, StreamedBvh.max_count(self._gl))

    def __iter__(self) -> Iterator[StreamedBvh]:
        """Part after part; only one of them is to be kept at a time."""
        if self._kept:
            yield from self._kept
            return
        built = []
        for part in self._order.parts(self._room):
            bvh = StreamedBvh(self._gl, part.corners, part.number, self._source)
            del part
            if self._keeps:
                built.append(bvh)
            yield bvh
            del bvh
        self._kept = built
