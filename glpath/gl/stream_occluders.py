"""Streamed triangles as occluders of the ray tracer's shadow rays: part after part, each with a BVH.

A ray is occluded if any part occludes it, so parts may come in any order. They are cached between path sets if the
budget has room for all. Otherwise each path set reads and builds them again.

Cost:     a core microsecond a triangle, for the BVH. Up to 400 bytes a triangle of a part during its build, then up
          to 130 on the device.
Poor at:  many path sets with a budget that cannot cache all parts.
"""

from __future__ import annotations

from collections.abc import Iterator

import moderngl

from glpath.gl.device_bvh import StreamedBvh
from glpath.gl.geometry_stream import GeometryStream
from glpath.gl.stream_parts import BYTES_IN_THE_READING, ChunksInOrder
from glpath.scene import Scene

#: Bytes per triangle of a part during the build of its BVH, if each leaf has one triangle. Most leaves have two or
#: three.
OCCLUDER_BYTES = 400
#: Bytes per triangle of a cached part, if each leaf has one triangle.
KEPT_OCCLUDER_BYTES = 130


class StreamOccluders:
    """Streams of a scene in parts, for rays from pixels of the ray tracer.

    Parts are cached between passes if the budget has room for all. Hits of a triangle are bit-identical to those of
    the same triangle in a mesh, for any division into parts.

    gl, scene : context, and the scene as the device has it
    """

    def __init__(self, gl: moderngl.Context, scene: Scene) -> None:
        self._gl, self._source = gl, scene.source or scene.name
        self._order = ChunksInOrder(scene)
        self._kept: list[StreamedBvh] = []
        self._room = 0
        self._keeps = False

    def take_share(self, stream: GeometryStream) -> None:
        """Reserve a part of the budget for streamed triangles; to be called after all records are created.

        stream : stream of the same triangles

        Raises UsageError if the budget has no room for the largest chunk.
        """
        count, largest = int(self._order.counts.sum()), int(self._order.counts.max())
        reading, while_built = BYTES_IN_THE_READING * largest, OCCLUDER_BYTES - KEPT_OCCLUDER_BYTES
        kept = KEPT_OCCLUDER_BYTES * count
        self._keeps = stream.left >= kept + max(while_built * largest + reading, stream.making)
        if not self._keeps:
            kept, while_built, self._kept = 0, OCCLUDER_BYTES, []
        # The largest possible part has all triangles, the smallest has the largest chunk.
        working = min(stream.left, kept + while_built * count + reading)
        working = max(working, kept + while_built * largest + reading)
        stream.leave_room(working, kept)
        self._room = min((working - kept - reading) // while_built, StreamedBvh.max_count(self._gl))

    def __iter__(self) -> Iterator[StreamedBvh]:
        """Yield the parts one after the other; the caller must keep only one at a time."""
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
