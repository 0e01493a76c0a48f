"""Some objects on a floor, and lights of every kind above them."""

from __future__ import annotations

from typing import Any

import numpy as np

from glpath.io import scene_from_dict
from glpath.scene import Scene, path_traceable

RHO = np.array([0.8, 0.5, 0.2])

CORNERS = [[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]]

FLOOR: dict[str, Any] = {"type": "quad", "corners": CORNERS, "material": "m"}

POINT: dict[str, Any] = {"type": "point", "position": [0.5, 2.5, 1.2], "intensity": [12.0, 10.0, 8.0]}

LAMP: dict[str, Any] = {
    "type": "quad",
    "corners": [[-1, 2.5, -0.5], [-1, 2.5, 0.5], [-2, 2.5, 0.5], [-2, 2.5, -0.5]],
    "emission": {"radiance": [4.0, 6.0, 9.0], "two_sided": True},
}

THINGS: list[dict[str, Any]] = [
    FLOOR,
    {"type": "quad", "corners": [[-3, 0, -3], [3, 0, -3], [3, 3, -3], [-3, 3, -3]], "material": "grey"},
    {
        "type": "box",
        "min": [-1, 0, -0.5],
        "max": [0, 1, 0.5],
        "material": "grey",
        "transform": [{"rotate": {"axis": [0, 1, 0], "angle": 25}}],
    },
    {"type": "box", "min": [0.6, 0, 0.4], "max": [1.1, 0.5, 0.9], "material": "m"},
    {"type": "box", "min": [-1.6, 0, 0.9], "max": [-1.55, 1.4, 0.95], "material": "m"},
    {"type": "sphere", "center": [1.2, 0.6, -1], "radius": 0.6, "subdivisions": 2, "material": "grey"},
]


def scene_of(
    shapes: list[dict[str, Any]] = THINGS,
    position: Any = (3, 4, 5),
    target: Any = (0, 0.3, 0),
    fov: float = 40.0,
    size: tuple[int, int] = (16, 12),
    up: Any = (0, 1, 0),
    **tables: Any,
) -> Scene:
    return path_traceable(
        scene_from_dict(
            {
                "camera": {"type": "perspective", "position": position, "target": target, "up": up, "fov": fov},
                "film": {"resolution": list(size)},
                "materials": {"m": {"reflectance": RHO.tolist()}, "grey": {"reflectance": 0.5}},
                "shapes": shapes,
                **tables,
            }
        )
    )


def floor_from_above(x: float = 0.7, **tables: Any) -> Scene:
    """Return a scene that shows one degree of the floor around (x, 0, 0.01)."""
    return scene_of([FLOOR], (x, 3, 0.01), (x, 0, 0.01), fov=1, size=(8, 8), up=(0, 0, 1), **tables)
