"""A furnished room of 14,920 triangles, the number of the lost room of [PB 5, figures 11 to 13].

It has a fireplace with posts between two doors, under ceiling beams; a table with chairs, a sofa and an armchair
around the fire, shelves of books, pictures and lamps. Units are metres; x runs along the wall of the fireplace, y
up, and z from it into the room. Everything is diffuse and one-sided. Of two touching faces one is omitted, and
walls have holes behind things that stand before them, so that no surfaces coincide and hardly any part is hidden.
Large surfaces are divided, so that each triangle can be a patch of a radiosity solution.

[PB] B. Walter, J. Lengyel, "The Path-Buffer", PCG-95-4, Cornell University, 1995.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.scenes import furniture
from benchmarks.scenes.furniture import Fineness, Part, Piece, placed
from benchmarks.scenes.solids import Profile, block, lines, moved, outside, patch, sheet, skin, turned
from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes

#: Size of the room, whose corner is at 0.
ROOM = (6.6, 2.8, 7.0)
W, H, D = ROOM
MIDDLE = W / 2

_COLOURS = {
    "plaster": (0.74, 0.65, 0.50),
    "ceiling": (0.82, 0.78, 0.70),
    "beam": (0.20, 0.115, 0.06),
    "oak": (0.42, 0.25, 0.12),
    "oak-light": (0.47, 0.29, 0.15),
    "oak-dark": (0.36, 0.205, 0.095),
    "walnut": (0.26, 0.13, 0.06),
    "ivory": (0.80, 0.75, 0.63),
    "door": (0.17, 0.27, 0.22),
    "brass": (0.60, 0.42, 0.15),
    "stone": (0.60, 0.55, 0.47),
    "marble": (0.78, 0.74, 0.68),
    "brick-red": (0.40, 0.15, 0.095),
    "brick-light": (0.48, 0.205, 0.13),
    "brick-dark": (0.30, 0.105, 0.07),
    "mortar": (0.45, 0.40, 0.34),
    "soot": (0.12, 0.095, 0.08),
    "log": (0.24, 0.14, 0.075),
    "ember": (0.10, 0.05, 0.03),
    "teal": (0.085, 0.21, 0.25),
    "rust": (0.56, 0.24, 0.075),
    "seat": (0.50, 0.12, 0.08),
    "mustard": (0.72, 0.50, 0.16),
    "rug-red": (0.42, 0.065, 0.06),
    "rug-blue": (0.07, 0.09, 0.19),
    "rug-cream": (0.74, 0.62, 0.40),
    "wax": (0.86, 0.82, 0.70),
    "porcelain": (0.80, 0.82, 0.84),
    "glaze": (0.10, 0.28, 0.48),
    "celadon": (0.38, 0.56, 0.43),
    "apple": (0.60, 0.09, 0.05),
    "pear": (0.62, 0.60, 0.14),
    "gilt": (0.62, 0.45, 0.17),
    "sky": (0.62, 0.72, 0.80),
    "dusk": (0.86, 0.66, 0.42),
    "far-hills": (0.36, 0.45, 0.56),
    "hills": (0.24, 0.36, 0.24),
    "field": (0.58, 0.50, 0.20),
    "meadow": (0.12, 0.20, 0.10),
    "sea": (0.14, 0.32, 0.46),
    "sand": (0.72, 0.60, 0.40),
    "book-red": (0.45, 0.08, 0.06),
    "book-green": (0.09, 0.25, 0.14),
    "book-blue": (0.09, 0.14, 0.34),
    "book-brown": (0.32, 0.17, 0.08),
    "book-cream": (0.70, 0.62, 0.46),
    "book-ochre": (0.58, 0.38, 0.10),
    "lamp": (0.80, 0.78, 0.72),
}


def room(detail: float = 1.0) -> Scene:
    """Return a furnished room with a fireplace, lit by lamps.

    detail : fineness of the triangles, from 0.25 to 16: 14,920 triangles at 1, 34,696 at 4
    """
    fine = Fineness(float(np.sqrt(detail)))
    parts = [
        *_walls(fine),
        *_floor(fine),
        *_ceiling(fine),
        *_doors(fine),
        *_fireplace(fine),
        *_rug(fine),
        *_furniture(fine),
        *_ornaments(fine),
        *_pictures(fine),
        *_lamps(fine),
    ]
    camera = Camera(
        np.array([4.9, 1.62, 6.8]),
        np.array([2.8, 1.02, 0.9]),
        np.array([0.0, 1.0, 0.0]),
        64.0,
        (256, 256),
    )
    return _scene(parts, camera)


def _scene(parts: Sequence[Part], camera: Camera) -> Scene:
    """Return a scene with 32-bit coordinates, as in a model file."""
    names = [name for name in _COLOURS if any(part.material == name for part in parts)]
    shapes = [
        Shape(
            part.name,
            Mesh.of_triangles(part.corners.astype(np.float32)).welded(),
            names.index(part.material),
            emission=np.array(part.emission),
        )
        for part in parts
    ]
    return Scene(
        name="room",
        camera=camera,
        shapes=Shapes(shapes),
        materials=tuple(Material(name, np.array(_COLOURS[name]), two_sided=False) for name in names),
        source="room",
    )


# Walls, and what stands before them

_Rectangle = tuple[float, float, float, float]  # from, to along; from, to up

_SKIRTING_HIGH, _SKIRTING_DEEP = 0.12, 0.018
_BREAST, _BREAST_DEEP = (MIDDLE - 1.1, MIDDLE + 1.1), 0.5  # of the chimney
_BEAMS = [(float(x) - 0.075, float(x) + 0.075) for x in W * (np.arange(6) + 0.5) / 6]
_BEAM_HIGH = 0.19
_BOOKCASE = (1.35, 3.55)  # along z, on the left wall
_BOOKCASE_HIGH, _BOOKCASE_DEEP = 2.16, 0.32
_CASING, _CASING_DEEP = 0.1, 0.022
_DOOR_WIDE, _DOOR_HIGH, _DOOR_DEEP = 0.86, 2.04, 0.07
_DOORS = {"left": 1.0, "right": W - 1.0}  # middles of the doors, on the wall of the fireplace
_HEARTH, _HEARTH_HIGH = 1.15, 0.06
_RUG = (2.3, 4.8, 1.65, 3.5)


def _on(wall: str, corners: Float64) -> Float64:
    """Map (along to the right, up, out of the wall), seen from inside, to coordinates of the room."""
    origin, along, out = {
        "back": ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
        "left": ((0, 0, D), (0, 0, -1), (1, 0, 0)),
        "right": ((W, 0, 0), (0, 0, 1), (-1, 0, 0)),
        "front": ((W, 0, D), (-1, 0, 0), (0, 0, -1)),
    }[wall]
    return np.asarray(corners @ np.array([along, (0, 1, 0), out], float) + origin)


def _hung(piece: Piece, wall: str, along: float, up: float, out: float = 0.0, name: str = "") -> Piece:
    """Put a piece that is centred on the origin of the xy plane onto a wall."""
    return [
        Part(f"{name}-{p.name}", p.material, _on(wall, moved(p.corners, (along, up, out))), p.emission)
        for p in piece
    ]


def _around(middle: float, up: float, width: float, height: float) -> _Rectangle:
    return middle - width / 2, middle + width / 2, up - height / 2, up + height / 2


def _walls(fine: Fineness) -> Piece:
    casing = _DOOR_WIDE / 2 + _CASING
    standing: dict[str, list[_Rectangle]] = {
        "back": [
            *((m - casing, m + casing, 0.0, _DOOR_HIGH + _CASING) for m in _DOORS.values()),
            (*_BREAST, 0.0, H),
        ],
        "left": [(D - _BOOKCASE[1], D - _BOOKCASE[0], 0.0, _BOOKCASE_HIGH)],
        "right": [],
        "front": [],
    }
    ends = [(a, b, H - _BEAM_HIGH, H) for a, b in _BEAMS]
    hanging = {wall: [_around(*where) for on, *where in _PICTURES.values() if on == wall] for wall in standing}
    hanging["back"] += ends
    hanging["front"] += [(W - b, W - a, low, high) for a, b, low, high in ends]
    parts = []
    for wall, before in standing.items():
        length = W if wall in ("back", "front") else D
        # The wall behind the camera may be coarser.
        cell = fine.cell(0.7 if wall == "front" else 0.5)
        holes = before + hanging[wall]
        us = lines(0, length, cell, [u for hole in holes for u in hole[:2]])
        vs = lines(_SKIRTING_HIGH, H, cell, [v for hole in holes for v in hole[2:]])
        face = sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), us, vs, outside(holes))
        # In the corners, the boards of the back and the front wall continue to the end.
        inset = 0.0 if wall in ("back", "front") else _SKIRTING_DEEP
        stops = [inset, *sorted(u for hole in before for u in hole[:2]), length - inset]
        boards = [
            block((a, 0, 0), (b, _SKIRTING_HIGH, _SKIRTING_DEEP), fine.cell(0.5), "-x +x -y -z")
            for a, b in zip(stops[::2], stops[1::2], strict=True)
        ]
        parts.append(Part(f"{wall}-wall", "plaster", _on(wall, face)))
        parts.append(Part(f"{wall}-skirting", "ivory", _on(wall, np.concatenate(boards))))
    return parts


def _floor(fine: Fineness) -> Piece:
    """Return boards along z, in three browns and with staggered joints, and the thresholds of the doors."""
    s = _SKIRTING_DEEP
    covered = [(*_BREAST, 0.0, _HEARTH), (0.0, _BOOKCASE_DEEP, *_BOOKCASE), _RUG]
    xs = np.linspace(s, W - s, 24)
    tones: list[list[Float64]] = [[], [], []]
    for i, (x0, x1) in enumerate(pairwise(xs)):
        joints = [s, *np.arange(0.35 + 0.47 * i % 1.4, D - 0.2, 1.4).tolist(), D - s]
        for j, (z0, z1) in enumerate(pairwise(joints)):
            us = lines(x0, x1, fine.cell(0.3), [x for hole in covered for x in hole[:2]])
            vs = lines(z0, z1, fine.cell(0.62), [z for hole in covered for z in hole[2:]])
            # along z x along x is up
            board = sheet((0, 0, 0), (0, 0, 1), (1, 0, 0), vs, us, lambda v, u: outside(covered)(u, v))
            tones[(5 * i + 2 * j + i // 4) % 3].append(board)
    names = ("oak", "oak-light", "oak-dark")
    parts = [Part(f"floor-{t}", name, np.concatenate(tones[t])) for t, name in enumerate(names)]
    half = _DOOR_WIDE / 2
    sills = [
        patch([(m - half, 0, s), (m + half, 0, s), (m + half, 0, -_DOOR_DEEP), (m - half, 0, -_DOOR_DEEP)], 0.3)
        for m in _DOORS.values()
    ]
    return [*parts, Part("thresholds", "oak-dark", np.concatenate(sills))]


def _ceiling(fine: Fineness) -> Piece:
    """Return the ceiling and its six beams, two of which end at the chimney."""
    lights = [
        (x - _LIGHT_SIDE / 2, x + _LIGHT_SIDE / 2, z - _LIGHT_SIDE / 2, z + _LIGHT_SIDE / 2) for x, z in _LIGHTS
    ]
    covered = [(*_BREAST, 0.0, _BREAST_DEEP), *((a, b, 0.0, D) for a, b in _BEAMS), *lights]
    xs = lines(0, W, fine.cell(0.6), [x for hole in covered for x in hole[:2]])
    zs = lines(0, D, fine.cell(0.5), [z for hole in covered for z in hole[2:]])
    face = sheet((0, H, 0), (1, 0, 0), (0, 0, 1), xs, zs, outside(covered))
    beams = [
        block((a, H - _BEAM_HIGH, _BREAST_DEEP if _BREAST[0] < a < _BREAST[1] else 0), (b, H, D), fine.cell(0.8),
              "+y -z +z")
        for a, b in _BEAMS
    ]  # fmt: skip
    return [Part("ceiling", "ceiling", face), Part("beams", "beam", np.concatenate(beams))]


def _doors(fine: Fineness) -> Piece:
    """Return doors of six panels in their casings, on the wall of the fireplace."""
    cell, half, top, deep = fine.cell(0.5), _DOOR_WIDE / 2, _DOOR_HIGH, -_DOOR_DEEP
    outer = half + _CASING
    casing = [
        block((-outer, 0, 0), (-half, top, _CASING_DEEP), cell, "-y +y -z"),
        block((half, 0, 0), (outer, top, _CASING_DEEP), cell, "-y +y -z"),
        block((-outer, top, 0), (outer, top + _CASING, _CASING_DEEP), cell, "-z"),
        # The reveal, from the casing back to the leaf.
        patch([(-half, 0, 0), (-half, 0, deep), (-half, top, deep), (-half, top, 0)], cell),
        patch([(half, 0, deep), (half, 0, 0), (half, top, 0), (half, top, deep)], cell),
        patch([(-half, top, deep), (half, top, deep), (half, top, 0), (-half, top, 0)], cell),
    ]
    stile, rails = 0.11, [(0.2, 0.78), (0.9, 1.5), (1.62, 1.92)]
    panels = [(x0, x1, y0, y1) for y0, y1 in rails for x0, x1 in ((stile - half, -0.05), (0.05, half - stile))]
    us = lines(-half, half, cell, [x for p in panels for x in p[:2]])
    vs = lines(0, top, cell, [y for p in panels for y in p[2:]])
    leaf = [sheet((0, 0, deep), (1, 0, 0), (0, 1, 0), us, vs, outside(panels))]
    for x0, x1, y0, y1 in panels:
        # A panel: a moulding down to its ground, then up to a raised field.
        rings = [
            [(x0 + d, y0 + d, z), (x1 - d, y0 + d, z), (x1 - d, y1 - d, z), (x0 + d, y1 - d, z)]
            for d, z in ((0, deep), (0.015, deep - 0.014), (0.06, deep - 0.003))
        ]
        leaf += [skin(rings), patch(rings[-1], cell)]
    knob: Profile = [(0.03, 0), (0.03, 0.006), (0.01, 0.01), (0.01, 0.035), (0.024, 0.042), (0.03, 0.055),
                     (0.024, 0.068), (0, 0.072)]  # fmt: skip
    turn = moved(turned(knob, fine.turns(6)), lean=90)
    parts = []
    for name, middle in _DOORS.items():
        side = 1 if name == "left" else -1
        at = (middle, 0, 0)
        parts += [
            Part(f"{name}-door-casing", "ivory", moved(np.concatenate(casing), at)),
            Part(f"{name}-door", "door", moved(np.concatenate(leaf), at)),
            Part(f"{name}-door-knob", "brass", moved(turn, (middle + side * (half - 0.055), 1.02, deep))),
        ]
    return parts


# The fireplace

#: Positions of the posts' axes, along x.
POSTS = (MIDDLE - 0.9, MIDDLE + 0.9)

_OPENING = (MIDDLE - 0.5, MIDDLE + 0.5)
_BRICKWORK = (MIDDLE - 0.76, MIDDLE + 0.76)
_BRICK, _ROW, _MORTAR, _PROUD = 0.254, 0.0905, 0.014, 0.01
_ROWS, _ROWS_OF_OPENING = 12, 9
_LINTEL = _HEARTH_HIGH + _ROWS_OF_OPENING * _ROW
_FRIEZE = _HEARTH_HIGH + _ROWS * _ROW
_MANTEL = _FRIEZE + 0.205  # its upper side


def _fireplace(fine: Fineness) -> Piece:
    """Return chimney breast, brickwork, firebox with a fire, hearth, and a mantel on two posts."""
    z, cell = _BREAST_DEEP, fine.cell(0.42)
    left, right = _BREAST
    over = _around(MIDDLE, _PICTURES["landscape"][2], *_PICTURES["landscape"][3:])
    frieze = (MIDDLE - 1.02, MIDDLE + 1.02, _FRIEZE, _FRIEZE + 0.12)
    moulding = (MIDDLE - 1.06, MIDDLE + 1.06, _FRIEZE + 0.12, _FRIEZE + 0.145)
    shelf = (left - 0.04, right + 0.04, _FRIEZE + 0.145, _MANTEL)
    holes = [
        (left, right, 0.0, _HEARTH_HIGH), (*_BRICKWORK, _HEARTH_HIGH, _FRIEZE), frieze, moulding, shelf, over,
        *((a, b, H - _BEAM_HIGH, H) for a, b in _BEAMS),
    ]  # fmt: skip
    us = lines(left, right, cell, [u for hole in holes for u in hole[:2]])
    vs = lines(0, H, cell, [v for hole in holes for v in hole[2:]])
    up = lines(0, H, cell)
    breast = [
        sheet((0, 0, z), (1, 0, 0), (0, 1, 0), us, vs, outside(holes)),
        sheet((left, 0, 0), (0, 0, 1), (0, 1, 0), lines(0, z, cell), up),
        sheet((right, 0, z), (0, 0, -1), (0, 1, 0), lines(0, z, cell), up),
    ]
    hearth = block((left, 0, z), (right, _HEARTH_HIGH, _HEARTH), cell, "-y -z")
    stone = [
        block((a, low, z), (b, high, z + deep), cell, hidden)
        for (a, b, low, high), deep, hidden in (
            (frieze, 0.42, "-z +y"),
            (moulding, 0.45, "-z +y"),
            (shelf, 0.49, "-z"),
        )
    ]
    posts, blocks = [], []
    for x in POSTS:
        at = (x, 0, z + 0.29)
        posts.append(moved(turned(_POST, fine.turns(12)), at))
        blocks.append(moved(block((-0.09, _HEARTH_HIGH, -0.09), (0.09, _POST[0][1], 0.09), cell, "-y"), at))
        blocks.append(moved(block((-0.09, _POST[-1][1], -0.09), (0.09, _FRIEZE, 0.09), cell, "+y"), at))
    return [
        Part("chimney", "plaster", np.concatenate(breast)),
        Part("hearth", "stone", hearth),
        Part("mantel", "marble", np.concatenate(stone)),
        Part("posts", "marble", np.concatenate(posts)),
        Part("post-blocks", "marble", np.concatenate(blocks)),
        *_brickwork(),
        *_firebox(fine),
    ]


def _post() -> Profile:
    """Return the profile of a column with base, entasis and capital, from its plinth to its abacus."""
    low, high = _HEARTH_HIGH + 0.05, _FRIEZE - 0.04
    ring = [(0.078, 0.0), (0.088, 0.01), (0.088, 0.024), (0.066, 0.042), (0.074, 0.054), (0.06, 0.066)]
    shaft = [(0.061, 0.25), (0.0605, 0.44), (0.056, 0.62), (0.049, high - low - 0.11)]
    cap = [(0.058, 0.1), (0.05, 0.08), (0.05, 0.06), (0.062, 0.045), (0.082, 0.015), (0.082, 0.0)]
    return [(r, low + y) for r, y in ring + shaft] + [(r, high - y) for r, y in cap]


_POST = _post()


def _brickwork() -> Piece:
    """Return bricks in running bond around the opening, which stand out a little from the mortar."""
    z = _BREAST_DEEP
    tones: list[list[Float64]] = [[], [], []]
    mortar = []
    left, right = _BRICKWORK
    for row in range(_ROWS):
        low = _HEARTH_HIGH + row * _ROW
        high = low + _ROW
        beside = row < _ROWS_OF_OPENING
        runs = [(left, _OPENING[0]), (_OPENING[1], right)] if beside else [(left, right)]
        joint = high - _MORTAR  # the mortar of a row is above it
        for number, (a, b) in enumerate(runs):
            edges = a + _BRICK * (np.arange(1, 9) - 0.5 * (row % 2))
            if number == 1:
                edges = np.sort(a + b - edges) + _MORTAR  # mirrored, so that both sides of the opening are equal
            edges = edges[(edges > a + 0.04) & (edges < b - 0.02)]
            starts, stops = [a, *edges], [*(edges - _MORTAR), b]
            for i, (x0, x1) in enumerate(zip(starts, stops, strict=True)):
                tone = (3 * row + 5 * i + 2 * number + row * i // 3) % 3
                tones[tone].append(block((x0, low, z), (x1, joint, z + _PROUD), without="-z" if row else "-z -y"))
            joints = [(x - _MORTAR, x, low, joint) for x in edges]
            for x0, x1, y0, y1 in [*joints, (a, b, joint, high)]:
                mortar.append(patch([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], 0.3))
    names = ("brick-red", "brick-light", "brick-dark")
    bricks = [Part(name, name, np.concatenate(found)) for name, found in zip(names, tones, strict=True)]
    return [*bricks, Part("mortar", "mortar", np.concatenate(mortar))]


def _firebox(fine: Fineness) -> Piece:
    """Return the hollow behind the opening, narrower at its back, and a fire of two logs on embers."""
    cell = fine.cell(0.24)
    front, back = _BREAST_DEEP, 0.08
    (a, b), (c, d) = _OPENING, (MIDDLE - 0.36, MIDDLE + 0.36)
    low, high, under = _HEARTH_HIGH, _LINTEL, _LINTEL - 0.12
    hollow = [
        patch([(a, low, front), (b, low, front), (d, low, back), (c, low, back)], cell),
        patch([(c, low, back), (d, low, back), (d, under, back), (c, under, back)], cell),
        patch([(a, low, front), (c, low, back), (c, under, back), (a, high, front)], cell),
        patch([(d, low, back), (b, low, front), (b, high, front), (d, under, back)], cell),
        patch([(a, high, front), (c, under, back), (d, under, back), (b, high, front)], cell),
    ]
    bed = moved(block((-0.25, 0, -0.1), (0.25, 0.04, 0.1), fine.cell(0.2), "-y"), (MIDDLE, low, 0.3))
    log: Profile = [(0, -0.29), (0.04, -0.285), (0.046, -0.1), (0.043, 0.12), (0.045, 0.285), (0, 0.29)]
    lying = moved(turned(log, fine.turns(8)), roll=90)
    logs = [moved(lying, (MIDDLE + x, low + 0.04 + 0.046 + y, z), turn=t)
            for x, y, z, t in ((0, 0, 0.26, 4), (0.01, 0, 0.355, -5), (-0.02, 0.078, 0.31, 14))]  # fmt: skip
    return [
        Part("firebox", "soot", np.concatenate(hollow)),
        Part("embers", "ember", bed, _FIRE),
        Part("logs", "log", np.concatenate(logs)),
    ]


# Furniture and ornaments


def _rug(fine: Fineness) -> Piece:
    """Return a rug with a border between two lines, and lozenges in its field."""
    x0, x1, z0, z1 = _RUG
    high, cell = 0.012, fine.cell(0.42)
    insets = [0.0, 0.07, 0.1, 0.26, 0.29]
    bands = ["rug-red", "rug-cream", "rug-blue", "rug-cream", "rug-red"]
    xs = lines(x0, x1, cell, [x for d in insets for x in (x0 + d, x1 - d)])
    zs = lines(z0, z1, cell, [z for d in insets for z in (z0 + d, z1 - d)])
    parts = []
    for colour in ("rug-red", "rug-cream", "rug-blue"):

        def keep(z: Float64, x: Float64, colour: str = colour) -> NDArray[np.bool_]:
            depth = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(z - z0, z1 - z))
            return np.asarray(np.array(bands)[np.searchsorted(insets, depth) - 1] == colour)

        parts.append(Part(colour, colour, sheet((0, high, 0), (0, 0, 1), (1, 0, 0), zs, xs, keep)))
    edge = block((x0, 0, z0), (x1, high, z1), fine.cell(0.4), "-y +y")
    return [*parts, Part("rug-edge", "rug-red", edge)]


def _furniture(fine: Fineness) -> Piece:
    rug = 0.012
    books = [f"book-{colour}" for colour in ("red", "green", "blue", "brown", "cream", "ochre")]
    case = furniture.bookcase(fine, _BOOKCASE[1] - _BOOKCASE[0], _BOOKCASE_HIGH, books, 3)
    coffee = furniture.table(fine, 1.05, 0.6, 0.42)
    parts = [
        *placed(furniture.sofa(fine, 2.15, 3, "teal", "mustard"), (5.5, 0, 2.85), -90, "sofa"),
        *placed(furniture.sofa(fine, 0.92, 1, "rust", "teal"), (1.6, 0, 1.95), 62, "armchair"),
        *placed(furniture.table(fine, 1.0, 1.75), (1.95, 0, 4.35), 0, "table"),
        *placed(coffee, (3.65, rug, 2.6), 90, "coffee-table"),
        *placed(furniture.pedestal_table(fine), (5.72, 0, 1.42), 0, "side-table"),
        *_hung(case, "left", D - _BOOKCASE[1], 0, name="bookcase"),
    ]
    for i, (x, z, turn) in enumerate(((2.7, 3.98, -97), (2.75, 4.8, -78), (1.22, 4.3, 92))):
        parts += placed(furniture.chair(fine), (x, 0, z), turn, f"chair-{i}")
    return parts


def _ornaments(fine: Fineness) -> Piece:
    """Return the ornaments on the tables and the mantel."""
    shelf = _BREAST_DEEP + 0.27
    return [
        *placed(furniture.candlestick(fine), (MIDDLE - 0.92, _MANTEL, shelf), 0, "candlestick-left"),
        *placed(furniture.candlestick(fine), (MIDDLE + 0.92, _MANTEL, shelf), 0, "candlestick-right"),
        *placed(furniture.clock(fine), (MIDDLE, _MANTEL, shelf), 0, "clock"),
        *placed(furniture.vase(fine, "celadon", 0.22, 0.085, 0.03), (MIDDLE + 0.52, _MANTEL, shelf), 0, "jar"),
        *placed(furniture.vase(fine, "glaze", 0.34, 0.11, 0.04), (1.95, 0.75, 4.0), 0, "tall"),
        *placed(furniture.bowl(fine, "porcelain", 0.16, ["apple", "pear", "apple"]), (1.98, 0.75, 4.55)),
        *placed(furniture.bowl(fine, "celadon", 0.13, []), (3.6, 0.432, 2.5), 0, "coffee-table"),
    ]


_HILLS: tuple[tuple[str, Profile], ...] = (
    ("meadow", [(0, 0.26), (0.2, 0.2), (0.45, 0.1), (0.7, 0.08), (1, 0.14)]),
    ("field", [(0, 0.34), (0.25, 0.3), (0.55, 0.2), (0.8, 0.22), (1, 0.28)]),
    ("hills", [(0, 0.44), (0.2, 0.5), (0.4, 0.38), (0.65, 0.32), (0.85, 0.42), (1, 0.4)]),
    ("far-hills", [(0, 0.56), (0.15, 0.54), (0.35, 0.62), (0.55, 0.52), (0.75, 0.6), (1, 0.52)]),
    ("dusk", [(0, 0.74), (0.3, 0.72), (0.6, 0.74), (1, 0.71)]),
    ("sky", [(0, 1), (1, 1)]),
)
_SHORE: tuple[tuple[str, Profile], ...] = (
    ("sand", [(0, 0.16), (0.4, 0.22), (1, 0.1)]),
    ("sea", [(0, 0.46), (1, 0.46)]),
    ("dusk", [(0, 0.6), (1, 0.62)]),
    ("sky", [(0, 1), (1, 1)]),
)
#: For each picture: wall, position of its middle along the wall and upwards, width and height with the frame.
_PICTURES = {
    "landscape": ("chimney", MIDDLE, 2.03, 1.3, 0.86),
    "shore": ("right", 2.35, 1.62, 0.62, 0.78),
    "hills": ("right", 3.75, 1.62, 0.62, 0.78),
    "dusk": ("back", 1.865, 1.6, 0.4, 0.52),
    "sea": ("back", W - 1.865, 1.6, 0.4, 0.52),
}


def _pictures(fine: Fineness) -> Piece:
    shown = {"landscape": _HILLS, "shore": _SHORE, "hills": _HILLS[2:], "dusk": _HILLS[4:], "sea": _SHORE[1:]}
    parts = []
    for name, (wall, along, up, width, height) in _PICTURES.items():
        piece = furniture.picture(fine, width, height, "gilt" if name == "landscape" else "walnut", shown[name])
        out = _BREAST_DEEP if wall == "chimney" else 0.0
        parts += _hung(piece, "back" if wall == "chimney" else wall, along, up, out, f"picture-{name}")
    return parts


# Light, W sr^-1 m^-2

_LIGHT_SIDE = 0.56
_LIGHTS = ((2.2, 2.9), (4.4, 2.9))
_CEILING_LIGHT = (48.0, 41.0, 30.0)
_TORCHERE = (110.0, 87.0, 55.0)
_SHADE = (10.0, 7.0, 3.6)
_FIRE = (11.0, 3.6, 0.6)


def _lamps(fine: Fineness) -> Piece:
    parts = placed(furniture.torchere(fine, _TORCHERE), (0.27, 0, 0.3), 0, "torchere")
    parts += placed(furniture.table_lamp(fine, _SHADE), (5.72, 0.58, 1.42), 0, "table-lamp")
    for i, (x, z) in enumerate(_LIGHTS):
        parts += placed(
            furniture.ceiling_light(fine, _LIGHT_SIDE, _CEILING_LIGHT), (x, H, z), 0, f"ceiling-light-{i}"
        )
    return parts
