"""Office with as many polygons as the office of [SC]: 906, or 2563 with tessellated floor and walls.

The original database of [SC, Statistics] is lost. Only these counts and its ten area lights are known. Desks,
chairs, shelves, partitions and screens are solid boxes; chairs are rotated by various angles.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from glpath.io.load import scene_from_dict
from glpath.scene.model import Scene

_Part = tuple[str, str, tuple[float, float, float], tuple[float, float, float]]

#: Size of the room in metres: x along the window wall, y up. One corner is the origin.
ROOM = (12.0, 3.0, 8.0)
# Counts of rectangles along and across the floor. All surfaces together give 2563 polygons.
_FLOOR = (30, 20)
# Counts of rectangles along and across a long wall.
_LONG = (35, 9)
# Counts of rectangles along and across a short wall.
_SHORT = (24, 9)
_LIGHTS = 10

_Resolution = Annotated[
    int,
    Meta(ge=1, le=4096, description="a whole number from 1 to 4096, the picture's width; its height is 3/4 of it"),
]


_Luminaires = Annotated[
    int,
    Meta(
        ge=1, le=4096, description="a whole number from 1 to 4096, of lights; without it ten of 1.2 by 0.6 metres"
    ),
]


def office(*, resolution: _Resolution = 640, luminaires: _Luminaires = _LIGHTS) -> Scene:
    """Office with desks, chairs, shelves and partitions: 906 polygons, 10 area lights."""
    return _office(False, resolution, luminaires)


def office_premesh(*, resolution: _Resolution = 640) -> Scene:
    """The same office with floor and walls tessellated: 2563 polygons."""
    return _office(True, resolution)


def _office(premesh: bool, resolution: int, luminaires: int = _LIGHTS) -> Scene:
    lights = _lights() if luminaires == _LIGHTS else _luminaires(luminaires)
    shapes = [*_room(premesh), *lights, *_furniture()]
    return scene_from_dict(
        {
            "camera": {"position": [0.4, 2.2, 7.6], "target": [7.5, 0.6, 2.6], "fov": 62},
            "film": {"resolution": [resolution, max(resolution * 3 // 4, 1)]},
            "materials": {
                "wall": {"reflectance": [0.75, 0.73, 0.68]},
                "floor": {"reflectance": [0.32, 0.34, 0.38]},
                "wood": {"reflectance": [0.52, 0.36, 0.22]},
                "steel": {"reflectance": [0.45, 0.46, 0.48]},
                "cloth": {"reflectance": [0.16, 0.24, 0.42]},
                "screen": {"reflectance": [0.08, 0.08, 0.09]},
                "lamp": {"reflectance": 0.8},
            },
            "shapes": shapes,
        },
        source="office-premesh" if premesh else "office",
    )


def _room(premesh: bool) -> list[dict[str, Any]]:
    """Return floor, ceiling, four walls, a door and a board; fronts inward."""
    x, y, z = ROOM
    sides = [
        ("floor", "floor", (0, 0, z), (x, 0, 0), (0, 0, -z), _FLOOR),
        ("window-wall", "wall", (0, 0, 0), (x, 0, 0), (0, y, 0), _LONG),
        ("door-wall", "wall", (x, 0, z), (-x, 0, 0), (0, y, 0), _LONG),
        ("left-wall", "wall", (0, 0, z), (0, 0, -z), (0, y, 0), _SHORT),
        ("right-wall", "wall", (x, 0, 0), (0, 0, z), (0, y, 0), _SHORT),
    ]
    shapes = [
        _sheet(name, material, corner, along, across, cells if premesh else (1, 1))
        for name, material, corner, along, across, cells in sides
    ]
    return [
        *shapes,
        _sheet("ceiling", "wall", (0, y, 0), (x, 0, 0), (0, 0, z)),
        _sheet("door", "wood", (11.2, 0, z - 0.01), (-0.9, 0, 0), (0, 2.1, 0)),
        _sheet("board", "lamp", (x - 0.02, 1.0, 2.5), (0, 0, 3.0), (0, 1.2, 0)),
    ]


def _sheet(
    name: str,
    material: str,
    corner: tuple[float, ...],
    along: tuple[float, ...],
    across: tuple[float, ...],
    cells: tuple[int, int] = (1, 1),
    **more: Any,
) -> dict[str, Any]:
    """Return a rectangle of `cells` quads, whose normal is along the cross product of `along` and `across`."""
    n, m = cells
    u, v = np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1)
    grid = np.array(corner) + u[:, None, None] * np.array(along) + v[None, :, None] * np.array(across)
    first = (np.arange(n)[:, None] * (m + 1) + np.arange(m)).ravel()
    faces = np.stack([first, first + m + 1, first + m + 2, first + 1], axis=1)
    vertices = grid.reshape(-1, 3)
    return {
        "type": "mesh", "name": name, "material": material, "vertices": vertices.tolist(), "faces": faces.tolist(),
        **more,
    }  # fmt: skip


def _lights() -> list[dict[str, Any]]:
    return [
        _light(f"light-{row}-{column}", (0.9 + 2.3 * column, 1.85 + 3.7 * row), (1.2, 0.6))
        for row in range(2)
        for column in range(5)
    ]


def _luminaires(count: int) -> list[dict[str, Any]]:
    """Return `count` lights, evenly over the ceiling; their total area is that of the ten default lights."""
    x, _, z = ROOM
    columns = round(math.sqrt(count * x / z)) or 1
    long = math.sqrt(2 * _LIGHTS * 1.2 * 0.6 / count)
    rows = math.ceil(count / columns)
    lights = []
    for i in range(count):
        row, column = divmod(i, columns)
        in_row = min(columns, count - row * columns)
        middle = (x * (column + 0.5) / in_row, z * (row + 0.5) / rows)
        corner = (middle[0] - long / 2, middle[1] - long / 4)
        lights.append(_light(f"light-{row}-{column}", corner, (long, long / 2)))
    return lights


def _light(name: str, corner: tuple[float, float], size: tuple[float, float]) -> dict[str, Any]:
    """Return a rectangular light below the ceiling, given by its corner and size along x and z."""
    (x, z), (along, across) = corner, size
    return _sheet(
        name, "lamp", (x, ROOM[1] - 0.02, z), (along, 0, 0), (0, 0, across), emission={"radiance": [8.0, 7.6, 7.0]}
    )


def _furniture() -> list[dict[str, Any]]:
    shapes = []
    for i in range(8):
        x, z = 1.7 + 2.6 * (i % 4), 2.2 + 3.2 * (i // 4)
        shapes += _desk(f"desk-{i}", x, z)
        shapes += _chair(f"chair-{i}", x + 0.1 * (i % 3), z + 0.85, 150 + 37 * i)
        if i < 7:
            shapes += _screen(f"screen-{i}", x - 0.2, z - 0.1, 12 * i - 30)
    for i in range(4):
        shapes += _shelf(f"shelf-{i}", 1.2 + 1.6 * i, 0.22)
    for i in range(6):
        shapes.append(
            _box(f"partition-{i}", "cloth", (2.95 + 2.6 * (i % 3), 0.7, 2.4 + 3.2 * (i // 3)), (0.06, 1.4, 1.8))
        )
    return shapes


def _box(
    name: str, material: str, center: tuple[float, ...], size: tuple[float, ...], at: tuple[float, ...] = (0, 0, 0),
    angle: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """Return a box of a piece of furniture. The piece is rotated by `angle` degrees about y, then moved to `at`."""
    return {
        "type": "box", "name": name, "material": material, "center": list(center), "size": list(size),
        "transform": [{"rotate": {"axis": [0, 1, 0], "angle": angle}}, {"translate": list(at)}],
    }  # fmt: skip


def _legs(name: str, material: str, half: tuple[float, float], height: float, width: float) -> list[_Part]:
    return [
        (f"{name}-leg-{i}", material, (sx * half[0], height / 2, sz * half[1]), (width, height, width))
        for i, (sx, sz) in enumerate([(-1, -1), (1, -1), (-1, 1), (1, 1)])
    ]


def _desk(name: str, x: float, z: float) -> list[dict[str, Any]]:
    parts: list[_Part] = [
        (f"{name}-top", "wood", (0, 0.735, 0), (1.6, 0.03, 0.8)),
        (f"{name}-drawers", "steel", (0.52, 0.4, 0), (0.4, 0.6, 0.6)),
        *_legs(name, "steel", (0.76, 0.36), 0.72, 0.05),
    ]
    return [_box(*part, at=(x, 0, z)) for part in parts]


def _chair(name: str, x: float, z: float, angle: float) -> list[dict[str, Any]]:
    parts: list[_Part] = [
        (f"{name}-seat", "cloth", (0, 0.46, 0), (0.45, 0.05, 0.45)),
        (f"{name}-back", "cloth", (0, 0.76, -0.2), (0.43, 0.5, 0.04)),
        *_legs(name, "steel", (0.19, 0.19), 0.43, 0.03),
    ]
    return [_box(*part, at=(x, 0, z), angle=angle) for part in parts]


def _screen(name: str, x: float, z: float, angle: float) -> list[dict[str, Any]]:
    parts: list[_Part] = [
        (f"{name}-panel", "screen", (0, 0.33, 0), (0.52, 0.32, 0.03)),
        (f"{name}-foot", "screen", (0, 0.08, 0), (0.2, 0.14, 0.16)),
    ]
    return [_box(*part, at=(x, 0.755, z), angle=angle) for part in parts]


def _shelf(name: str, x: float, z: float) -> list[dict[str, Any]]:
    """Return two sides, a back and five boards, which touch but do not intersect."""
    parts: list[_Part] = [
        (f"{name}-left", "wood", (-0.685, 1.0, 0), (0.03, 2.0, 0.3)),
        (f"{name}-right", "wood", (0.685, 1.0, 0), (0.03, 2.0, 0.3)),
        (f"{name}-back", "wood", (0, 1.0, -0.16), (1.4, 2.0, 0.02)),
        *((f"{name}-board-{i}", "wood", (0, 0.1 + 0.42 * i, 0), (1.34, 0.025, 0.3)) for i in range(5)),
    ]
    return [_box(*part, at=(x, 0, z)) for part in parts]
