"""Readers and writers of scene and model files, and the shipped scenes.

The module of a public name is imported when the name is first used, so that printing a command's help is fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

# Submodule of each name; a name that is not listed is in `library`.
_HOME = {"AnyScene": "from_python", "scene_from_dict": "load", "scene_schema": "description"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'glpath.io' has no attribute {name!r}")
    value = getattr(import_module(f"glpath.io.{_HOME.get(name, 'library')}"), name)
    globals()[name] = value
    return value
