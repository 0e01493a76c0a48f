"""Visibility of the surroundings from many points, along directions that all points share.

If all triangles are in memory, rays are traced through one BVH. That is faster than scan conversion for any number
of points and triangles (`python -m benchmarks bench parallel-rays`). Streamed triangles are loaded part by part,
each with its own BVH. All directions are traced through a part while it is in memory, so one pass over the stream
is enough. Points need not lie on a surface. They are lifted along their normals by the rounding error of the
scene's coordinates.

Cost:     0.05 to 0.2 microseconds of a core for each point and direction. With a stream, the same for each part
          that a ray may meet, and a microsecond of a core for each triangle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.daylight.receivers import Receiver
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

#: Default memory budget for streamed triangles, MiB.
GEOMETRY_BUDGET = 256
# Maximum size of the visibility words that `visible` computes in one pass over a stream, bytes.
_OF_A_PASS = 1 << 26


class PointVisibility(Owner):
    """Tracer of visibility rays from points of a scene, on the device.

    gl       : OpenGL context
    scene    : any scene in which paths can be traced, including scenes with streams
    points   : (N, 3), normals (N, 3) unit
    receiver : a "plane" traces no directions behind it; the other kinds trace all directions
    budget   : memory budget for streamed triangles, MiB
    first    : number of the first point; random numbers at blended surfaces depend on it

    transmits : True if the scene has thin dielectrics, whose transmittance is found, too
    chunks    : number of chunks of streamed triangles; 0 without streams, and then words are found one by one
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
        """Yield the visibility along each word of 32 unit directions (D, 3).

        number : index of the first direction; it seeds random decisions at blended surfaces
        """
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
        """Return words (W, N) and transmittances (W, 32, N) of directions (D, 3), ignoring streamed triangles."""
        words = np.empty((-(-len(directions) // WORD), self.count), np.uint32)
        shares = np.empty((len(words), WORD, self.count), np.float16) if self.transmits else None
        for k, seen in enumerate(self._rays.see_out(directions, number)):
            words[k] = seen.word
            if shares is not None:
                shares[k] = seen.share
        return words, shares

    def pass_over(self, directions: Float64, words: NDArray[np.uint32], first: int = 0) -> Iterator[int]:
        """Clear the bits of words (W, N) whose rays a streamed triangle blocks.

        first : number of the chunk to start from

        Yields the number of finished chunks after each part.
        """
        return_memory()  # because memory freed after the preparation of points would add to the budget
        for part in self._parts(self._gl, self._far, first):
            self._streamed.narrow(part.bvh, part.lower, part.upper, directions, words)
            done = part.done
            del part  # frees its memory before the next part is built
            yield done


def masked(shares: NDArray[np.float16], word: NDArray[np.uint32]) -> NDArray[np.float16]:
    """Return transmittances (32, N), set to 0 for directions whose bit in the word (N,) is cleared."""
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
    """Yield for each direction a (N,) bool array: True for points from which a ray leaves the scene.

    scene      : any source that `load_scene` accepts; it needs neither camera nor light
    points     : (N, 3), on surfaces or free in space; normals (N, 3), or (3,) for all
    directions : (D, 3), of any length but zero
    receiver   : a "plane" sees nothing behind it; "cylinder" and "sphere" see all around
    geometry_budget : memory budget for triangles of a stream, MiB

    Memory holds the points and 32 directions; with a stream, as many directions as fit in 64 MiB. Points see
    through thin glass, even if it transmits only a part of the light.
    """
    positions, facing = checked_points(points, normals)
    _, toward = checked_points(directions, directions)
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
