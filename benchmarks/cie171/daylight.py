"""Cases 5.9 to 5.14: the light of the sky, the ground and a mask, through an opening into a black room.

All values are per cent of the illuminance of open ground. The ground reflects 0.3 of that. It is bright all over,
and has no end. A mask is as bright all over, too. The report leaves its luminance open, so it is chosen here:

- 5.13, an overhang at the height of the ceiling: 0.05 of what open ground has, which the printed tables imply;
- 5.14, a wall 6 m before the room: 0.3 of what an upright wall in the open has under a uniform sky.

A mask is measured twice, as what hides the sky and as what is bright: the sky component and the one reflected from
outside, which the printed tables add. Both masks are as long as what the points see of them.

Source: ISO 15469:2004 for the skies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import glpath
from benchmarks.cie171 import glass, skies
from benchmarks.cie171.case import Case
from benchmarks.cie171.exact import Float64, Radiance, Rectangle, lambert, through
from benchmarks.cie171.rooms import (
    DOWN,
    NORTH,
    ROOM,
    SOUTH,
    UP,
    Shape,
    around,
    facing,
    letters,
    level,
    quad,
    scene,
    upright,
    walls,
)
from glpath.scene import Environment

#: Of the ground, of open ground's illuminance.
GROUND = 0.3
#: What an overhang and a wall before the room send, of open ground's illuminance.
OVERHANG, WALL = 0.05, 0.3 * 0.5 * (1 + GROUND)
#: Depths of the overhangs, heights of the walls and their distance, in metres.
OVERHANGS, WALLS, DISTANCE = (0.5, 1.0, 2.0), (3.0, 6.0, 9.0), 6.0
ROOF_LIGHTS = (1.0, 4.0)
#: Width, sill and height of the windows.
WINDOWS = ((2.0, 1.0, 1.0), (4.0, 0.0, 3.0))

#: Towards the sun: over the room, so that the wall with the points is lit, and before the window.
_BEHIND = np.array([0.0, skies.SUN[1], skies.SUN[0]])
_BEFORE = np.array([0.0, -skies.SUN[1], skies.SUN[0]])
#: Of a map of the sky, where there is no description of one.
_ROWS = 256


def roof_light(side: float, sky: int, glazed: bool = False) -> Case:
    """5.9: points of the wall that faces the sun and of the floor, under an opening amid the ceiling.

    glazed : 5.10, with clear glass in it
    """
    low, high = 2 - side / 2, 2 + side / 2
    opening = Rectangle.of([low, low, 3], [[side, 0, 0], [0, side, 0]])
    hole = (low / 4, high / 4, low / 4, high / 4)
    shapes = [*walls(without=["ceiling"]), *around(Rectangle.of([0, 0, 3], [[0, 4, 0], [4, 0, 0]]), hole)]
    portal = Rectangle.of(opening.corner, opening.edges[::-1])
    points, normals = facing((upright(), NORTH), (level(), UP))
    radiance = skies.radiance(sky, _BEHIND)
    if glazed:
        radiance = behind_glass(radiance, 2)
    exact = [through(at, normal, opening, radiance) for at, normal in zip(points, normals, strict=True)]
    there = under(with_glass(scene(shapes), opening if glazed else None), sky, _BEHIND, [portal])
    number = "5.10" if glazed else "5.9"
    names = letters("A", 14)
    return Case(number, f"{side:g} x {side:g} m", there, points, normals, names, np.array(exact), "%", sky=sky)


def window(size: tuple[float, float, float], sky: int, glazed: bool = False) -> Case:
    """5.11: points of the wall opposite, the floor and the ceiling; these are lit by the ground alone.

    glazed : 5.12, with clear glass in it
    """
    opening = opening_of(size)
    points, normals = facing((upright(4.0), SOUTH), (level(depths=_INWARDS), UP), (level(3.0, _INWARDS), DOWN))
    of_sky = skies.radiance(sky, _BEFORE)

    def radiance(directions: Float64) -> Float64:
        return np.where(directions[:, 2] > 0, of_sky(directions), GROUND * 100 / np.pi)

    outside = behind_glass(radiance, 1) if glazed else radiance
    pairs = zip(points, normals, strict=True)
    exact = [sum(through(at, normal, part, outside) for part in seen(at, opening)) for at, normal in pairs]
    described = with_glass(scene(room_with(opening)), opening if glazed else None)
    there = under(described, sky, _BEFORE, [opening], GROUND)
    number = "5.12" if glazed else "5.11"
    names = (*letters("A", 14), *letters("G", 8, "'"))
    return Case(
        number, f"{size[0]:g} x {size[2]:g} m", there, points, normals, names, np.array(exact), "%", sky=sky
    )


def overhang(depth: float, sky: int) -> Case:
    """5.13: points of the floor, behind the smaller window, above which an overhang goes out from the ceiling.

    sky : 0 for the light of the overhang alone
    """
    # As far to both sides as a point sees it through the window, and some more.
    reach = 1.0 + 1.5 * (_NEAREST + depth) / _NEAREST
    mask = Rectangle.of([2 - reach, -depth, 3.0], [[0, depth, 0], [2 * reach, 0, 0]])

    def hidden(at: Float64) -> tuple[float, float]:
        # A ray is at the height of the ceiling, 3 m, so far out where it is so high in the window.
        return float(3.0 * at[1] / (at[1] + depth)), np.inf

    return _masked(("5.13", f"overhang {depth:g} m"), sky, mask, OVERHANG * 100 / np.pi, hidden)


def wall(height: float, sky: int) -> Case:
    """5.14: the same points, before which is a wall 6 m from the room.

    sky : 0 for the light of the wall alone
    """
    reach = 1.0 + 1.5 * (_NEAREST + DISTANCE) / _NEAREST
    mask = Rectangle.of([2 - reach, -DISTANCE, 0.0], [[0, 0, height], [2 * reach, 0, 0]])

    def hidden(at: Float64) -> tuple[float, float]:
        return -np.inf, float(height * at[1] / (at[1] + DISTANCE))

    return _masked(("5.14", f"wall {height:g} m"), sky, mask, WALL * 100 / np.pi, hidden)


def cases(which: Sequence[int] = skies.SKIES) -> Iterator[Case]:
    """All of them, under these skies."""
    for make, variants, own_light in _FAMILIES:
        for variant in variants:
            for sky in (*which, 0) if own_light else which:
                yield make(variant, sky)


# The parts.

#: From the wall opposite the window to it, as the report counts.
_INWARDS = np.arange(3.75, 0.0, -0.5)
_NEAREST = 0.25


def opening_of(size: tuple[float, float, float]) -> Rectangle:
    """A window in the wall at y = 0: its normal is inwards, and its second edge goes up."""
    width, sill, height = size
    return Rectangle.of([2 + width / 2, 0, sill], [[-width, 0, 0], [0, 0, height]])


def room_with(opening: Rectangle) -> list[Shape]:
    """The room with a window."""
    width, height, depth = ROOM[0], ROOM[2], 0.0
    left, sill = opening.corner[0] + opening.edges[0, 0], opening.corner[2]
    hole = (sill / height, (sill + opening.edges[1, 2]) / height, left / width, opening.corner[0] / width)
    south = Rectangle.of([0, depth, 0], [[0, 0, height], [width, 0, 0]])
    return [*walls(without=["south"]), *around(south, hole)]


def with_glass(described: dict[str, Any], opening: Rectangle | None) -> dict[str, Any]:
    """The same with clear glass in an opening."""
    if opening is None:
        return described
    materials = described["materials"] | {"glass": glass.MATERIAL}
    return described | {"materials": materials, "shapes": [*described["shapes"], quad(opening, "glass")]}


def behind_glass(radiance: Radiance, axis: int) -> Radiance:
    """What is seen through glass across an axis."""
    return lambda directions: radiance(directions) * glass.transmittance(np.abs(directions[:, axis]))


def seen(at: Float64, opening: Rectangle, *heights: float) -> list[Rectangle]:
    """The parts of a window where a point sees sky or ground alone, divided at heights besides."""
    low, high = opening.corner[2], opening.edges[1, 2]
    return opening.divided([(z - low) / high for z in (at[2], *heights) if np.isfinite(z)])


def strip(at: Float64, normal: Float64, part: Rectangle, radiance: Radiance) -> float:
    """The light through a part of a window, which is of the sky or of the ground."""
    if part.corner[2] + 0.5 * part.edges[1, 2] > at[2]:
        return through(at, normal, part, radiance)
    return GROUND * 100 / np.pi * float(lambert(at[None], normal[None], part.corners)[0])


def under(
    described: dict[str, Any], sky: int, sun: Float64, portals: Sequence[Rectangle], ground: float = 0.0
) -> Any:
    """A scene under a sky, which is seen through portals, with 100 lx on open ground and a ground of its own."""
    fields: dict[str, Any] = {"type": "cie", "cie_type": sky, "sun": sun.tolist(), "illuminance": 100.0}
    if sky == 16:
        zenith = 100 * 9 / (7 * np.pi)
        fields = {"zenith": zenith, "horizon": zenith / 3}
    fields |= {"up": UP, "portals": [{"corners": portal.corners.tolist()} for portal in portals]}
    described = described | {"sky": fields}
    if not ground:
        return described
    loaded = glpath.load_scene(described)
    made = loaded.sky if isinstance(loaded.sky, Environment) else _as_map(loaded.sky)
    image = made.image.copy()
    image[len(image) // 2 :] = ground * 100 / np.pi / made.scale
    return replace(loaded, sky=replace(made, image=image))


def _as_map(sky: Any) -> Environment:
    """A sky of two colours as a map, cut at the horizon."""
    theta = (np.arange(_ROWS) + 0.5) * (np.pi / _ROWS)
    radiance = sky.radiance(np.column_stack([np.sin(theta), np.zeros(_ROWS), np.cos(theta)]))
    return Environment(np.repeat(radiance[:, None], 4, axis=1).astype(np.float32), np.array(UP), cut=True)


def _masked(
    name: tuple[str, str],
    sky: int,
    mask: Rectangle,
    luminance: float,
    hidden: Callable[[Float64], tuple[float, float]],
) -> Case:
    """5.13 and 5.14: of a point on the floor, the mask hides the window from a height to another one."""
    opening = opening_of(WINDOWS[0])
    points, normals = facing((level(depths=_INWARDS), UP))
    radiance = skies.radiance(sky, _BEFORE) if sky else None
    exact = []
    for at, normal in zip(points, normals, strict=True):
        low, high = hidden(at)
        total = 0.0
        for part in seen(at, opening, low, high):
            behind = low <= part.corner[2] + 0.5 * part.edges[1, 2] <= high
            if behind and radiance is None:
                total += luminance * float(lambert(at[None], normal[None], part.corners)[0])
            elif radiance is not None and not behind:
                total += strip(at, normal, part, radiance)
        exact.append(total)
    shapes = [*room_with(opening), quad(mask) if sky else quad(mask, emission={"radiance": luminance})]
    there = under(scene(shapes), sky, _BEFORE, [opening]) if sky else scene(shapes)
    case = Case(*name, there, points, normals, letters("A", 8), np.array(exact), "%", sky=sky)
    # A mask is far longer than the part that a point sees, so most of its light samples are wasted.
    return case if sky else replace(case, copies=1024)


#: What makes a case, its variants, and whether a mask in it has light of its own.
_FAMILIES: tuple[tuple[Callable[[Any, int], Case], tuple[Any, ...], bool], ...] = (
    (roof_light, ROOF_LIGHTS, False),
    (partial(roof_light, glazed=True), ROOF_LIGHTS, False),
    (window, WINDOWS, False),
    (partial(window, glazed=True), WINDOWS, False),
    (overhang, OVERHANGS, True),
    (wall, WALLS, True),
)
