"""A handwritten honeybee model: two adjacent rooms, a window, a door, shades and a sensor grid."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

OUTDOORS = {"type": "Outdoors"}
GROUND = {"type": "Ground"}


def polygon(*boundary: tuple[float, float, float]) -> dict[str, Any]:
    return {"type": "Face3D", "boundary": [list(point) for point in boundary]}


def face(name: str, kind: str, boundary: Any, condition: Any = None, **more: Any) -> dict[str, Any]:
    return {
        "type": "Face",
        "identifier": name,
        "geometry": polygon(*boundary),
        "face_type": kind,
        "boundary_condition": condition or OUTDOORS,
        "properties": {"type": "FacePropertiesAbridged", "radiance": {"type": "FaceRadiancePropertiesAbridged"}},
        **more,
    }


def opening(kind: str, name: str, boundary: Any, condition: Any = None, **more: Any) -> dict[str, Any]:
    return {
        "type": kind,
        "identifier": name,
        "geometry": polygon(*boundary),
        "boundary_condition": condition or OUTDOORS,
        "properties": {
            "type": f"{kind}PropertiesAbridged",
            "radiance": {"type": f"{kind}RadiancePropertiesAbridged"},
        },
        **more,
    }


def shade(name: str, boundary: Any, **more: Any) -> dict[str, Any]:
    return {
        "type": "Shade",
        "identifier": name,
        "geometry": polygon(*boundary),
        "properties": {"type": "ShadePropertiesAbridged", "radiance": {"type": "ShadeRadiancePropertiesAbridged"}},
        **more,
    }


def surface(*names: str) -> dict[str, Any]:
    return {"type": "Surface", "boundary_condition_objects": list(names)}


def room(name: str, x0: float, x1: float, west: Any, east: Any, south: Any) -> dict[str, Any]:
    """Return a box from x0 to x1, 5 deep and 3 high, with outward faces; west, east, south: their fields."""
    a, b, c, d = (x0, 0.0), (x1, 0.0), (x1, 5.0), (x0, 5.0)

    def wall(p: tuple[float, float], q: tuple[float, float]) -> Any:
        return [(*p, 0.0), (*q, 0.0), (*q, 3.0), (*p, 3.0)]

    return {
        "type": "Room",
        "identifier": name,
        "faces": [
            face(f"{name}_floor", "Floor", [(*d, 0.0), (*c, 0.0), (*b, 0.0), (*a, 0.0)], GROUND),
            face(f"{name}_ceiling", "RoofCeiling", [(*a, 3.0), (*b, 3.0), (*c, 3.0), (*d, 3.0)]),
            face(f"{name}_south", "Wall", wall(a, b), **south),
            face(f"{name}_east", "Wall", wall(b, c), **east),
            face(f"{name}_north", "Wall", wall(c, d)),
            face(f"{name}_west", "Wall", wall(d, a), **west),
        ],
        "properties": {"type": "RoomPropertiesAbridged", "radiance": {"type": "RoomRadiancePropertiesAbridged"}},
    }


def two_rooms() -> dict[str, Any]:
    """Return rooms 4 and 3 wide: a 2 x 1.5 south window, a glass door between, a board outside, and a table."""
    window = opening(
        "Aperture",
        "window",
        [(1.0, 0.0, 1.0), (3.0, 0.0, 1.0), (3.0, 0.0, 2.5), (1.0, 0.0, 2.5)],
        is_operable=False,
        outdoor_shades=[shade("board", [(1.0, 0.0, 2.6), (1.0, -0.5, 2.6), (3.0, -0.5, 2.6), (3.0, 0.0, 2.6)])],
    )
    # The door from one side and from the other; both touch the floor.
    inner = [(4.0, 1.0, 0.0), (4.0, 2.0, 0.0), (4.0, 2.0, 2.0), (4.0, 1.0, 2.0)]
    one = opening("Door", "door_a", inner, surface("door_b", "b_west", "b"), is_glass=True)
    other = opening("Door", "door_b", inner[::-1], surface("door_a", "a_east", "a"), is_glass=True)
    first = room(
        "a",
        0.0,
        4.0,
        {},
        {"condition": surface("b_west", "b"), "doors": [one]},
        {"apertures": [window]},
    )
    table = shade("table", [(1.0, 1.0, 0.7), (2.0, 1.0, 0.7), (2.0, 2.0, 0.7), (1.0, 2.0, 0.7)])
    first["indoor_shades"] = [table]
    second = room("b", 4.0, 7.0, {"condition": surface("a_east", "a"), "doors": [other]}, {}, {})
    return {
        "type": "Model",
        "identifier": "two_rooms",
        "version": "1.60.0",
        "units": "Meters",
        "rooms": [first, second],
        "orphaned_shades": [
            shade(
                "tower", [(0.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, -9.0, 9.0), (0.0, -9.0, 9.0)], is_detached=True
            )
        ],
        "properties": {
            "type": "ModelProperties",
            "radiance": {
                "type": "ModelRadianceProperties",
                "modifiers": [],
                "modifier_sets": [],
                "sensor_grids": [
                    {
                        "type": "SensorGrid",
                        "identifier": "desk",
                        "display_name": "Desk heights",
                        "sensors": [
                            {"pos": [x, y, 0.8], "dir": [0, 0, 1]} for x in (1.5, 2.5) for y in (1.25, 3.25)
                        ],
                    },
                    {
                        "type": "SensorGrid",
                        "identifier": "eye",
                        "sensors": [{"pos": [5.5, 2.5, 1.2], "dir": [-1, 0, 0]}],
                    },
                ],
                "views": [
                    {
                        "type": "View",
                        "identifier": "corner",
                        "position": [3.5, 4.5, 1.6],
                        "direction": [-1.5, -4.5, -0.3],
                        "up_vector": [0, 0, 1],
                        "view_type": "v",
                        "h_size": 90,
                        "v_size": 60,
                        **dict.fromkeys(("shift", "lift", "fore_clip", "aft_clip")),  # as honeybee writes them
                    }
                ],
            },
        },
    }


def write(model: dict[str, Any], path: Path) -> Path:
    path.write_text(json.dumps(model), "utf-8")
    return path
