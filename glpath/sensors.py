"""Where paths start, described in plain numbers: what a `RenderJob` has, and what a first stage is made from.

One kind so far, the pixels of a pinhole camera. (Texels of a surface and free points are others to come.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glpath.scene.model import Camera, Scene

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class CameraSensor:
    """The pixels of a pinhole camera; values as in `glpath.scene.Camera`, which has arrays.

    position, target, up : scene units
    fov                  : vertical, of the whole image, degrees
    resolution           : (width, height) of the whole image, pixels
    """

    position: Vector
    target: Vector
    up: Vector
    fov: float
    resolution: tuple[int, int]

    @classmethod
    def of(cls, camera: Camera) -> CameraSensor:
        """That of a camera."""
        position, target, up = (tuple(map(float, v)) for v in (camera.position, camera.target, camera.up))
        width, height = camera.resolution
        return cls(position, target, up, float(camera.fov), (int(width), int(height)))  # type: ignore[arg-type]

    @property
    def camera(self) -> Camera:
        """The camera that it is."""
        position, target, up = (np.array(v, np.float64) for v in (self.position, self.target, self.up))
        return Camera(position, target, up, self.fov, self.resolution)

    def seen(self, scene: Scene) -> Scene:
        """The scene as this sensor sees it: with its camera."""
        return scene.with_camera(**vars(self.camera))
