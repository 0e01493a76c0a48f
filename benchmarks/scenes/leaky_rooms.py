"""Rooms whose light passes narrow gaps, at which coarse elements of a radiosity solution leak light or shadow.

`ROOMS` has a builder for each named room. `room(name)` returns its scene dictionary, as `glpath.render` takes it.
`held_out(seed)` returns a random room of one of the kinds, to which nothing was tuned.

A room is closed, about 4 x 3 x 6 m, diffuse and light. x is to the right, y up, and the camera looks along -z.
Shapes touch walls with open edges: a face that would coincide with another one is omitted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

Shape = dict[str, Any]
SceneDict = dict[str, Any]
Point = tuple[float, float, float]
#: Lower and upper corner in the two axes of a wall, which are in the order x, y, z.
Hole = tuple[tuple[float, float], tuple[float, float]]

MATERIALS = {
    "wall": {"reflectance": [0.7, 0.65, 0.6]},
    "wood": {"reflectance": [0.5, 0.4, 0.3]},
    "cloth": {"reflectance": [0.55, 0.5, 0.6]},
    "white": {"reflectance": 0.8},
}
_SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")
#: Corners of the faces of a box, counter-clockwise from outside: bit 0 is x, bit 1 is y, bit 2 is z.
_FACES = {
    "-x": (0, 4, 6, 2),
    "+x": (1, 3, 7, 5),
    "-y": (0, 1, 5, 4),
    "+y": (2, 6, 7, 3),
    "-z": (0, 2, 3, 1),
    "+z": (4, 5, 7, 6),
}


@dataclass(frozen=True)
class Interior:
    """Size and furniture of a room.

    half_width, height, half_depth : x and z are within half_width and half_depth of 0, y is from 0 to height;
                                     metres
    furniture                      : further shapes that stand in the room
    """

    half_width: float = 2.0
    height: float = 3.0
    half_depth: float = 3.0
    furniture: tuple[Shape, ...] = field(default=())

    @property
    def lower(self) -> Point:
        return (-self.half_width, 0.0, -self.half_depth)

    @property
    def upper(self) -> Point:
        return (self.half_width, self.height, self.half_depth)


STANDARD = Interior()


# Shapes


def box(
    lower: Point,
    upper: Point,
    material: str = "wood",
    without: Collection[str] = (),
    radiance: float | None = None,
    turn: tuple[Point, float] | None = None,
) -> Shape:
    """Return a box with its fronts outward.

    without  : faces to omit, such as "-y" if the box stands on a floor
    radiance : radiance that all faces emit
    turn     : a point and an angle in degrees, to turn the box around the vertical axis through the point
    """
    corners = np.array([[(lower, upper)[i >> axis & 1][axis] for axis in range(3)] for i in range(8)])
    if turn is not None:
        pivot, angle = np.array(turn[0]), np.radians(turn[1])
        cos, sin = np.cos(angle), np.sin(angle)
        corners = (corners - pivot) @ np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]]) + pivot
    faces = [list(_FACES[side]) for side in _SIDES if side not in without]
    used = sorted({corner for face in faces for corner in face})
    faces = [[used.index(corner) for corner in face] for face in faces]
    return _emitting(mesh(corners[used], faces, material), radiance)


def mesh(vertices: Any, faces: Sequence[Sequence[int]], material: str) -> Shape:
    """Return a mesh of vertices (V, 3) and faces of three or four of them."""
    points = [[float(value) for value in vertex] for vertex in vertices]
    return {"type": "mesh", "vertices": points, "faces": [list(face) for face in faces], "material": material}


def quad(*corners: Point, material: str = "wall", radiance: float | None = None) -> Shape:
    """Return a quadrilateral, its corners counter-clockwise from the front."""
    points = [list(corner) for corner in corners]
    return _emitting({"type": "quad", "corners": points, "material": material}, radiance)


def rectangle(side: str, at: float, hole: Hole, material: str = "wall", radiance: float | None = None) -> Shape:
    """Return the rectangle that faces `side`, in the plane of that axis at `at`."""
    axis = "xyz".index(side[1])
    others = [i for i in range(3) if i != axis]
    lower, upper = [at] * 3, [at] * 3
    for other, (low, high) in zip(others, hole, strict=True):
        lower[other], upper[other] = low, high
    corners = [tuple((lower, upper)[i >> a & 1][a] for a in range(3)) for i in _FACES[side]]
    return quad(*corners, material=material, radiance=radiance)  # type: ignore[arg-type]


def pierced(side: str, at: float, area: Hole, holes: Sequence[Hole], material: str = "wall") -> list[Shape]:
    """Return the rectangle `area` without `holes`, in cells of one grid, so that its edges meet at corners."""
    cuts = [sorted({*area[axis], *(value for hole in holes for value in hole[axis])}) for axis in range(2)]
    return [
        rectangle(side, at, (a, b), material)
        for a in pairwise(cuts[0])
        for b in pairwise(cuts[1])
        if not any(_within(a, hole[0]) and _within(b, hole[1]) for hole in holes)
    ]


def tunnel(axis: int, extent: tuple[float, float], hole: Hole, material: str = "wall") -> list[Shape]:
    """Return the four sides of a hole through a wall, facing inward, along `axis` over `extent`."""
    others = [i for i in range(3) if i != axis]
    shapes = []
    for which, other in enumerate(others):
        across = {axis: extent, others[1 - which]: hole[1 - which]}
        area = tuple(across[i] for i in sorted(across))
        for sign, at in zip("+-", hole[which], strict=True):
            shapes.append(rectangle(f"{sign}{'xyz'[other]}", at, area, material))  # type: ignore[arg-type]
    return shapes


def _within(inner: tuple[float, float], outer: tuple[float, float]) -> bool:
    return outer[0] <= inner[0] and inner[1] <= outer[1]


def _emitting(shape: Shape, radiance: float | None) -> Shape:
    return shape if radiance is None else shape | {"emission": {"radiance": radiance}}


# Rooms


def shell(interior: Interior, holes: dict[str, list[Hole]] | None = None) -> list[Shape]:
    """Return the six walls of a room, facing inward.

    holes : holes in the walls "-x" (the left one), "+x", "-y" (the floor), "+y", "-z" (the back wall) and "+z"
    """
    shapes = []
    for side in _SIDES:
        axis = "xyz".index(side[1])
        at = (interior.upper if side[0] == "+" else interior.lower)[axis]
        area = tuple((interior.lower[i], interior.upper[i]) for i in range(3) if i != axis)
        facing = ("-" if side[0] == "+" else "+") + side[1]
        shapes += pierced(facing, at, area, (holes or {}).get(side, []))  # type: ignore[arg-type]
    return shapes


def scene(
    name: str,
    interior: Interior,
    shapes: list[Shape],
    *,
    holes: dict[str, list[Hole]] | None = None,
    position: Point | None = None,
    target: Point = (0.0, 1.2, 0.0),
    **fields: Any,
) -> SceneDict:
    """Return the scene of a room with shapes in it, and its furniture.

    position : position of the camera; by default at the front wall
    """
    position = (0.0, 1.5, interior.half_depth - 0.1) if position is None else position
    return {
        "name": name,
        "camera": {"position": list(position), "target": list(target), "fov": 60},
        "materials": MATERIALS,
        "shapes": [*shell(interior, holes), *shapes, *interior.furniture],
        **fields,
    }


def lamp_below_ceiling(interior: Interior = STANDARD, gap: float = 0.01, size: float = 0.3) -> SceneDict:
    """Return a room with a flat lamp, `2 * size` wide, that hangs `gap` below the ceiling.

    A gap of 0 is a lamp that is mounted on the ceiling, without its upper face.
    """
    y = interior.height - gap
    without = () if gap else ("+y",)
    lamp = box((-size, y - 0.06, -size), (size, y, size), "default", without, radiance=12.0)
    return scene("lamp", interior, [lamp])


def recessed_cans(
    interior: Interior = STANDARD, columns: int = 2, rows: int = 3, side: float = 0.12, depth: float = 0.12
) -> SceneDict:
    """Return a room with a grid of square cans in its ceiling, each with an emitter at its top."""
    xs = np.linspace(-0.5, 0.5, columns) * interior.half_width
    zs = np.linspace(-0.6, 0.6, rows) * interior.half_depth
    top = interior.height + depth
    holes: list[Hole] = []
    shapes: list[Shape] = []
    for x in xs:
        for z in zs:
            hole = ((float(x - side / 2), float(x + side / 2)), (float(z - side / 2), float(z + side / 2)))
            holes.append(hole)
            shapes += tunnel(1, (interior.height, top), hole, "white")
            shapes.append(rectangle("-y", top, hole, "white", radiance=60.0))
    return scene("recessed-cans", interior, shapes, holes={"+y": holes}, target=(0.0, 1.5, 0.0))


def cove(interior: Interior = STANDARD, drop: float = 0.25, lip: float = 0.08, width: float = 0.3) -> SceneDict:
    """Return a room with a strip lamp behind a ledge, `drop` below the ceiling on the left wall."""
    left, y, z = -interior.half_width, interior.height - drop, interior.half_depth
    edge = left + width
    ledge = box((left, y - 0.02, -z), (edge, y, z), "white", ("-x", "-z", "+z"))
    front = box((edge - 0.02, y, -z), (edge, y + lip, z), "white", ("-y", "-z", "+z"))
    strip = box((left + 0.08, y + 0.01, 0.05 - z), (left + 0.12, y + 0.04, z - 0.05), "white", radiance=40.0)
    return scene("cove", interior, [ledge, front, strip], target=(-0.3, 1.5, 0.0))


def lampshade(
    interior: Interior = STANDARD, radius: float = 0.12, height: float = 0.25, bulb: float = 0.03
) -> SceneDict:
    """Return a room with a bulb in a thin shade that is open above and below, over a table."""
    x, y, z = 0.3, 1.0, -0.6
    angles = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(angles), np.zeros(16), np.sin(angles)], axis=1)
    vertices = np.array([x, y, z]) + np.concatenate([radius * ring, 0.75 * radius * ring + (0, height, 0)])
    shade = mesh(vertices, [[i, i + 16, (i + 1) % 16 + 16, (i + 1) % 16] for i in range(16)], "cloth")
    middle = y + 0.45 * height
    light = box((x - bulb, middle - bulb, z - bulb), (x + bulb, middle + bulb, z + bulb), "white", radiance=300.0)
    table = box((x - 0.4, 0.0, z - 0.4), (x + 0.4, 0.7, z + 0.4), "wood", ("-y",))
    return scene("lampshade", interior, [shade, light, table], position=(0.0, 1.5, 1.2), target=(0.2, 1.1, -0.6))


def books(interior: Interior = STANDARD, count: int = 40, gap: float = 0.005) -> SceneDict:
    """Return a room with a row of books `gap` apart on a shelf at its back wall, and a strip lamp above them."""
    back, thick, y = -interior.half_depth, 0.03, 1.2
    pitch = thick + gap
    start = -0.5 * count * pitch
    end = -start
    shelf = box((start - 0.1, y - 0.02, back), (end + 0.1, y, back + 0.28), "wood", ("-z",))
    strip = box((start, y + 0.5, back + 0.2), (end, y + 0.54, back + 0.26), "white", radiance=15.0)
    shapes = [shelf, strip]
    for i in range(count):
        tall, deep = 0.22 + 0.05 * (0.5 + 0.5 * np.sin(2.4 * i)), 0.17 + 0.03 * (0.5 + 0.5 * np.sin(1.7 * i))
        x = start + i * pitch
        material = ("wood", "cloth", "wall")[i % 3]
        shapes.append(box((x, y, back + 0.01), (x + thick, y + tall, back + 0.01 + deep), material, ("-y",)))
    return scene("books", interior, shapes, position=(0.0, 1.6, back + 2.0), target=(0.0, 1.35, back))


def door_ajar(interior: Interior = STANDARD, angle: float = 10.0, thickness: float = 0.04) -> SceneDict:
    """Return a dim room whose door, in the back wall, is open by `angle` degrees to a bright corridor."""
    x0, x1, tall = -0.45, 0.45, 2.05
    back, depth = -interior.half_depth, 1.6
    far = back - 0.1
    hole = ((x0, x1), (0.0, tall))
    corridor = Interior(interior.half_width + 0.5, 2.6, depth / 2)
    beyond = [_moved(shape, far - depth / 2) for shape in shell(corridor, {"+z": [hole]})]
    lamp = box((-1.5, 2.4, far - 1.0), (1.5, 2.46, far - 0.6), "white", radiance=15.0)
    pivot = (x0 + 0.004, 0.0, back - thickness - 0.01)
    leaf = box(
        (pivot[0], 0.006, pivot[2]), (x1 - 0.004, tall - 0.004, pivot[2] + thickness), "white", turn=(pivot, -angle)
    )
    shapes = [*tunnel(2, (far, back), hole), *beyond, lamp, leaf]
    return scene("door-ajar", interior, shapes, holes={"-z": [hole]}, target=(0.0, 1.1, 0.0))


def _moved(shape: Shape, dz: float) -> Shape:
    return shape | {"corners": [[x, y, z + dz] for x, y, z in shape["corners"]]}


def curtain(interior: Interior = STANDARD, gap: float = 0.01, wave: float = 0.005) -> SceneDict:
    """Return a room with a thin wavy curtain `gap` from the back wall, and a lamp above it that lights the gap."""
    back, half, top = -interior.half_depth, 1.0, interior.height - 0.5
    xs = np.linspace(-half, half, 41)
    zs = back + gap + wave * (1.0 - np.cos(2 * np.pi * xs / 0.4))
    low = np.stack([xs, np.full(41, 0.03), zs], axis=1)
    high = np.stack([xs, np.full(41, top), zs], axis=1)
    sheet = mesh(np.concatenate([low, high]), [[i, i + 1, i + 42, i + 41] for i in range(40)], "cloth")
    lamp = box((-half, top + 0.15, back + 0.04), (half, top + 0.19, back + 0.1), "white", radiance=25.0)
    return scene("curtain", interior, [sheet, lamp], position=(0.9, 1.6, back + 3.2), target=(0.2, 1.3, back))


def carpet_edge(interior: Interior = STANDARD, thickness: float = 0.01, lamp_height: float = 0.25) -> SceneDict:
    """Return a room with a carpet of some thickness, and a lamp near the floor beside its edge."""
    carpet = box((-1.37, 0.0, -1.83), (0.43, thickness, 1.21), "cloth", ("-y",))
    y = lamp_height
    lamp = box((0.75, y, -0.6), (0.9, y + 0.15, -0.45), "white", radiance=60.0)
    return scene("carpet-edge", interior, [carpet, lamp], target=(0.0, 0.6, 0.0))


def cabinet(interior: Interior = STANDARD, angle: float = 8.0, thickness: float = 0.02) -> SceneDict:
    """Return a room that is lit by a lamp in a cabinet at its back wall, whose two doors are slightly open."""
    back, half, y0, y1, depth, t = -interior.half_depth, 0.6, 0.9, 2.1, 0.4, thickness
    front = back + depth
    shapes = [
        box((-half, y0, back), (t - half, y1, front), "wood", ("-z",)),
        box((half - t, y0, back), (half, y1, front), "wood", ("-z",)),
        box((t - half, y0, back), (half - t, y0 + t, front), "wood", ("-z", "-x", "+x")),
        box((t - half, y1 - t, back), (half - t, y1, front), "wood", ("-z", "-x", "+x")),
        box((-0.3, y1 - 0.12, back + 0.15), (0.3, y1 - 0.08, back + 0.2), "white", radiance=150.0),
    ]
    for sign in (-1.0, 1.0):
        pivot = (sign * half, 0.0, front + 0.002)
        x = sorted((sign * half, sign * 0.002))
        shapes.append(box((x[0], y0, pivot[2]), (x[1], y1, pivot[2] + t), "wood", turn=(pivot, sign * angle)))
    return scene("cabinet", interior, shapes, position=(0.7, 1.5, back + 3.0), target=(0.0, 1.4, back))


def cable_duct(interior: Interior = STANDARD, side: float = 0.05, slit: float = 0.02) -> SceneDict:
    """Return a room that is lit by a strip in a duct along its left wall, through a slit in the duct's top."""
    left, z, y = -interior.half_width, interior.half_depth, 1.0
    edge, top = left + side, y + side
    along = (-z, z)
    duct = [
        rectangle("+y", y, ((left, edge), along), "white"),
        rectangle("+x", edge, ((y, top), along), "white"),
        rectangle("+y", top, ((left + slit, edge), along), "white"),
    ]
    x = left + 0.4 * side
    strip = box((x, y + 0.012, 0.02 - z), (x + 0.012, y + 0.024, z - 0.02), "white", radiance=400.0)
    return scene("cable-duct", interior, [*duct, strip], position=(0.9, 1.5, z - 0.6), target=(-1.2, 1.3, -0.6))


def sun_blinds(interior: Interior = STANDARD, slats: int = 20, tilt: float = 35.0) -> SceneDict:
    """Return a room with a window in its left wall, behind blinds of thin slats that some sun and sky pass."""
    left, y0, y1, z0, z1 = -interior.half_width, 0.9, 2.3, -1.2, 0.8
    pitch = (y1 - y0) / slats
    dx, dy = (0.5 * pitch * 1.05 * value for value in (np.cos(np.radians(tilt)), np.sin(np.radians(tilt))))
    shapes = []
    for i in range(slats):
        x, y = left + 0.05, y0 + (i + 0.5) * pitch
        corners = [(x - dx, y + dy, z0 - 0.05), (x - dx, y + dy, z1 + 0.05)]
        corners += [(x + dx, y - dy, z1 + 0.05), (x + dx, y - dy, z0 - 0.05)]
        shapes.append(quad(*[(float(a), float(b), float(c)) for a, b, c in corners], material="white"))
    return scene(
        "sun-blinds",
        interior,
        shapes,
        holes={"-x": [((y0, y1), (z0, z1))]},
        position=(1.2, 1.5, interior.half_depth - 0.1),
        target=(-0.5, 1.2, -0.3),
        lights=[{"type": "directional", "direction": [1.0, -0.55, 0.25], "irradiance": 30.0}],
        sky={"zenith": 1.0, "horizon": 1.0},
    )


def thin_walls(interior: Interior = STANDARD, thickness: float = 0.0, opening: float = 0.8) -> SceneDict:
    """Return a dark room, and a lit room behind a thin wall with an opening from the floor up.

    thickness : thickness of the wall; 0: a single layer of quads
    """
    half, height, tall = interior.half_width, interior.height, 2.0
    hole = ((0.5, 0.5 + opening), (0.0, tall))
    area = ((-half, half), (0.0, height))
    shapes = pierced("+z", 0.0, area, [hole])
    if thickness:
        shapes += [*pierced("-z", -thickness, area, [hole]), *tunnel(2, (-thickness, 0.0), hole)]
    z = -0.5 * interior.half_depth
    shapes.append(box((-0.4, height - 0.3, z - 0.2), (0.4, height - 0.24, z + 0.2), "white", radiance=15.0))
    return scene("thin-walls", interior, shapes, target=(0.0, 1.3, 0.0))


def rug(interior: Interior = STANDARD, gap: float = 0.001, size: float = 0.15) -> SceneDict:
    """Return a room with a thin rug `gap` above its floor, and a strong lamp over the rug."""
    sheet = rectangle("+y", gap, ((-0.93, 0.87), (-1.57, 0.93)), "cloth")
    y = interior.height - 0.8
    lamp = box((-size, y, -size - 0.4), (size, y + 0.08, size - 0.4), "white", radiance=40.0)
    return scene("rug", interior, [sheet, lamp], target=(0.0, 0.8, 0.0))


#: Builders of the named rooms.
ROOMS: dict[str, Callable[[], SceneDict]] = {
    "lamp-1cm": lambda: lamp_below_ceiling(gap=0.01),
    "lamp-3cm": lambda: lamp_below_ceiling(gap=0.03),
    "lamp-10cm": lambda: lamp_below_ceiling(gap=0.1),
    "lamp-30cm": lambda: lamp_below_ceiling(gap=0.3),
    "lamp-in-ceiling": lambda: lamp_below_ceiling(gap=0.0),
    "recessed-cans": recessed_cans,
    "cove": cove,
    "lampshade": lampshade,
    "books": books,
    "door-ajar": door_ajar,
    "curtain": curtain,
    "carpet-edge": carpet_edge,
    "cabinet": cabinet,
    "cable-duct": cable_duct,
    "sun-blinds": sun_blinds,
    "thin-walls": thin_walls,
    "rug-1mm": rug,
}


def room(name: str) -> SceneDict:
    """Return the scene dictionary of a named room. Raises KeyError for a name that is not in `ROOMS`."""
    return ROOMS[name]() | {"name": name}


# Random rooms


def _random_builders(rng: np.random.Generator, interior: Interior) -> tuple[Callable[[], SceneDict], ...]:
    """Return a builder for each kind of room, with random sizes."""

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def gap(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    return (
        lambda: lamp_below_ceiling(interior, gap(0.005, 0.5), between(0.1, 0.6)),
        lambda: recessed_cans(
            interior, int(rng.integers(1, 4)), int(rng.integers(2, 5)), between(0.08, 0.2), between(0.05, 0.2)
        ),
        lambda: cove(interior, between(0.15, 0.5), between(0.03, 0.1), between(0.2, 0.4)),
        lambda: lampshade(interior, between(0.1, 0.25), between(0.15, 0.4), between(0.02, 0.05)),
        lambda: books(interior, int(rng.integers(15, 45)), gap(0.002, 0.02)),
        lambda: door_ajar(interior, between(4.0, 40.0), between(0.02, 0.06)),
        lambda: curtain(interior, gap(0.005, 0.05), between(0.0, 0.02)),
        lambda: carpet_edge(interior, gap(0.003, 0.04), between(0.06, 1.5)),
        lambda: cabinet(interior, between(4.0, 30.0), between(0.01, 0.03)),
        lambda: cable_duct(interior, between(0.05, 0.1), gap(0.01, 0.03)),
        lambda: sun_blinds(interior, int(rng.integers(10, 30)), between(-20.0, 45.0)),
        lambda: thin_walls(interior, float(rng.choice([0.0, 0.001, 0.02])), between(0.1, 1.2)),
        lambda: rug(interior, gap(0.0005, 0.01), between(0.05, 0.4)),
    )


def _random_furniture(rng: np.random.Generator, interior: Interior) -> tuple[Shape, ...]:
    """Return up to four boxes on the floor, along the side walls, turned a little."""
    boxes = []
    for _ in range(int(rng.integers(0, 5))):
        side = rng.choice([-1.0, 1.0])
        width, depth, height = (float(value) for value in rng.uniform((0.2, 0.2, 0.2), (0.6, 0.9, 0.85)))
        x = float(side * (interior.half_width - 0.5 - 0.5 * width - rng.uniform(0.0, 0.2)))
        z = float(rng.uniform(-0.65, 0.35) * interior.half_depth)
        lower, upper = (x - width / 2, 0.0, z - depth / 2), (x + width / 2, height, z + depth / 2)
        material = str(rng.choice(["wood", "cloth", "white"]))
        turn = ((x, 0.0, z), float(rng.uniform(-20.0, 20.0)))
        boxes.append(box(lower, upper, material, ("-y",), turn=turn))
    return tuple(boxes)


def held_out(seed: int) -> SceneDict:
    """Return a random room: `seed` determines size, lamp, gap, furniture and one of 13 kinds, in turns."""
    rng = np.random.default_rng(seed)
    width, height, depth = (float(value) for value in rng.uniform((1.6, 2.6, 2.5), (2.6, 3.4, 3.5)))
    interior = Interior(width, height, depth)
    interior = Interior(width, height, depth, _random_furniture(rng, interior))
    builders = _random_builders(rng, interior)
    made = builders[seed % len(builders)]()
    walls = [float(value) for value in rng.uniform(0.4, 0.75) + rng.uniform(-0.1, 0.1, 3)]
    return made | {
        "name": f"held-out-{seed}-{made['name']}",
        "materials": MATERIALS | {"wall": {"reflectance": walls}},
    }
