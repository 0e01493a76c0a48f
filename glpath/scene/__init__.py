"""Scenes: from TOML to primitives, materials, lights and a camera. Plain data, no GL."""

from glpath.scene.camera import CameraKey
from glpath.scene.check import check_camera, check_scene
from glpath.scene.formats.description import scene_schema
from glpath.scene.formats.from_python import AnyScene
from glpath.scene.formats.load import scene_from_dict
from glpath.scene.model import Camera, Environment, Light, Material, Scene, Shape, Sky, Texture
from glpath.scene.motion import Motion
from glpath.scene.shipped.library import (
    load_scene,
    parameters_from_options,
    scene_cameras,
    scene_parameters,
    shipped_scenes,
)
from glpath.scene.triangulate import path_traceable

__all__ = [
    "AnyScene",
    "Camera",
    "CameraKey",
    "Environment",
    "Light",
    "Material",
    "Motion",
    "Scene",
    "Shape",
    "Sky",
    "Texture",
    "check_camera",
    "check_scene",
    "load_scene",
    "parameters_from_options",
    "path_traceable",
    "scene_cameras",
    "scene_from_dict",
    "scene_parameters",
    "scene_schema",
    "shipped_scenes",
]
