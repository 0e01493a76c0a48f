"""Faces with known view factors, and rooms and cities of any size, for the tests and the bench.

Closed forms: J. Howell, "A catalog of radiation heat transfer configuration factors", with its numbers (C-11 etc.).
Polygons of equal area replace round surfaces, with so many sides that the factors change by less than 0.1 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import atan, cos, log, pi, sin, sqrt, tau
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
#: Vertices (V, 3), and the indices of each face's corners.
FaceList = tuple[Float64, list[list[int]]]


def joined(*parts: FaceList) -> FaceList:
    """Join several lists of faces."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [
        [int(v + start) for v in face] for (_, some), start in zip(parts, starts, strict=False) for face in some
    ]
    return np.concatenate([vertices for vertices, _ in parts]), faces


def grid(origin: ArrayLike, u: ArrayLike, v: ArrayLike, n: int, m: int, triangles: bool = False) -> FaceList:
    """Return a parallelogram as n x m faces, or twice as many triangles; its front faces u x v."""
    s, t = np.meshgrid(np.arange(n + 1) / n, np.arange(m + 1) / m, indexing="ij")
    edges = np.asarray(u, float), np.asarray(v, float)
    vertices = np.asarray(origin, float) + s[..., None] * edges[0] + t[..., None] * edges[1]
    faces = []
    for i in range(n):
        for j in range(m):
            a, b, c, d = (x * (m + 1) + y for x, y in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
            faces += [[a, b, c], [a, c, d]] if triangles else [[a, b, c, d]]
    return vertices.reshape(-1, 3), faces


def box_faces(
    lower: ArrayLike, upper: ArrayLike, cells: int, inward: bool, triangles: bool = False, bottom: bool = True
) -> FaceList:
    """Return a box with cells x cells faces per side, fronts inside or outside: floor, ceiling, then the walls."""
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    x, y, z = np.diag(high - low)
    at = [low, low + z, low, low + x, low, low + y]
    spans = [(x, y), (y, x), (y, z), (z, y), (z, x), (x, z)]
    parts = [
        grid(o, u, v, cells, cells, triangles) if inward else grid(o, v, u, cells, cells, triangles)
        for k, (o, (u, v)) in enumerate(zip(at, spans, strict=True))
        if bottom or k
    ]
    return joined(*parts)


def room_of_outline(outline: Sequence[Sequence[float]], height: float) -> FaceList:
    """Return a room over a floor plan, counter-clockwise, with fronts inside."""
    plan = np.asarray(outline, float)
    n = len(plan)
    vertices = np.concatenate([np.column_stack([plan, np.full(n, z)]) for z in (0.0, height)])
    walls = [[i, i + n, (i + 1) % n + n, (i + 1) % n] for i in range(n)]
    return vertices, [list(range(n)), list(range(2 * n - 1, n - 1, -1)), *walls]


def block_in_a_room(cells: int) -> FaceList:
    """Return a closed cube with a floating block in it, in triangles: 24 cells^2 faces."""
    room = box_faces([0, 0, 0], [1, 1, 1], cells, inward=True, triangles=True)
    return joined(room, box_faces([0.3, 0.3, 0.2], [0.6, 0.7, 0.6], cells, inward=False, triangles=True))


def ball_in_a_box(cells: int = 4) -> FaceList:
    """Return a closed cube with a floating ball of 320 triangles in its middle: 512 triangles with 4 x 4 cells."""
    ball = _icosphere(2)
    room = box_faces([0, 0, 0], [1, 1, 1], cells, inward=True, triangles=True)
    return joined(room, (0.3 * ball[0] + 0.5, ball[1]))


def slats(count: int = 14, cells: int = 3) -> FaceList:
    """A cube of 12 cells^2 triangles, in which thin sheets of two sides hang as slats of a blind, turned by 40
    degrees, with slits between: 164 triangles, closed.
    """
    parts = [box_faces([0, 0, 0], [1, 1, 1], cells, inward=True, triangles=True)]
    u, v = np.array([0, 0.96, 0]), 0.96 / count * np.array([cos(0.7), 0, sin(0.7)])
    for k in range(count):
        origin = np.array([0.3, 0.02, (k + 0.5) / count]) - 0.5 * v
        parts += [grid(origin, u, v, 1, 1, True), grid(origin, v, u, 1, 1, True)]
    return joined(*parts)


def _icosphere(divided: int) -> FaceList:
    """Return an icosahedron's 20 triangles on the unit sphere, quartered this many times, fronts outside."""
    golden = (1 + sqrt(5)) / 2
    points = [[0.0, s, t * golden] for s in (-1, 1) for t in (-1, 1)]
    vertices = np.array([np.roll(p, k) for k in range(3) for p in points])
    near = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < 2.1
    faces = []
    for i, j, k in combinations(range(12), 3):
        if near[i, j] and near[j, k] and near[k, i]:
            out = float(np.linalg.det(vertices[[i, j, k]])) > 0
            faces.append([i, j, k] if out else [i, k, j])
    points = [list(v / np.linalg.norm(v)) for v in vertices]
    for _ in range(divided):
        middles: dict[tuple[int, int], int] = {}
        quartered = []
        for face in faces:
            m = []
            for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0])):
                edge = (min(a, b), max(a, b))
                if edge not in middles:
                    middle = np.add(points[a], points[b])
                    middles[edge] = len(points)
                    points.append(list(middle / np.linalg.norm(middle)))
                m.append(middles[edge])
            a, b, c = face
            quartered += [[a, m[0], m[2]], [m[0], b, m[1]], [m[2], m[1], c], m]
        faces = quartered
    return np.array(points), faces


def closed_at_random(seed: int) -> FaceList:
    """Return a closed room with difficult shapes for view factors; being closed, its rows must add up to 1.

    Each half contains one of: a slab that leaves slits along the walls, two blocks with a common edge, a tiny block
    beside large faces, or two-sided sheets, of equal or different size, that may cut each other.
    """
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.5, 2.0, 3)
    parts = [box_faces([0, 0, 0], size, int(rng.integers(1, 4)), inward=True, triangles=bool(rng.integers(2)))]
    for half, kind in enumerate(rng.integers(5, size=2)):
        boxes: list[tuple[Any, Any]] = []
        if kind == 0:
            gap = 10.0 ** rng.uniform(-3, -1, 3)
            z = rng.uniform(0.2, 0.8)
            boxes = [([0.1, gap[0], z], [0.9, 1 - gap[1], z + gap[2]])]
        elif kind == 1:
            low, high = rng.uniform(0.1, 0.3, 3), rng.uniform(0.4, 0.6, 3)
            boxes = [(low, high), ([high[0], low[1], high[2]], [0.9, high[1], 0.8])]
        elif kind == 2:
            low = rng.uniform(0.2, 0.8, 3)
            boxes = [(low, low + 10.0 ** rng.uniform(-3, -1, 3))]
        else:
            count = int(rng.integers(2, 9))
            extent = np.full((count, 1, 1), 0.3) if kind == 3 else 0.3 * 10.0 ** rng.uniform(-2, 0, (count, 1, 1))
            corners = rng.uniform(0.35, 0.65, (count, 1, 3)) + extent * rng.uniform(-1, 1, (count, 3, 3))
            sheets = np.arange(3 * count).reshape(-1, 3)
            parts.append((corners.reshape(-1, 3), [*sheets.tolist(), *sheets[:, ::-1].tolist()]))
        parts += [box_faces(low, high, 1, inward=False, triangles=bool(rng.integers(2))) for low, high in boxes]
        for k in range(len(parts) - max(len(boxes), 1), len(parts)):
            vertices, faces = parts[k]
            parts[k] = (vertices + np.array([half, 0, 0])) * [0.5, 1, 1] * size, faces
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    vertices, faces = joined(*parts)
    return vertices @ (turn * np.sign(np.linalg.det(turn))), faces


def city(blocks: int, wall: int = 3, seed: int = 1) -> FaceList:
    """Return blocks^2 buildings of 6 to 24 m with streets of 8 m, in quads: each has 5 wall^2 + 12 facets."""
    heights = 3.0 * np.random.default_rng(seed).integers(2, 9, (blocks, blocks))
    parts = []
    for i in range(blocks):
        for j in range(blocks):
            x, y = 20.0 * i, 20.0 * j
            top = [x + 16, y + 16, float(heights[i, j])]
            parts.append(box_faces([x + 4, y + 4, 0], top, wall, inward=False, bottom=False))
            for a, b in ((a, b) for a in range(4) for b in range(4) if not (a in (1, 2) and b in (1, 2))):
                u, v = (0.0, 4.0, 10.0, 16.0, 20.0), (0.0, 4.0, 10.0, 16.0, 20.0)
                corner = [x + u[a], y + v[b], 0]
                parts.append(grid(corner, [u[a + 1] - u[a], 0, 0], [0, v[b + 1] - v[b], 0], 1, 1))
    return joined(*parts)


@dataclass(frozen=True)
class ClosedForm:
    """A view factor in closed form, from the first row to the second.

    name   : name with the catalogue's number
    factor : value by the closed form
    make   : function that returns the faces, and the group of each
    """

    name: str
    factor: float
    make: Callable[[], tuple[FaceList, Any]]

    @cached_property
    def _made(self) -> tuple[FaceList, Any]:
        return self.make()

    @property
    def faces(self) -> FaceList:
        return self._made[0]

    @property
    def groups(self) -> Any:
        return self._made[1]


def parallel_rectangles(x: float, y: float) -> float:
    """Return C-11: equal opposite rectangles; sides divided by the distance."""
    a, b = 1 + x * x, 1 + y * y
    return (2 / (pi * x * y)) * (
        log(sqrt(a * b / (a + b - 1)))
        + x * sqrt(b) * atan(x / sqrt(b))
        + y * sqrt(a) * atan(y / sqrt(a))
        - x * atan(x)
        - y * atan(y)
    )


def perpendicular_rectangles(h: float, w: float) -> float:
    """Return C-14: rectangles with a common edge; height of the second, width of the first, over the edge."""
    hh, ww = h * h, w * w
    s = hh + ww
    a = (1 + ww) * (1 + hh) / (1 + s)
    b = (ww * (1 + s) / ((1 + ww) * s)) ** ww
    c = (hh * (1 + s) / ((1 + hh) * s)) ** hh
    return (w * atan(1 / w) + h * atan(1 / h) - sqrt(s) * atan(1 / sqrt(s)) + 0.25 * log(a * b * c)) / (pi * w)


def coaxial_discs(r1: float, r2: float, distance: float) -> float:
    """Return C-41: coaxial discs, from the first to the second."""
    a, b = r1 / distance, r2 / distance
    s = 1 + (1 + b * b) / (a * a)
    return 0.5 * (s - sqrt(s * s - 4 * (b / a) ** 2))


def _disc(radius: float, z: float, sides: int, up: bool, inner: float = 0.0) -> FaceList:
    """Return a regular polygon with a disc's area, or a ring; counter-clockwise from above if its front is up."""
    scale = sqrt(tau / sides / sin(tau / sides))
    angles = tau * (np.arange(sides) + 0.5) / sides
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    outer = np.column_stack([radius * scale * ring, np.full(sides, z)])
    if not inner:
        face = list(range(sides))
        return outer, [face if up else face[::-1]]
    inside = np.column_stack([inner * scale * ring, np.full(sides, z)])
    quads = [[i + sides, i, (i + 1) % sides, (i + 1) % sides + sides] for i in range(sides)]
    return np.concatenate([outer, inside]), quads if up else [quad[::-1] for quad in quads]


def _tube(radius: float, low: float, high: float, sides: int, inward: bool) -> FaceList:
    bottom, _ = _disc(radius, low, sides, True)
    top = bottom + np.array([0, 0, high - low])
    quads = [[i, (i + 1) % sides, (i + 1) % sides + sides, i + sides] for i in range(sides)]
    return np.concatenate([bottom, top]), [quad[::-1] for quad in quads] if inward else quads


def _ball(centre: ArrayLike, radius: float, rings: int, sides: int) -> FaceList:
    """Return a polyhedron with a sphere's area, fronts outside."""
    vertices = [[0.0, 0.0, -1.0]]
    for i in range(1, rings):
        latitude = pi * (i / rings - 0.5)
        vertices += [[cos(latitude) * cos(tau * k / sides), cos(latitude) * sin(tau * k / sides), sin(latitude)]
                     for k in range(sides)]  # fmt: skip
    vertices.append([0.0, 0.0, 1.0])
    last = len(vertices) - 1
    faces = []
    for k in range(sides):
        j = (k + 1) % sides
        faces.append([0, 1 + j, 1 + k])
        faces.append([last, last - sides + k, last - sides + j])
        for i in range(rings - 2):
            a, b = 1 + i * sides + k, 1 + i * sides + j
            faces.append([a, b, b + sides, a + sides])
    points = np.array(vertices)
    area = sum(
        0.5 * float(np.linalg.norm(np.cross(points[f[i]] - points[f[0]], points[f[i + 1]] - points[f[0]])))
        for f in faces
        for i in range(1, len(f) - 1)
    )
    return np.asarray(centre, float) + points * radius * sqrt(4 * pi / area), faces


def _groups(*parts: FaceList) -> tuple[FaceList, list[int]]:
    """Join the parts; each part is a row."""
    return joined(*parts), [i for i, (_, faces) in enumerate(parts) for _ in faces]


def _ring_factor(hole: float, r1: float, r2: float, distance: float) -> float:
    """Return the factor from a disc to a coaxial ring, by subtraction."""
    return coaxial_discs(r1, r2, distance) - coaxial_discs(r1, hole, distance)


def _blocked_discs(radius: float, blocker: float, distance: float) -> float:
    """Integrate numerically, over rings, the factor of equal coaxial discs with a coaxial blocker half-way.

    From a point of one disc, the blocker's shadow on the other disc is a disc of twice the blocker's radius, around
    the mirror image of the point in the axis.
    """
    rings, turns = 100, 360  # good to 1e-5
    r = radius * np.sqrt((np.arange(rings) + 0.5) / rings)
    angles = tau * (np.arange(turns) + 0.5) / turns
    total = 0.0
    for x in r:
        y = r[:, None] * np.cos(angles), r[:, None] * np.sin(angles)
        seen = (y[0] + x) ** 2 + y[1] ** 2 > (2 * blocker) ** 2
        square = (y[0] - x) ** 2 + y[1] ** 2 + distance**2
        total += float((seen * distance**2 / (pi * square**2)).mean()) * pi * radius**2
    return total / rings


def _angled_strips(angle: float) -> float:
    """Return C-5a: two infinite plates of equal width with a common edge, by crossed strings."""
    return 1 - sin(angle / 2)


_X, _Y = [1.0, 0, 0], [0, 1.0, 0]
_SIDES = 96

CLOSED_FORMS = (
    ClosedForm(
        "C-11 parallel squares",
        parallel_rectangles(1, 1),
        lambda: _groups(grid([0, 0, 0], _X, _Y, 1, 1), grid([0, 0, 1], _Y, _X, 1, 1)),
    ),
    ClosedForm(
        "C-11 parallel rectangles, near",
        parallel_rectangles(20, 10),
        lambda: _groups(grid([0, 0, 0], [2, 0, 0], _Y, 2, 1), grid([0, 0, 0.1], _Y, [2, 0, 0], 1, 2)),
    ),
    ClosedForm(
        "C-14 perpendicular squares",
        perpendicular_rectangles(1, 1),
        lambda: _groups(grid([0, 0, 0], _X, _Y, 1, 1), grid([0, 0, 0], _Y, [0, 0, 1], 1, 1)),
    ),
    ClosedForm(
        "C-14 perpendicular rectangles",
        perpendicular_rectangles(2, 0.5),
        lambda: _groups(grid([0, 0, 0], [0.5, 0, 0], _Y, 1, 2), grid([0, 0, 0], _Y, [0, 0, 2], 2, 1)),
    ),
    ClosedForm(
        "C-5 plates at 60 degrees, long",
        _angled_strips(pi / 3),
        lambda: _groups(
            grid([0, 0, 0], _X, [0, 2000, 0], 1, 1), grid([0, 0, 0], [0, 2000, 0], [0.5, 0, sqrt(0.75)], 1, 1)
        ),
    ),
    ClosedForm(
        "C-41 coaxial discs",
        coaxial_discs(1, 1, 1),
        lambda: _groups(_disc(1, 0, _SIDES, True), _disc(1, 1, _SIDES, False)),
    ),
    ClosedForm(
        "C-41 coaxial discs, unequal",
        coaxial_discs(0.5, 2, 1.5),
        lambda: _groups(_disc(0.5, 0, _SIDES, True), _disc(2, 1.5, _SIDES, False)),
    ),
    ClosedForm(
        "C-53 disc to a coaxial ring",
        _ring_factor(0.5, 1, 1.5, 1),
        lambda: _groups(_disc(1, 0, _SIDES, True), _disc(1.5, 1, _SIDES, False, inner=0.5)),
    ),
    ClosedForm(
        "C-79 base of a cylinder to its inside",
        1 - coaxial_discs(1, 1, 2),
        lambda: _groups(_disc(1, 0, _SIDES, True), _tube(1, 0, 2, _SIDES, inward=True)),
    ),
    ClosedForm(
        "C-121 sphere to a coaxial disc",
        0.5 * (1 - 1 / sqrt(1 + 1.0)),
        lambda: _groups(_ball([0, 0, 2], 0.5, 24, 48), _disc(2, 0, _SIDES, True)),
    ),
    ClosedForm(
        "coaxial discs with a blocker between",
        _blocked_discs(1, 0.4, 1),
        lambda: _groups(
            _disc(1, 0, _SIDES, True), _disc(1, 1, _SIDES, False), _disc(0.4, 0.5, _SIDES, True),
            _disc(0.4, 0.5, _SIDES, False),
        ),
    ),
)  # fmt: skip
