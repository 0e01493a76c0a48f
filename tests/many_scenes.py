"""Scenes that differ in what they have: cameras, materials, primitives, lights, a sky. Each has other shaders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from glpath.io.from_python import PythonPlace
from glpath.io.load import scene_of
from glpath.scene.model import Scene

_VIEW = {"position": [0, 0, 3], "target": [0, 0, 0]}
_CAMERAS: list[dict[str, Any]] = [
    {"type": "perspective", **_VIEW},
    {"type": "perspective", **_VIEW, "aperture_radius": 0.05},
    {"type": "orthographic", **_VIEW, "height": 2.0},
    {"type": "panorama", **_VIEW},
]
_MATERIALS: list[dict[str, Any]] = [
    {"type": "diffuse", "reflectance": 0.5},
    {"type": "diffuse", "texture": "tiles"},
    {"type": "diffuse", "opacity": 0.5, "alpha": "blend"},
    {"type": "phong", "reflectance": 0.4, "specular": 0.3, "exponent": 30},
    {"type": "phong", "reflectance": 0.4, "mirror": 0.3},
    {"type": "principled", "reflectance": 0.4, "roughness": 0.3},
    {"type": "principled", "reflectance": 0.4, "roughness": 0.3, "anisotropy": 0.5},
    {"type": "principled", "reflectance": 0.9, "roughness": 0.1, "transmission": 1.0},
    {"type": "principled", "roughness": 0.3, "clearcoat": 1.0},
]
_LIGHTS: list[dict[str, Any]] = [
    {"type": "point", "position": [1, 1, 2], "intensity": 5},
    {"type": "spot", "position": [1, 2, 1], "target": [0, 0, 0], "intensity": 5},
    {"type": "directional", "direction": [0, -1, 0.2], "irradiance": 5},
]
_LAMP = {"type": "quad", "corners": [[-0.2, 1, -0.2], [0.2, 1, -0.2], [0.2, 1, 0.2], [-0.2, 1, 0.2]]}


def scene(number: int) -> Scene:
    """One of them; which, the number says."""
    draw = np.random.default_rng(1000 + number)
    chosen = draw.choice(len(_MATERIALS), size=int(draw.integers(1, 5)), replace=False)
    materials = {f"m{i}": _MATERIALS[k] for i, k in enumerate(chosen)}
    shapes: list[dict[str, Any]] = [
        {"type": "quad", "corners": [[-2, -1, -2], [-2, -1, 2], [2, -1, 2], [2, -1, -2]], "material": "m0"}
    ]
    for _ in range(int(draw.integers(1, 6))):
        center = draw.uniform(-0.5, 0.5, 3).tolist()
        ball, box = {"type": "sphere", "radius": 0.2}, {"type": "box", "size": draw.uniform(0.1, 0.5, 3).tolist()}
        solid = ball if draw.random() < 0.5 else box
        shapes.append({**solid, "center": center, "material": f"m{draw.integers(len(materials))}"})
    if draw.random() < 0.3:
        shapes.append({**_LAMP, "material": "m0", "emission": {"radiance": [5, 5, 5]}})
    table = {
        "camera": _CAMERAS[int(draw.integers(len(_CAMERAS)))],
        "materials": materials,
        "shapes": shapes,
        "lights": [light for light in _LIGHTS if draw.random() < 0.4],
        "textures": {"tiles": {"type": "checker", "colors": [[0.1, 0.2, 0.3], [0.8, 0.7, 0.6]], "scale": 3}},
        "ambient": [0.1, 0.1, 0.1],
    }
    if draw.random() < 0.4:
        table["sky"] = {"zenith": [0.1, 0.2, 0.3], "horizon": [0.5, 0.5, 0.5]}
    return scene_of(table, PythonPlace("scene"), Path(), f"scene {number}")
