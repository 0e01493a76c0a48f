"""Which points see out of a scene along directions that all of them share, direction after direction.

By rays, through one BVH where the triangles are in memory, as these are sooner there than scans however many points
and triangles there are (`python -m benchmarks bench parallel-rays`). Through one BVH after the other where some are
streamed: all directions are asked of a part of the triangles while that is in memory, so one pass over the stream
is all. Points need no surface of their own: they are lifted along their normals by the rounding of the scene's
coordinates.

Cost:     0.05 to 0.2 microseconds of a core for each point and direction; of a stream that for each part that a ray
          may meet, and a microsecond of a core for each triangle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.daylight.receivers import Receiver
from glpath.gl.constants import RAY_ROUNDING
from glpath.gl.context import open_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.gl.parallel_rays import WORD, ParallelRays, Seen
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.stream_parts import StreamParts
from glpath.gl.streamed_rays import StreamedRays
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.rendering.points import checked_points
from glpath.scene import Scene, path_traceable
from glpath.scene.geometry import Shapes
from glpath.scene.instances import instanced
from glpath.system.machine import return_memory

Float64 = NDArray[np.float64]

__all__ = ["visible"]

#: MiB for streamed triangles.
GEOMETRY_BUDGET = 256
# Of `visible`: bytes of the words that one pass over a stream finds.
_OF_A_PASS = 1 << 26


class PointVisibility(Owner):
    """Points of a scene on the device.

    gl       : the context
    scene    : any that paths can be traced in, also such with streams
    points   : (N, 3), normals (N, 3) unit
    receiver : directions behind a "plane" are not asked; all are, of the others
    budget   : MiB for streamed triangles
    first    : number of the first point, which random numbers of blended surfaces follow from

    transmits : there are thin dielectrics, whose share of the light is found, too
    chunks    : of streamed triangles; 0 where there are none, and then words come one after the other
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: Scene,
        points: Float64,
        normals: Float64,
        receiver: Receiver = "plane",
        budget: int = GEOMETRY_BUDGET,
        first: int = 0,
    ) -> None:
        self.count = len(points)
        traced = path_traceable(scene.still(), streams=True)
        parts = StreamParts(traced, budget) if traced.shapes.streams else None
        low, high = traced.bounds
        positions = points - (traced.origin - scene.origin)
        if parts is None:
            device = DeviceScene(gl, instanced(traced) or traced)
            extent = float(np.linalg.norm(device.centre) + device.radius)
        else:
            resident = [shape for shape in traced.shapes if shape.primitive != "stream"]
            device = DeviceScene(gl, replace(traced, shapes=Shapes(resident), centred_by=traced.origin))
            extent = float(np.linalg.norm(0.5 * (low + high)) + 0.5 * np.linalg.norm(high - low))
        if receiver == "plane":
            lift = RAY_ROUNDING * (extent + np.abs(positions).max(axis=1, keepdims=True))
            positions, planes = positions + lift * normals, normals
        else:
            planes = np.zeros_like(normals)
        self._rays = ParallelRays(gl, device, RayBvh(gl, device), positions, planes, first=first)
        self.transmits = self._rays.transmits
        self.chunks = 0
        if parts is not None:
            self._gl, self._parts, self.chunks = gl, parts, parts.chunks
            self._far = max(extent, float(np.abs(positions).max(initial=0.0)))
            self._streamed = StreamedRays(gl, device, positions, self._far)

    def see_out(self, directions: Float64, number: int = 0) -> Iterator[Seen]:
        """What the points see of each word of 32 directions (D, 3), unit, word by word; number: of the first."""
        if not self.chunks:
            yield from self._rays.see_out(directions, number)
            return
        words, shares = self.see_out_of_resident(directions, number)
        for _ in self.pass_over(directions, words):
            pass
        for k, word in enumerate(words):
            yield Seen(word, None if shares is None else masked(shares[k], word))

    def see_out_of_resident(
        self, directions: Float64, number: int = 0
    ) -> tuple[NDArray[np.uint32], NDArray[np.float16] | None]:
        """Words (W, N) and shares (W, 32, N) of directions (D, 3), as if nothing were streamed."""
        words = np.empty((-(-len(directions) // WORD), self.count), np.uint32)
        shares = np.empty((len(words), WORD, self.count), np.float16) if self.transmits else None
        for k, seen in enumerate(self._rays.see_out(directions, number)):
            words[k] = seen.word
            if shares is not None:
                shares[k] = seen.share
        return words, shares

    def pass_over(self, directions: Float64, words: NDArray[np.uint32], first: int = 0) -> Iterator[int]:
        """Clear those bits of words (W, N) whose rays a streamed triangle blocks, from a chunk on, part by part:
        how many chunks are done after each."""
        return_memory()  # or what preparing the points took stays beside the budget
        for part in self._parts(self._gl, self._far, first):
            self._streamed.narrow(part.bvh, part.lower, part.upper, directions, words)
            done = part.done
            del part  # or it would be there while the next one is built
            yield done


def masked(shares: NDArray[np.float16], word: NDArray[np.uint32]) -> NDArray[np.float16]:
    """Shares (32, N), without those of directions whose bit in the word (N,) is cleared."""
    bits = word >> np.arange(WORD, dtype=np.uint32)[:, None] & np.uint32(1)
    return np.where(bits != 0, shares, np.float16(0))


def visible(
    scene: AnyScene,
    points: ArrayLike,
    normals: ArrayLike,
    directions: ArrayLike,
    *,
    receiver: Receiver = "plane",
    geometry_budget: int = GEOMETRY_BUDGET,
) -> Iterator[NDArray[np.bool_]]:
    """Of each direction in turn, which points see out of the scene along it: (N,) bool.

    scene      : what `load_scene` takes; it needs neither camera nor light
    points     : (N, 3), on surfaces or free in space; normals (N, 3), or (3,) for all
    directions : (D, 3), of any length but zero
    receiver   : a "plane" sees nothing behind it; "cylinder" and "sphere" see all around
    geometry_budget : MiB for triangles of a stream

    Memory is that of the points and of 32 directions, or of as many as a pass over a stream finds in 64 MiB. What
    thin glass lets through in part is seen.
    """
    positions, facing = checked_points(points, normals, "visible")
    _, toward = checked_points(directions, directions, "visible: directions")
    with aside("camera", "light"):
        loaded = load_scene(scene)
    context = open_context()
    with context, PointVisibility(context.gl, loaded, positions, facing, receiver, geometry_budget) as found:
        of_a_pass = WORD * max(1, _OF_A_PASS // (4 * max(1, len(positions)))) if found.chunks else WORD
        for first in range(0, len(toward), of_a_pass):
            some = toward[first : first + of_a_pass]
            for word, seen in enumerate(found.see_out(some, first)):
                for k in range(min(WORD, len(some) - WORD * word)):
                    yield (seen.word >> np.uint32(k) & np.uint32(1)).astype(np.bool_)
