"""Readers and writers of scenes and models, and the scenes that ship: all between files and the model."""

from glpath.io.description import scene_schema
from glpath.io.from_python import AnyScene
from glpath.io.library import (
    load_scene,
    parameters_from_options,
    scene_animations,
    scene_cameras,
    scene_parameters,
    scene_variants,
    shipped_scenes,
)
from glpath.io.load import scene_from_dict

__all__ = [
    "AnyScene",
    "load_scene",
    "parameters_from_options",
    "scene_animations",
    "scene_cameras",
    "scene_from_dict",
    "scene_parameters",
    "scene_schema",
    "scene_variants",
    "shipped_scenes",
]
