"""Scenes: from TOML to triangles, materials, lights and a camera. Plain data, no GL."""

from glpath.scene.check import check_camera, check_scene
from glpath.scene.description import scene_schema
from glpath.scene.library import load_scene, parameters_from_options, shipped_scenes
from glpath.scene.load import scene_from_dict
from glpath.scene.model import Camera, Material, Scene, Shape

__all__ = [
    "Camera",
    "Material",
    "Scene",
    "Shape",
    "check_camera",
    "check_scene",
    "load_scene",
    "parameters_from_options",
    "scene_from_dict",
    "scene_schema",
    "shipped_scenes",
]
