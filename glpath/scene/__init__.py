"""The model of a scene: primitives, materials, lights and a camera. Plain data: no file is read here, and no GL."""

from glpath.scene.background import Background
from glpath.scene.camera import CameraKey
from glpath.scene.check import check_camera, check_scene
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
