"""Cases 5.9 to 5.14: the light of the sky, the ground and a mask, through an opening into a black room.

All values are per cent of the illuminance of open ground. The ground has reflectance 0.3, is equally bright
everywhere, and has no end. A mask is equally bright everywhere, too. The report leaves its luminance open, so it is
chosen here:

- 5.13, an overhang at the height of the ceiling: 0.05 of that of open ground, which the printed tables imply;
- 5.14, a wall 6 m before the room: 0.3 of what an unobstructed upright wall receives under a uniform sky.

A mask is measured twice: as an obstacle that hides the sky, and as a light. These give the sky component and the
externally reflected component, which the printed tables add. Both masks extend as far as the points see them.

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

#: Reflectance of the ground.
GROUND = 0.3
#: Exitance of an overhang and of a wall before the room, as fractions of open ground's illuminance.
OVERHANG, WALL = 0.05, 0.3 * 0.5 * (1 + GROUND)
#: Depths of the overhangs, heights of the walls and their distance, in metres.
OVERHANGS, WALLS, DISTANCE = (0.5, 1.0, 2.0), (3.0, 6.0, 9.0), 6.0
ROOF_LIGHTS = (1.0, 4.0)
#: Width, sill and height of the windows.
WINDOWS = ((2.0, 1.0, 1.0), (4.0, 0.0, 3.0))

#: Directions to the sun: behind, so that the sun lights the wall with the points, and before the window.
_BEHIND = np.array([0.0, skies.SUN[1], skies.SUN[0]])
_BEFORE = np.array([0.0, -skies.SUN[1], skies.SUN[0]])
#: Number of rows of a map of the sky, for skies that a scene file cannot describe.
_ROWS = 256


def roof_light(side: float, sky: int, glazed: bool = False) -> Case:
    """Return case 5.9: points on the wall that faces the sun and on the floor, under an opening amid the ceiling.

    glazed : put clear glass into the opening, which makes it case 5.10
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
    """Return case 5.11: points on the wall opposite the window, on the floor and on the ceiling.

    Only the ground lights the points on the ceiling.

    glazed : put clear glass into the window, which makes it case 5.12
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
    """Return case 5.13: points on the floor behind the smaller window, which has an overhang at ceiling height.

    sky : 0: no sky, only the light of the overhang
    """
    # The mask extends to both sides as far as a point sees it through the window, and a little more.
    reach = 1.0 + 1.5 * (_NEAREST + depth) / _NEAREST
    mask = Rectangle.of([2 - reach, -depth, 3.0], [[0, depth, 0], [2 * reach, 0, 0]])

    def hidden(at: Float64) -> tuple[float, float]:
        # The overhang's outer edge, at the height of the ceiling, 3 m, hides what is above this height in the
        # window.
        return float(3.0 * at[1] / (at[1] + depth)), np.inf

    return _masked(("5.13", f"overhang {depth:g} m"), sky, mask, OVERHANG * 100 / np.pi, hidden)


def wall(height: float, sky: int) -> Case:
    """Return case 5.14: the points of case 5.13, with a wall 6 m from the room.

    sky : 0: no sky, only the light of the wall
    """
    reach = 1.0 + 1.5 * (_NEAREST + DISTANCE) / _NEAREST
    mask = Rectangle.of([2 - reach, -DISTANCE, 0.0], [[0, 0, height], [2 * reach, 0, 0]])

    def hidden(at: Float64) -> tuple[float, float]:
        return -np.inf, float(height * at[1] / (at[1] + DISTANCE))

    return _masked(("5.14", f"wall {height:g} m"), sky, mask, WALL * 100 / np.pi, hidden)


def cases(which: Sequence[int] = skies.SKIES) -> Iterator[Case]:
    """Yield all cases under the given skies."""
    for make, variants, own_light in _FAMILIES:
        for variant in variants:
            for sky in (*which, 0) if own_light else which:
                yield make(variant, sky)


# Parts of the cases.

#: Distances of points from the window, from the largest to the smallest, in the order of the report.
_INWARDS = np.arange(3.75, 0.0, -0.5)
_NEAREST = 0.25


def opening_of(size: tuple[float, float, float]) -> Rectangle:
    """Return a window in the wall at y = 0: its normal points inwards, and its second edge points up."""
    width, sill, height = size
    return Rectangle.of([2 + width / 2, 0, sill], [[-width, 0, 0], [0, 0, height]])


def room_with(opening: Rectangle) -> list[Shape]:
    """Return the walls of the room with a window."""
    width, height, depth = ROOM[0], ROOM[2], 0.0
    left, sill = opening.corner[0] + opening.edges[0, 0], opening.corner[2]
    hole = (sill / height, (sill + opening.edges[1, 2]) / height, left / width, opening.corner[0] / width)
    south = Rectangle.of([0, depth, 0], [[0, 0, height], [width, 0, 0]])
    return [*walls(without=["south"]), *around(south, hole)]


def with_glass(described: dict[str, Any], opening: Rectangle | None) -> dict[str, Any]:
    """Return the description with clear glass in an opening."""
    if opening is None:
        return described
    materials = described["materials"] | {"glass": glass.MATERIAL}
    return described | {"materials": materials, "shapes": [*described["shapes"], quad(opening, "glass")]}


def behind_glass(radiance: Radiance, axis: int) -> Radiance:
    """Return the radiance that is seen through glass perpendicular to an axis."""
    return lambda directions: radiance(directions) * glass.transmittance(np.abs(directions[:, axis]))


def seen(at: Float64, opening: Rectangle, *heights: float) -> list[Rectangle]:
    """Divide a window into parts through which a point sees only sky or only ground, and at the given heights."""
    low, high = opening.corner[2], opening.edges[1, 2]
    return opening.divided([(z - low) / high for z in (at[2], *heights) if np.isfinite(z)])


def strip(at: Float64, normal: Float64, part: Rectangle, radiance: Radiance) -> float:
    """Return the irradiance through a part of a window that shows only sky or only ground."""
    if part.corner[2] + 0.5 * part.edges[1, 2] > at[2]:
        return through(at, normal, part, radiance)
    return GROUND * 100 / np.pi * float(lambert(at[None], normal[None], part.corners)[0])


def under(
    described: dict[str, Any], sky: int, sun: Float64, portals: Sequence[Rectangle], ground: float = 0.0
) -> Any:
    """Put a scene under a sky with portals, so that open ground receives 100 lx, and add a ground."""
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
    """Return a sky as a map, cut at the horizon, with the radiance of one azimuth in all columns."""
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
    """Return case 5.13 or 5.14: for a point on the floor, the mask hides the window between two heights."""
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


#: The function of each case, its variants, and whether the case has a mask with its own light.
_FAMILIES: tuple[tuple[Callable[[Any, int], Case], tuple[Any, ...], bool], ...] = (
    (roof_light, ROOF_LIGHTS, False),
    (partial(roof_light, glazed=True), ROOF_LIGHTS, False),
    (window, WINDOWS, False),
    (partial(window, glazed=True), WINDOWS, False),
    (overhang, OVERHANGS, True),
    (wall, WALLS, True),
)
