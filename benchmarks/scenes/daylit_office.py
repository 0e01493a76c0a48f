"""A side-lit office of 8 x 6 m, 3 m high, behind a band of windows to the south; y is north, z is up, in metres."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from glpath.scene.model import Float64

WIDTH, DEPTH, HEIGHT = 8.0, 6.0, 3.0
#: Window band: its range in x and in z, and the glass's transmittance at normal incidence.
WINDOW, TRANSMITTANCE = ((0.3, 7.7), (0.9, 2.6)), 0.65
#: Transmittance of the cloth of closed blinds, which scatter all light.
CLOTH = 0.05
#: Height of sensors above the floor, and distance between them, in metres.
DESK, SPACING = 0.76, 0.5


def office(blinds: bool = False) -> dict[str, Any]:
    """Return a scene file's contents. blinds : close all blinds inside of the glass"""
    (x0, x1), (z0, z1) = WINDOW
    wall = [
        _upright(0.0, WIDTH, 0.0, z0), _upright(0.0, WIDTH, z1, HEIGHT),
        _upright(0.0, x0, z0, z1), _upright(x1, WIDTH, z0, z1),
    ]  # fmt: skip
    level, ceiling = ([[0.0, 0.0, z], [WIDTH, 0.0, z], [WIDTH, DEPTH, z], [0.0, DEPTH, z]] for z in (0.0, HEIGHT))
    sides = [[[x, 0, 0], [x, DEPTH, 0], [x, DEPTH, HEIGHT], [x, 0, HEIGHT]] for x in (0, WIDTH)]
    walls = [*wall, _upright(0.0, WIDTH, 0.0, HEIGHT, DEPTH), *sides]
    shapes = [
        {"type": "quad", "material": "floor", "corners": level},
        {"type": "quad", "material": "ceiling", "corners": ceiling},
        *({"type": "quad", "material": "wall", "corners": corners} for corners in walls),
        {"type": "quad", "material": "glass", "corners": _upright(x0, x1, z0, z1)},
    ]
    if blinds:
        # The cloth is larger than the window, so that no sun passes its edge.
        cloth = _upright(x0 - 0.1, x1 + 0.1, z0 - 0.1, z1 + 0.1, 0.05)
        shapes.append({"type": "quad", "material": "cloth", "corners": cloth})
    return {
        "name": "office with blinds" if blinds else "office",
        "unit": "photometric",
        "camera": {"position": [4, 5, 1.6], "target": [4, 0, 1.4], "up": [0, 0, 1]},
        "materials": {
            "floor": {"reflectance": 0.2},
            "wall": {"reflectance": 0.5},
            "ceiling": {"reflectance": 0.8},
            "glass": {"type": "glazing", "transmittance": TRANSMITTANCE},
            # Matte, because the glossy layer of principled materials would mirror some of the light.
            "cloth": {"type": "principled", "reflectance": 0.5, "specular": 0.0, "diffuse_transmission": CLOTH},
        },
        "shapes": shapes,
    }


def as_toml(description: dict[str, Any]) -> str:
    """Return a scene file of what `office` returns."""

    def written(value: Any) -> str:
        if isinstance(value, dict):
            return "{ " + ", ".join(f"{key} = {written(each)}" for key, each in value.items()) + " }"
        if isinstance(value, list):
            return "[" + ", ".join(map(written, value)) + "]"
        return json.dumps(value)

    return "".join(f"{key} = {written(value)}\n" for key, value in description.items())


def sensors() -> Float64:
    """Return (192, 3) sensors, in the middles of the cells of a grid."""
    x, y = (np.arange(0.5 * SPACING, end, SPACING) for end in (WIDTH, DEPTH))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.concatenate([grid, np.full((len(grid), 1), DESK)], axis=1)


def _upright(x0: float, x1: float, z0: float, z1: float, y: float = 0.0) -> list[list[float]]:
    return [[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]]
