"""Which points see out of a scene along directions that all of them share, direction after direction.

By rays where the triangles are in memory, as these are sooner there however many points and triangles there are
(`python -m benchmarks bench parallel-rays`); by scans of the path-buffer where some are streamed, which need no
scene in memory. Points need no surface of their own: they are lifted along their normals by the rounding of the
scene's coordinates.

Cost:     rays 0.05 to 0.2 microseconds of a core for each point and direction; a scan a pass over the stream for
          each direction.
"""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.buffers.path_buffer import MAX_PATHS, PathBuffer
from glpath.daylight.receivers import Receiver
from glpath.errors import SceneError
from glpath.gl.constants import RAY_ROUNDING
from glpath.gl.context import open_context
from glpath.gl.device_scene import DeviceScene
from glpath.gl.owner import Owner
from glpath.gl.parallel_rays import WORD, ParallelRays, Seen, along_z_curve
from glpath.gl.ray_bvh import RayBvh
from glpath.gl.thin_dielectrics import thin_dielectric_variants
from glpath.io import AnyScene, load_scene
from glpath.io.completed import aside
from glpath.rendering.points import checked_points
from glpath.scene import Scene, path_traceable
from glpath.scene.instances import instanced

Float64 = NDArray[np.float64]

__all__ = ["visible"]

#: MiB of streamed triangles on the device.
GEOMETRY_BUDGET = 256


class PointVisibility(Owner):
    """Points of a scene on the device.

    gl       : the context
    scene    : any that paths can be traced in, also such with streams
    points   : (N, 3), normals (N, 3) unit
    receiver : directions behind a "plane" are not asked; all are, of the others
    budget   : MiB for streamed triangles

    transmits : there are thin dielectrics, whose share of the light is found, too
    """

    def __init__(
        self,
        gl: moderngl.Context,
        scene: Scene,
        points: Float64,
        normals: Float64,
        receiver: Receiver = "plane",
        budget: int = GEOMETRY_BUDGET,
    ) -> None:
        self.count = len(points)
        traced = path_traceable(scene.still(), streams=True)
        streamed = traced.shapes.total("stream") > 0
        parted = None if streamed else instanced(traced)
        device = DeviceScene(gl, parted or traced, budget if streamed else None)
        extent = float(np.linalg.norm(device.centre) + device.radius)
        positions = points - (traced.origin - scene.origin)
        if receiver == "plane":
            lift = RAY_ROUNDING * (extent + np.abs(positions).max(axis=1, keepdims=True))
            positions, planes = positions + lift * normals, normals
        else:
            planes = np.zeros_like(normals)
        self._rays: ParallelRays | None = None
        if streamed:
            if thin_dielectric_variants(device.scene):
                raise SceneError(
                    f"{scene.source or scene.name}: has a stream and thin glass, through which no scan looks.",
                    "Hold the triangles in memory, or leave the glass out.",
                )
            self._order = along_z_curve(positions)
            self._positions, self._planes = positions, planes
            side = int(np.ceil(min(self.count, MAX_PATHS) ** 0.5))
            self._buffer = PathBuffer(gl, device, (side, max(1, min(side, MAX_PATHS // side))), occlusion=True)
        else:
            self._rays = ParallelRays(gl, device, RayBvh(gl, device), positions, planes)
        self.transmits = self._rays is not None and self._rays.transmits

    def see_out(self, directions: Float64, number: int = 0) -> Iterator[Seen]:
        """What the points see of each word of 32 directions (D, 3), unit, word by word; number: of the first."""
        if self._rays is not None:
            yield from self._rays.see_out(directions, number)
            return
        for first in range(0, len(directions), WORD):
            word = np.zeros(self.count, np.uint32)
            for k, direction in enumerate(directions[first : first + WORD]):
                word |= self._scanned(direction).astype(np.uint32) << np.uint32(k)
            yield Seen(word, None)

    def _scanned(self, direction: Float64) -> NDArray[np.bool_]:
        """(N,)"""
        seen = np.zeros(self.count, np.bool_)
        columns, rows = self._buffer.paths
        for first in range(0, self.count, columns * rows):
            which = self._order[first : first + columns * rows]
            plane = self._planes[which]
            asked = which[(plane @ direction > 0) | ~plane.any(axis=1)]
            seen[asked] = ~self._buffer.blocked(self._positions[asked], direction)
        return seen


def visible(
    scene: AnyScene,
    points: ArrayLike,
    normals: ArrayLike,
    directions: ArrayLike,
    *,
    receiver: Receiver = "plane",
) -> Iterator[NDArray[np.bool_]]:
    """Of each direction in turn, which points see out of the scene along it: (N,) bool.

    scene      : what `load_scene` takes; it needs neither camera nor light
    points     : (N, 3), on surfaces or free in space; normals (N, 3), or (3,) for all
    directions : (D, 3), of any length but zero
    receiver   : a "plane" sees nothing behind it; "cylinder" and "sphere" see all around

    Memory is that of the points and of 32 directions. What thin glass lets through in part is seen.
    """
    positions, facing = checked_points(points, normals, "visible")
    _, toward = checked_points(directions, directions, "visible: directions")
    with aside("camera", "light"):
        loaded = load_scene(scene)
    context = open_context()
    with context, PointVisibility(context.gl, loaded, positions, facing, receiver) as found:
        for first in range(0, len(toward), WORD):
            for seen in found.see_out(toward[first : first + WORD], first):
                for k in range(min(WORD, len(toward) - first)):
                    yield (seen.word >> np.uint32(k) & np.uint32(1)).astype(np.bool_)
