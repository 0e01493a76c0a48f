"""Scenes that differ in what they have: cameras, materials, primitives, lights, a sky. Each has other shaders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from glpath.io.from_python import PythonLocation
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
#: Of so many kinds are they. Each has shaders of its own, four times as many as a context keeps, so that each
#: scene of a series loads its programs anew; Mesa compiles those of a kind once, for its cache on disk.
KINDS = 50


def scene(number: int) -> Scene:
    """One of them, no two alike: what it has, and so its shaders, its kind says; where and how much, its number."""
    kind, own = np.random.default_rng(1000 + number % KINDS), np.random.default_rng(number)
    chosen = kind.choice(len(_MATERIALS), size=int(kind.integers(1, 5)), replace=False)
    materials = {f"m{i}": _MATERIALS[k] for i, k in enumerate(chosen)}
    shapes: list[dict[str, Any]] = [
        {"type": "quad", "corners": [[-2, -1, -2], [-2, -1, 2], [2, -1, 2], [2, -1, -2]], "material": "m0"}
    ]
    for i in range(int(kind.integers(1, 4))):
        ball = {"type": "sphere", "radius": float(own.uniform(0.1, 0.3))}
        box = {"type": "box", "size": own.uniform(0.1, 0.5, 3).tolist()}
        solid = ball if i == 0 and kind.random() < 0.2 else box  # a ball is 1280 triangles, which take time
        center = own.uniform(-0.5, 0.5, 3).tolist()
        shapes.append({**solid, "center": center, "material": f"m{kind.integers(len(materials))}"})
    if kind.random() < 0.3:
        shapes.append({**_LAMP, "material": "m0", "emission": {"radiance": own.uniform(2, 8, 3).tolist()}})
    table = {
        "camera": _CAMERAS[int(kind.integers(len(_CAMERAS)))],
        "materials": materials,
        "shapes": shapes,
        "lights": [light for light in _LIGHTS if kind.random() < 0.4],
        "textures": {"tiles": {"type": "checker", "colors": [[0.1, 0.2, 0.3], [0.8, 0.7, 0.6]], "scale": 3}},
        "ambient": own.uniform(0.05, 0.15, 3).tolist(),
    }
    if kind.random() < 0.4:
        table["sky"] = {"zenith": own.uniform(0.1, 0.3, 3).tolist(), "horizon": [0.5, 0.5, 0.5]}
    return scene_of(table, PythonLocation("scene"), Path(), f"scene {number}")
