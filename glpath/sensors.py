"""Where paths start, described in plain numbers: what a `RenderJob` has, and what a first stage is made from.

One kind so far, the pixels of a camera. (Texels of a surface and free points are others to come.)
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from glpath.scene.camera import CameraKey, Projection
from glpath.scene.model import Camera, Scene

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class SensorKey:
    """Where a camera is at a time; values as in `glpath.scene.CameraKey`, which has arrays."""

    time: float
    position: Vector
    target: Vector
    up: Vector


@dataclass(frozen=True)
class CameraSensor:
    """The pixels of a camera; values as in `glpath.scene.Camera`, which has arrays.

    position, target, up : scene units
    fov                  : vertical, of the whole image, degrees
    resolution           : (width, height) of the whole image, pixels
    """

    position: Vector
    target: Vector
    up: Vector
    fov: float
    resolution: tuple[int, int]
    projection: Projection = "perspective"
    height: float = 1.0
    aperture_radius: float = 0.0
    focus_distance: float | None = None
    shutter: tuple[float, float] = (0.0, 0.0)
    motion: tuple[SensorKey, ...] = ()

    @classmethod
    def of(cls, camera: Camera) -> CameraSensor:
        """That of a camera."""
        width, height = camera.resolution
        focus = camera.focus_distance
        return cls(
            _plain(camera.position),
            _plain(camera.target),
            _plain(camera.up),
            fov=float(camera.fov),
            resolution=(int(width), int(height)),
            projection=camera.projection,
            height=float(camera.height),
            aperture_radius=float(camera.aperture_radius),
            focus_distance=None if focus is None else float(focus),
            shutter=(float(camera.shutter[0]), float(camera.shutter[1])),
            motion=tuple(
                SensorKey(float(k.time), _plain(k.position), _plain(k.target), _plain(k.up)) for k in camera.motion
            ),
        )

    @property
    def camera(self) -> Camera:
        """The camera that it is."""
        keys = tuple(CameraKey(**vars(key)) for key in self.motion)
        return Camera(**vars(self) | {"motion": keys})

    @property
    def kind(self) -> tuple[object, ...]:
        """What an engine is made for: projection, whether it has a lens, whether it moves."""
        return (self.projection, self.aperture_radius > 0, self.camera.moves)

    def seen(self, scene: Scene) -> Scene:
        """The scene as this sensor sees it: with its camera."""
        return scene.with_camera(**vars(self.camera))

    def as_json(self) -> dict[str, Any]:
        """Its fields, as JSON has them, without those that say nothing: a pinhole's are as they always were."""
        said = {f.name for f in fields(self) if getattr(self, f.name) != f.default}
        return {name: value for name, value in asdict(self).items() if name in said}


def _plain(vector: Any) -> Vector:
    x, y, z = map(float, vector)
    return x, y, z
