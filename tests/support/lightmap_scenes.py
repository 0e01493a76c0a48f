"""Small scenes for bakes."""

from __future__ import annotations

from typing import Any

from glpath.io import load_scene
from glpath.scene import Scene

CAMERA = {"position": [0, -3, 1], "target": [0, 0, 1], "up": [0, 0, 1], "fov": 40}

BLACK = {"black": {"reflectance": 0}, "grey": {"reflectance": 0.5}}

#: A lamp of 1.2 x 0.8 at height 2 that shines down.
LAMP: dict[str, Any] = {
    "name": "lamp",
    "type": "quad",
    "corners": [[-0.6, 0.4, 2], [0.6, 0.4, 2], [0.6, -0.4, 2], [-0.6, -0.4, 2]],
    "emission": {"radiance": [10, 5, 2]},
    "material": "black",
}

FLOOR: dict[str, Any] = {
    "name": "floor",
    "type": "quad",
    "corners": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
    "material": "black",
}


def scene_of(*shapes: dict[str, Any], **parts: Any) -> Scene:
    return load_scene({"camera": CAMERA, "materials": BLACK, "shapes": list(shapes), **parts})


def box(name: str, low: list[float], high: list[float], **more: Any) -> dict[str, Any]:
    return {"name": name, "type": "box", "min": low, "max": high, "material": "grey", **more}
