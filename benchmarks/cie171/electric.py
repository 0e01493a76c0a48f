"""Cases 5.2 to 5.8: light of lamps, conservation of flux, and reflection by diffuse surfaces.

5.2 has two lamps: one of 1000 cd cos(gamma), and an isotropic one of 10,000 lm. 5.3 has a diffuse panel. 5.4 has
both lamps of 5.2, and daylight that comes through openings.

Source: see the package; Table 19 of the report, for 5.7, was printed with errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.polynomial.legendre import leggauss

from benchmarks.cie171 import daylight, glass, skies
from benchmarks.cie171.case import Case
from benchmarks.cie171.exact import Float64, Rectangle, lambert
from benchmarks.cie171.rooms import (
    DEPTHS,
    DOWN,
    HEIGHTS,
    NORTH,
    ROOM,
    UP,
    Shape,
    facing,
    letters,
    level,
    quad,
    scene,
    surface_grid,
    upright,
    walls,
)

_GAMMA = np.arange(0.0, 180.5, 0.5)
#: Positions of the points A to J below the lamp of 5.2, in steps of half a metre.
_STEPS = np.array([(0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (3, 3)])
#: Reflectances: of the ground in 5.6, of the lit wall in 5.7, and of the cubes in 5.8.
_GROUND, _WALL = 0.3, 0.6
REFLECTANCES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
#: The sun of 5.6 and 5.7, at 60 degrees: 10,000 lx on a plane perpendicular to its rays.
_SUN = {"type": "directional", "direction": [0, skies.SUN[1], -skies.SUN[0]], "irradiance": 10000}
#: Number of points along each side of a surface in cases that sum the light of the whole surface.
_GRID = 24


def cases(folder: Path) -> Iterator[Case]:
    """Yield all cases; photometric files are written into a folder."""
    for diffuse in (True, False):
        yield point_source(folder, diffuse)
    yield area_source()
    for diffuse in (True, False):
        yield flux_of_a_lamp(folder, diffuse)
    for side in (1.0, 2.0):
        yield flux_through_the_roof(side)
    yield glass.directional()
    for side in (0.5, 4.0, 500.0):
        yield reflected(side)
    yield obstructed()
    for reflectance in REFLECTANCES:
        yield cavity(reflectance)


def point_source(folder: Path, diffuse: bool) -> Case:
    """Return case 5.2: a lamp 3 m above a surface of 4 x 4 m."""
    points = np.column_stack([2 + _STEPS / 2, np.zeros(len(_STEPS))])
    square = 9 + np.sum((_STEPS / 2) ** 2, axis=1)
    exact = 1000 * 9 / square**2 if diffuse else 1e4 / 4 / np.pi * 3 / square**1.5
    floor = quad(Rectangle.of([0, 0, 0], [[4, 0, 0], [0, 4, 0]]))
    there = scene([floor], [_lamp(folder, diffuse, [2, 2, 3])])
    return Case("5.2", _lamp_name(diffuse), there, *facing((points, UP)), letters("A", 10), exact, copies=4)


def area_source() -> Case:
    """Return case 5.3: a diffuse panel of 1 x 1 m and 1000 cd, in the middle of the ceiling of a black room."""
    at = Rectangle.of([1.5, 1.5, 3 - 1e-4], [[0, 1, 0], [1, 0, 0]])
    points, normals = facing((upright(), NORTH), (level(), UP))
    exact = 1000 * lambert(points, normals, at.corners)
    there = scene([*walls(), quad(at, emission={"radiance": 1000})])
    return Case("5.3", "diffuse panel", there, points, normals, letters("A", 14), exact)


def flux_of_a_lamp(folder: Path, diffuse: bool) -> Case:
    """Return case 5.4 with a lamp in the middle of a black room: all its flux must arrive on the surfaces."""
    there = scene(walls(), [_lamp(folder, diffuse, [2, 2, 1.5])])
    lumen = 1000 * np.pi if diffuse else 1e4
    return _flux(Case("5.4", _lamp_name(diffuse), there, *_EMPTY, ("flux",), np.array([lumen]), "lm", copies=1))


def flux_through_the_roof(side: float, sky: int = 5) -> Case:
    """Return case 5.4 with an opening in the roof: the flux through it must arrive on the room's surfaces."""
    there = daylight.roof_light(side, sky).scene
    exact = np.array([100 * side * side])
    name = f"roof opening {side:g} x {side:g} m"
    return _flux(Case("5.4", name, there, *_EMPTY, ("flux",), exact, "lm", sky=sky, copies=1))


def reflected(side: float) -> Case:
    """Return case 5.6: a sunlit square lights a wall 2 m from its middle and the ceiling 3 m above it."""
    floor = Rectangle.of([2 - side / 2, 2 - side / 2, 0], [[side, 0, 0], [0, side, 0]])
    # The wall receives no light from what is behind it.
    front = max(2 - side / 2, 0.0)
    before = Rectangle.of([2 - side / 2, front, 0], [[side, 0, 0], [0, 2 + side / 2 - front, 0]])
    wall, ceiling = upright(heights=HEIGHTS[:5]), level(3.0)
    at_wall = lambert(wall, np.broadcast_to(NORTH, wall.shape), before.corners)
    at_ceiling = lambert(ceiling, np.broadcast_to(DOWN, ceiling.shape), floor.corners)
    exact = 100 / np.pi * np.concatenate([at_wall, at_ceiling])
    there = scene([quad(floor, "lit")], [_scaled_sun(_GROUND * skies.SUN[0])])
    there["materials"]["lit"] = {"reflectance": _GROUND}
    points, normals = facing((wall, NORTH), (ceiling, DOWN))
    names = (*reversed(letters("B", 5)), *letters("G", 8))
    deep = {"max_depth": 2}
    return Case(
        "5.6", f"{side:g} x {side:g} m", there, points, normals, names, exact, "%", options=deep, copies=256
    )


def obstructed() -> Case:
    """Return case 5.7: a sunlit wall of 4 x 3 m lights the wall opposite, and the floor before that, over a box.

    The box is 1 m high, 0.2 m thick and as wide as both walls.
    """
    lit = quad(Rectangle.of([0, 4, 0], [[4, 0, 0], [0, 0, 3]]), "lit")
    box: Shape = {"type": "box", "min": [0, 2.5, 0], "max": [4, 2.7, 1], "material": "black"}
    # Both keep the sun off the points, but do not obstruct the light of the lit wall.
    roof = quad(Rectangle.of([-4, -0.5, 3], [[0, 2, 0], [12, 0, 0]]))
    back = quad(Rectangle.of([-4, 0, 0], [[0, 0, 3], [12, 0, 0]]))
    points, normals = facing((upright(), NORTH), (level(depths=DEPTHS[:5]), UP))
    exact = []
    for point, normal in zip(points, normals, strict=True):
        # The box is as wide as both walls, so a point sees the lit wall above a certain height.
        shares = [(edge - point[1]) / (4 - point[1]) for edge in (2.5, 2.7)]
        lowest = max(0.0, *(point[2] + (1 - point[2]) / share for share in shares))
        above = Rectangle.of([0, 4, lowest], [[4, 0, 0], [0, 0, 3 - lowest]])
        exact.append(float(lambert(point[None], normal[None], above.corners)[0]) if lowest < 3 - 1e-12 else 0.0)
    there = scene([lit, box, roof, back], [_scaled_sun(_WALL * skies.SUN[1])])
    there["materials"]["lit"] = {"reflectance": _WALL}
    deep = {"max_depth": 2}
    part = 100 / np.pi * np.array(exact)
    return Case("5.7", "box", there, points, normals, letters("A", 11), part, "%", options=deep, copies=256)


def cavity(reflectance: float, points: int = 16) -> Case:
    """Return case 5.8: the mean illuminance in a cube of 4 m with a lamp of 10,000 lm in its middle."""
    lamp = {"type": "point", "position": [2, 2, 2], "intensity": 1e4 / 4 / np.pi}
    there = scene(walls([4, 4, 4], material="wall"), [lamp])
    there["materials"] = {"wall": {"reflectance": reflectance}}
    # By symmetry, points on one side suffice.
    u, w = leggauss(points)
    x, y = (each.ravel() for each in np.meshgrid(2 * (u + 1), 2 * (u + 1)))
    places = np.column_stack([x, y, np.zeros(len(x))])
    weights = np.outer(w, w).reshape(1, -1) / 4
    exact = np.array([1e4 / 96 / (1 - reflectance)])
    # After 64 vertices, 4 % of the light is left at reflectance 0.95, and 6e-7 at 0.8.
    deep = {"max_depth": 1000 if reflectance > 0.8 else 64}
    case = Case("5.8", f"reflectance {reflectance:g}", there, *facing((places, UP)), ("mean",), exact, options=deep)
    return replace(case, sum=weights, copies=4)


_EMPTY = (np.zeros((0, 3)), np.zeros((0, 3)))


def _flux(case: Case) -> Case:
    """Return the case with points all over the room; its value is their illuminances' sum, weighted by areas."""
    points, normals, areas = surface_grid(ROOM, _GRID)
    return replace(case, points=points, normals=normals, sum=areas[None])


def _lamp_name(diffuse: bool) -> str:
    return "1000 cd cos(gamma)" if diffuse else "10,000 lm all around"


def _scaled_sun(share: float) -> Shape:
    """Return a sun so strong that a surface that reflects this fraction of its irradiance sends 100."""
    return _SUN | {"irradiance": 100 / share}


def _lamp(folder: Path, diffuse: bool, position: list[float]) -> Shape:
    """Return a lamp with a photometric file."""
    candela = 1000 * np.maximum(np.cos(np.radians(_GAMMA)), 0) if diffuse else np.full(len(_GAMMA), 1e4 / 4 / np.pi)
    file = folder / ("diffuse.ies" if diffuse else "all-around.ies")
    file.write_text(
        "IESNA:LM-63-2002\n[TEST] CIE 171:2006, 5.2\n[MANUFAC] none\nTILT=NONE\n"
        f"1 -1 1 {len(_GAMMA)} 1 1 2 0 0 0\n1 1 10\n{_written(_GAMMA)}\n0\n{_written(candela)}\n"
    )
    return {"type": "point", "position": position, "profile": str(file), "direction": [0, 0, -1]}


def _written(numbers: Float64) -> str:
    return " ".join(f"{x:.9g}" for x in numbers)
