"""Centring of a scene in float64, before its coordinates are rounded to 32 bits.

Georeferenced models are millions of units from the origin, where adjacent 32-bit floats differ by half a unit. So
engines, solvers and writers of 32-bit formats use `Scene.centred`: `Scene.origin` is subtracted in float64 from all
coordinates. A scene that is near the origin stays bit-identical.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from glpath.scene.camera import Camera
from glpath.scene.geometry import Mesh, Shape, Shapes
from glpath.scene.portal import Portal
from glpath.scene.stream import Stream

if TYPE_CHECKING:
    from glpath.scene.model import Scene

Float64 = NDArray[np.float64]

#: Maximum distance of a scene's centre from the origin, in diagonals of its box; a scene farther away is moved. At
#: that distance 32-bit floats resolve 2e-7 of the diagonal, a tenth of the scan tolerance (`DEPTH_TOLERANCE` in
#: shaders/path_buffer/path_scan.frag).
FARTHEST = 4.0


def origin_of(lower: Float64, upper: Float64) -> Float64:
    """Return the (3,) origin to subtract from a scene with these bounds; zeros if the scene is near the origin."""
    middle, diagonal = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
    farthest = float(np.abs(middle).max())
    # Bounds without size are the point of a single infinite plane, which may be any of its points.
    if not 0 < diagonal < math.inf or farthest <= FARTHEST * diagonal:
        return np.zeros(3)
    step = 2.0 ** math.floor(math.log2(diagonal))
    return np.asarray(np.round(middle / step) * step)


def centred(scene: Scene) -> Scene:
    """Return the scene relative to its own origin, see `Scene.centred`."""
    if scene.centred_by is not None:
        return scene
    # The camera is ignored, because it may be far from the shapes.
    origin = origin_of(*scene.still().bounds)
    return moved(scene, origin) if origin.any() else scene


def moved(scene: Scene, origin: Float64) -> Scene:
    """Return the scene relative to a point (3,)."""
    lower, upper = scene.bounds
    middle = 0.5 * (lower + upper) - origin
    meshes: dict[Mesh, tuple[Mesh, Float64]] = {mesh: _about_itself(mesh) for mesh in scene.shapes.meshes}
    lights = (
        light if light.kind == "directional" else replace(light, position=light.position - origin)
        for light in scene.lights
    )
    background = scene.background
    if background is not None and background.ground is not None:
        background = replace(background, ground=background.ground - origin)
    return replace(
        scene,
        background=background,
        camera=moved_camera(scene.camera, origin),
        shapes=Shapes(_moved_shape(scene, shape, origin, middle, meshes) for shape in scene.shapes),
        lights=tuple(lights),
        portals=tuple(Portal(portal.corners - origin) for portal in scene.portals),
        centred_by=scene.origin + origin,
    )


def moved_camera(camera: Camera, origin: Float64) -> Camera:
    """Return the camera relative to a point (3,); the same object if the point is zero."""
    if not origin.any():
        return camera
    keys = (replace(key, position=key.position - origin, target=key.target - origin) for key in camera.motion)
    return replace(camera, position=camera.position - origin, target=camera.target - origin, motion=tuple(keys))


def _about_itself(mesh: Mesh) -> tuple[Mesh, Float64]:
    """Return the mesh with vertices near zero, for 32-bit files, and the (3,) origin that was subtracted."""
    origin = origin_of(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) if len(mesh.vertices) else np.zeros(3)
    return (replace(mesh, vertices=mesh.vertices - origin) if origin.any() else mesh), origin


def _moved_shape(
    scene: Scene, shape: Shape, origin: Float64, middle: Float64, meshes: dict[Mesh, tuple[Mesh, Float64]]
) -> Shape:
    if isinstance(shape.geometry, Stream):
        return replace(shape, geometry=_moved_stream(shape.geometry, origin))
    if isinstance(shape.geometry, Mesh):
        mesh, within = meshes[shape.geometry]
        if within.any():
            motion = shape.motion
            if motion is not None:
                motion = replace(motion, placed=_before(motion.placed, within))
            maps = _before(shape.world_from_object, within)
            shape = replace(shape, geometry=mesh, world_from_object=maps, motion=motion)
    maps = _shifted(shape.world_from_object, origin)
    if shape.geometry == "plane" and not scene.materials[shape.material].needs_uv:
        maps = _about(maps, middle)
    motion = shape.motion
    if motion is not None:
        motion = replace(motion, maps=_shifted(motion.maps, origin))
    return replace(shape, world_from_object=maps, motion=motion)


def _shifted(maps: Float64, origin: Float64) -> Float64:
    """Return affine maps (N, 3, 4) whose results are relative to the origin (3,)."""
    found = np.array(maps, np.float64)
    found[:, :, 3] -= origin
    return found


def _before(maps: Float64, within: Float64) -> Float64:
    """Return affine maps (N, 3, 4) for a mesh from whose vertices the point `within` (3,) was subtracted."""
    found = np.array(maps, np.float64)
    found[:, :, 3] += found[:, :, :3] @ within
    return found


def _about(planes: Float64, middle: Float64) -> Float64:
    """Return planes (N, 3, 4) whose origin u = v = 0 is their point nearest to `middle`, for planes without uv."""
    found = planes.copy()
    normal = found[:, :, 2]
    apart = np.sum((found[:, :, 3] - middle) * normal, axis=1, keepdims=True)
    found[:, :, 3] = middle + apart * normal
    return found


@dataclass(frozen=True)
class _MovedChunk:
    """Function that returns a chunk of a stream relative to `origin`, a point (3,)."""

    chunk: Callable[[int], Float64]
    origin: Float64

    def __call__(self, number: int) -> Float64:
        return self.chunk(number) - self.origin


def _moved_stream(stream: Stream, origin: Float64) -> Stream:
    digest = hashlib.sha256(stream.digest.encode() + np.ascontiguousarray(origin, "<f8").tobytes()).hexdigest()
    return replace(
        stream,
        chunk=_MovedChunk(stream.chunk, origin),
        lower=stream.lower - origin,
        upper=stream.upper - origin,
        digest=digest,
    )
