"""The scene as plain data: triangles, materials, a camera. No file format and no GL here.

Every shape is triangles by the time it stands here. Quads, boxes, spheres and meshes keep their names and
triangle ranges in `shapes`, so that messages and tables can speak of them.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    position, target, up : (3,) float64, scene units; `up` need not be perpendicular to the view
    fov                  : vertical field of view of the whole image, degrees, 0 < fov < 180
    resolution           : (width, height) in pixels
    """

    position: Float64
    target: Float64
    up: Float64
    fov: float
    resolution: tuple[int, int]

    def frame(self) -> tuple[Float64, Float64, Float64]:
        """Unit vectors (right, up, forward), each (3,) float64. Row 0 of an image is towards `up`."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return right, np.cross(right, forward), forward


@dataclass(frozen=True)
class Material:
    """Lambertian reflection.

    reflectance : (3,) float64 in [0, 1], linear Rec. 709
    two_sided   : False makes the back black (it still blocks light)
    """

    name: str
    reflectance: Float64
    two_sided: bool = True


@dataclass(frozen=True)
class Shape:
    """A named range of triangles with one material.

    emission           : (3,) float64 radiance W sr^-1 m^-2, linear Rec. 709; zeros for a shape that is not a light
    emission_two_sided : the light leaves both sides; otherwise only the side of the normal
    """

    name: str
    kind: str
    first: int
    count: int
    material: int
    emission: Float64 = field(default_factory=lambda: np.zeros(3))
    emission_two_sided: bool = False

    @property
    def emits(self) -> bool:
        return bool(np.any(self.emission > 0))


@dataclass(frozen=True)
class Scene:
    """Everything a renderer needs, as arrays.

    triangles : (T, 3, 3) float64, corners in world space; counter-clockwise seen from the front
    shapes    : ranges that cover the triangles in order, without gaps
    """

    name: str
    camera: Camera
    triangles: Float64
    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    source: str = ""

    @property
    def triangle_shape(self) -> Int32:
        """(T,) int32, the index into `shapes` of each triangle."""
        return np.repeat(np.arange(len(self.shapes), dtype=np.int32), [s.count for s in self.shapes])

    @property
    def normals(self) -> Float64:
        """(T, 3) float64 unit normals, out of the front."""
        n = _area_vectors(self.triangles)
        return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(float).tiny))

    @property
    def areas(self) -> Float64:
        """(T,) float64 triangle areas, scene units squared."""
        return np.asarray(np.linalg.norm(_area_vectors(self.triangles), axis=1))

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(3,) lower and (3,) upper corner of the box around all triangles."""
        points = self.triangles.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)

    def with_camera(self, **changes: object) -> Scene:
        """The same scene seen otherwise; keyword arguments are the fields of `Camera`."""
        return replace(self, camera=replace(self.camera, **changes))  # type: ignore[arg-type]

    def digest(self) -> str:
        """SHA-256 (hex) of all that changes the picture: geometry, materials, lights and camera."""
        h = hashlib.sha256()
        c = self.camera
        h.update(np.concatenate([c.position, c.target, c.up, [c.fov], c.resolution]).astype("<f8").tobytes())
        h.update(np.ascontiguousarray(self.triangles, "<f8").tobytes())
        for s in self.shapes:
            h.update(np.array([s.first, s.count, s.material, s.emission_two_sided], "<i8").tobytes())
            h.update(np.asarray(s.emission, "<f8").tobytes())
        for m in self.materials:
            h.update(np.array([*m.reflectance, m.two_sided], "<f8").tobytes())
        return h.hexdigest()


def _area_vectors(triangles: Float64) -> Float64:
    """(T, 3) float64: along each front normal, as long as the triangle is large."""
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.asarray(0.5 * np.cross(edges[:, 0], edges[:, 1]))
