"""Scene model as plain data: primitives, materials, lights and a camera. It reads no files and uses no OpenGL.

A submodule is imported when one of its names is first used, so that a command's help does not load numpy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glpath.scene.background import Background
    from glpath.scene.camera import CameraKey
    from glpath.scene.camera_check import check_camera
    from glpath.scene.check import check_scene
    from glpath.scene.model import Camera, Environment, Light, Material, Portal, Scene, Shape, Sky, Texture
    from glpath.scene.motion import Motion
    from glpath.scene.triangulate import path_traceable

__all__ = [
    "Background",
    "Camera",
    "CameraKey",
    "Environment",
    "Light",
    "Material",
    "Motion",
    "Portal",
    "Scene",
    "Shape",
    "Sky",
    "Texture",
    "check_camera",
    "check_scene",
    "path_traceable",
]

# Submodules of the names; names that are not listed are defined in `model`.
_HOME = {
    "Background": "background",
    "CameraKey": "camera",
    "Motion": "motion",
    "check_camera": "camera_check",
    "check_scene": "check",
    "path_traceable": "triangulate",
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'glpath.scene' has no attribute {name!r}")
    value = getattr(import_module(f"glpath.scene.{_HOME.get(name, 'model')}"), name)
    globals()[name] = value
    return value
