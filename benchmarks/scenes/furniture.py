"""Furniture in triangles: seats, tables, shelves with books, lamps and ornaments.

Every piece stands on y = 0 around the y axis, with its front towards +z, in metres. It is a list of `Part`s,
several of which may have the same material. `solids` says which faces are omitted if one thing stands on another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.scenes.solids import (
    Profile,
    arc,
    block,
    cushion,
    framed,
    lines,
    moved,
    patch,
    sheared,
    sheet,
    turned,
)
from glpath.scene.model import Float64
from glpath.scene.tessellate import sphere


@dataclass(frozen=True)
class Part:
    """Triangles of one material, which become a shape of the scene.

    corners  : (T, 3, 3) float64
    emission : radiance, W sr^-1 m^-2
    """

    name: str
    material: str
    corners: Float64
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)


Piece = list[Part]


@dataclass(frozen=True)
class Fineness:
    """Fineness of the triangles: `factor` times finer than by default, along every direction."""

    factor: float = 1.0

    def cell(self, length: float) -> float:
        return length / self.factor

    def turns(self, segments: int) -> int:
        """Return an even number of segments around."""
        return max(4, 2 * round(segments * self.factor / 2))

    def steps(self, number: int) -> int:
        """Return an even number of parts of a curve."""
        return max(2, 2 * round(number * self.factor / 2))


def placed(piece: Piece, by: ArrayLike, turn: float = 0.0, name: str = "") -> Piece:
    """Turn the piece around the y axis, in degrees, then move it; prefix the names of its parts with `name`."""
    prefix = f"{name}-" if name else ""
    return [replace(p, name=prefix + p.name, corners=moved(p.corners, by, turn)) for p in piece]


# Seats


def sofa(fine: Fineness, width: float, seats: int, cloth: str, pillow: str) -> Piece:
    """Return a sofa of `width` x 0.92 m; with one seat it is an armchair."""
    arm, deep, foot = 0.19, 0.9, 0.1
    inside = width - 2 * arm
    cell, steps = fine.cell(0.7), fine.steps(2)
    feet = [
        moved(turned([(0.018, 0), (0.03, foot)], fine.turns(6)), (sx * (width / 2 - 0.08), 0, sz * 0.36))
        for sx in (-1, 1)
        for sz in (-1, 1)
    ]
    side = cushion((arm, 0.54, deep), 0.055, steps, cell)
    arms = [moved(side, (sx * (width - arm) / 2, foot, 0)) for sx in (-1, 1)]
    # The seat reaches a little into the arms, because their edges are round.
    base = block((-inside / 2 - 0.02, foot, -0.43), (inside / 2 + 0.02, 0.31, 0.42), cell, "-x +x")
    back = sheared(
        moved(cushion((inside + 0.02, 0.6, 0.2), 0.06, steps, cell), (0, 0.25, -0.335)), z=-0.15, level=0.3
    )
    each = inside / seats
    at = [-inside / 2 + (i + 0.5) * each for i in range(seats)]
    seat = cushion((each - 0.008, 0.17, 0.66), 0.05, steps, cell, crown=0.025)
    rest = sheared(cushion((each - 0.02, 0.42, 0.17), 0.065, steps, cell), z=-0.2)
    piece = [
        Part("feet", "walnut", np.concatenate(feet)),
        Part("frame", cloth, np.concatenate([*arms, base, back])),
        Part("cushions", cloth, np.concatenate([moved(seat, (x, 0.305, 0.115)) for x in at])),
        Part("rests", cloth, np.concatenate([moved(rest, (x, 0.475, -0.11)) for x in at])),
    ]
    soft = cushion((0.4, 0.38, 0.12), 0.055, steps, fine.cell(0.3))
    thrown = [
        moved(soft, (x, 0.505, 0.09), lean=-22, turn=t) for x, t in ((at[0] - 0.06, 14), (at[-1] + 0.07, -18))
    ]
    piece.append(Part("pillows", pillow, np.concatenate(thrown[:1] if seats == 1 else thrown)))
    return piece


def chair(fine: Fineness) -> Piece:
    """Return a chair with turned legs and a back of spindles, 0.46 x 0.44 m."""
    around, thin = fine.turns(6), fine.turns(4)
    high = 0.43
    leg = turned(_baluster(high, 0.014, 0.021, 0.026), around)
    legs = []
    for sx in (-1, 1):
        for sz in (-1, 1):
            # Each foot stands a little outside of the point where its leg meets the seat.
            legs.append(moved(sheared(leg, -0.09 * sx, -0.09 * sz, high), (sx * 0.165, 0, sz * 0.155)))
    seat = moved(cushion((0.46, 0.045, 0.44), 0.018, fine.steps(2), fine.cell(0.5)), (0, high, 0))
    top = high + 0.045
    post = turned([(0.017, top), (0.021, 0.62), (0.018, 0.9)], thin)
    spindle = turned([(0.008, top), (0.012, 0.64), (0.008, 0.9)], thin)
    upright = [moved(post, (sx * 0.19, 0, -0.185)) for sx in (-1, 1)]
    upright += [moved(spindle, (x, 0, -0.185)) for x in np.linspace(-0.125, 0.125, 5)]
    rail = block((-0.235, 0.89, -0.205), (0.235, 0.97, -0.17), fine.cell(0.3))
    rungs = [moved(turned([(0.008, -0.18), (0.013, 0), (0.008, 0.18)], thin), (sx * 0.19, 0.17, 0), lean=90)
             for sx in (-1, 1)]  # fmt: skip
    rungs.append(moved(turned([(0.008, -0.19), (0.013, 0), (0.008, 0.19)], thin), (0, 0.17, 0), roll=90))
    return [
        Part("legs", "walnut", np.concatenate([*legs, *rungs])),
        Part("seat", "seat", seat),
        Part("back", "walnut", sheared(np.concatenate([*upright, rail]), z=-0.2, level=top)),
    ]


def _baluster(height: float, foot: float, neck: float, swell: float) -> Profile:
    """Return the profile of a turned leg, open at both ends."""
    h = height
    return [
        (foot, 0),
        (neck, 0.1 * h),
        (neck * 0.8, 0.16 * h),
        (swell, 0.4 * h),
        (neck * 0.75, 0.6 * h),
        (neck, h),
    ]


# Tables


def table(fine: Fineness, width: float, depth: float, height: float = 0.75) -> Piece:
    """Return a table on four turned legs, with an apron below its top."""
    thick, head, tall = 0.035, 0.075, 0.15
    under = height - thick
    cell = fine.cell(0.8)
    x, z = width / 2 - 0.1, depth / 2 - 0.1
    leg = np.concatenate(
        [
            turned(_baluster(under - tall, 0.024, 0.034, 0.044), fine.turns(8)),
            block((-head / 2, under - tall, -head / 2), (head / 2, under, head / 2), cell, "+y"),
        ]
    )
    legs = [moved(leg, (sx * x, 0, sz * z)) for sx in (-1, 1) for sz in (-1, 1)]
    low, rim = under - 0.1, 0.012
    aprons = [
        block((head / 2 - x, low, s * z - rim), (x - head / 2, under, s * z + rim), cell, "+y -x +x")
        for s in (-1, 1)
    ]
    aprons += [
        block((s * x - rim, low, head / 2 - z), (s * x + rim, under, z - head / 2), cell, "+y -z +z")
        for s in (-1, 1)
    ]
    top = block((-width / 2, under, -depth / 2), (width / 2, height, depth / 2), cell)
    return [Part("legs", "walnut", np.concatenate([*legs, *aprons])), Part("top", "oak", top)]


def pedestal_table(fine: Fineness, height: float = 0.58) -> Piece:
    """Return a round table on one turned post."""
    h = height
    profile: Profile = [
        (0.15, 0), (0.15, 0.012), (0.06, 0.04), (0.022, 0.1), *arc((0.022, 0.12), (0.022, 0.34), 0.1, 3),
        (0.03, 0.36), (0.018, 0.39), (0.018, h - 0.06), (0.24, h - 0.024), (0.25, h), (0.12, h), (0, h),
    ]  # fmt: skip
    return [Part("body", "walnut", turned(profile, fine.turns(12)))]


# Shelves


def bookcase(fine: Fineness, width: float, height: float, colours: Sequence[str], seed: int) -> Piece:
    """Return a bookcase of two bays against a wall: x from 0 to width, its back in the plane z = 0 of the wall."""
    deep, side, board, backing = 0.32, 0.03, 0.022, 0.012
    cell = fine.cell(0.6)
    levels = [0.1 + i * (height - side - 0.1) / 5 for i in range(5)]
    uprights = [(0.0, side), ((width - side) / 2, (width + side) / 2), (width - side, width)]
    under = height - side
    wood = [block((a, 0, 0), (b, under, deep), cell, "-y +y -z") for a, b in uprights]
    wood.append(block((0, under, 0), (width, height, deep), cell, "-z"))
    rng = np.random.default_rng(seed)
    books: dict[str, list[Float64]] = {colour: [] for colour in colours}
    for (_, x0), (x1, _) in pairwise(uprights):
        wood.append(
            sheet((0, 0, deep - 0.03), (1, 0, 0), (0, 1, 0), lines(x0, x1, cell), lines(0, levels[0], cell))
        )
        for low, high in pairwise([*levels, under]):
            wood.append(block((x0, low, backing), (x1, low + board, deep - 0.008), cell, "-x +x -z"))
            us, vs = lines(x0, x1, cell), lines(low + board, high, cell)
            wood.append(sheet((0, 0, backing), (1, 0, 0), (0, 1, 0), us, vs))
            for colour, corners in _row_of_books(rng, x0, x1, low + board, high, deep, colours):
                books[colour].append(corners)
    piece = [Part("wood", "oak-dark", np.concatenate(wood))]
    return piece + [Part(colour, colour, np.concatenate(found)) for colour, found in books.items() if found]


def _row_of_books(
    rng: np.random.Generator, x0: float, x1: float, low: float, high: float, deep: float, colours: Sequence[str]
) -> list[tuple[str, Float64]]:
    """Return books side by side from the left, in runs of one series; the row ends at random before `x1`."""
    found: list[tuple[str, Float64]] = []
    x, end = x0 + 0.006, x0 + (x1 - x0) * rng.uniform(0.45, 0.9)
    while x < end:
        colour = colours[int(rng.integers(len(colours)))]
        tall, wide, out = rng.uniform(0.58, 0.86) * (high - low), rng.uniform(0.04, 0.08), rng.uniform(0.17, 0.23)
        for _ in range(rng.integers(1, 4)):
            wider = wide * rng.uniform(0.9, 1.1)
            if x + wider > end:
                return found
            front = deep - 0.025 - rng.uniform(0, 0.025)
            found.append((colour, block((x, low, front - out), (x + wider, low + tall, front), without="-y")))
            x += wider + 0.002
    return found


# Ornaments


def vase(fine: Fineness, material: str, height: float, belly: float, neck: float, segments: int = 10) -> Piece:
    """Return a vase, open at its mouth; belly and neck are radii."""
    h, wall = height, 0.006
    outer = [
        (0.55 * belly, 0), (0.6 * belly, 0.02 * h),
        *arc((0.6 * belly, 0.04 * h), (0.75 * belly, 0.62 * h), 0.55 * belly / h, fine.steps(4)),
        *arc((0.73 * belly, 0.64 * h), (neck, 0.86 * h), -0.1, fine.steps(2)),
        (1.35 * neck, 0.98 * h), (1.35 * neck, h),
    ]  # fmt: skip
    inner = [(1.35 * neck - wall, h), (neck - wall, 0.86 * h), (0.7 * belly, 0.6 * h), (0.5 * belly, 0.1 * h),
             (0, 0.08 * h)]  # fmt: skip
    return [Part("vase", material, turned(outer + inner, fine.turns(segments)))]


def bowl(fine: Fineness, material: str, radius: float, fruit: Sequence[str]) -> Piece:
    """Return a shallow bowl with a few fruits."""
    h = 0.42 * radius
    profile = [
        (0.35 * radius, 0), (0.32 * radius, 0.1 * h),
        *arc((0.36 * radius, 0.12 * h), (radius, h), 0.16, fine.steps(4)),
        *arc((radius - 0.007, h), (0.3 * radius, 0.24 * h), -0.13, fine.steps(2)), (0, 0.2 * h),
    ]  # fmt: skip
    piece = [Part("bowl", material, turned(profile, fine.turns(12)))]
    size = 0.3 * radius
    for i, kind in enumerate(fruit):
        angle, away = 2 * np.pi * i / max(1, len(fruit) - 1), 0.42 * radius * (i < len(fruit) - 1 or i == 0)
        y = 0.36 * h + size + (0 if away else 1.1 * size)
        vertices, faces = sphere(
            (away * np.cos(angle), y, away * np.sin(angle)), size, 1 if fine.factor < 1.5 else 2
        )
        piece.append(Part(f"fruit-{i}", kind, vertices[faces]))
    return piece


def candlestick(fine: Fineness, height: float = 0.24) -> Piece:
    """Return a candlestick with a candle."""
    h = height
    profile: Profile = [
        (0.055, 0), (0.055, 0.008), (0.03, 0.022), (0.012, 0.05), (0.02, 0.06),
        *arc((0.011, 0.075), (0.011, 0.6 * h), 0.09, 3), (0.02, 0.64 * h), (0.01, h - 0.05),
        (0.028, h - 0.02), (0.03, h), (0.0105, h),
    ]  # fmt: skip
    candle = [(0.0105, h), (0.0105, h + 0.17), (0.004, h + 0.178), (0, h + 0.178)]
    return [
        Part("stick", "brass", turned(profile, fine.turns(6))),
        Part("candle", "wax", turned(candle, fine.turns(6))),
    ]


def clock(fine: Fineness) -> Piece:
    """Return a mantel clock: a case with a round dial."""
    case = block((-0.1, 0.03, -0.05), (0.1, 0.27, 0.05), fine.cell(0.3), "-y +y")
    foot = block((-0.125, 0, -0.065), (0.125, 0.03, 0.065), fine.cell(0.3), "-y")
    roof = moved(turned([(0.12 * np.sqrt(2), 0.27), (0.1 * np.sqrt(2), 0.29), (0, 0.34)], 4), turn=45)
    ring = [(0.072, 0), (0.072, 0.008), (0.062, 0.01), (0.062, 0.004)]
    around = fine.turns(14)
    rim = moved(turned(ring, around), (0, 0.16, 0.05), lean=90)
    dial = moved(turned([(0.062, 0.004), (0, 0.004)], around), (0, 0.16, 0.05), lean=90)
    bottom = patch([(-0.12, 0.27, 0.12), (-0.12, 0.27, -0.12), (0.12, 0.27, -0.12), (0.12, 0.27, 0.12)])
    return [
        Part("case", "walnut", np.concatenate([case, foot, roof * (1, 1, 0.55), bottom * (1, 1, 0.55)])),
        Part("rim", "brass", rim),
        Part("dial", "porcelain", dial),
    ]


# Lamps


def torchere(fine: Fineness, radiance: tuple[float, float, float], height: float = 1.78) -> Piece:
    """Return a standing lamp that lights the ceiling; its bowl hides the light from the room."""
    h, glow = height, 0.14
    profile: Profile = [
        (0.15, 0), (0.15, 0.014), (0.05, 0.03), (0.016, 0.06), (0.013, 0.3), (0.022, 0.32), (0.013, 0.34),
        (0.013, 0.75), (0.013, 1.2), (0.02, 1.22), (0.013, 1.24), (0.013, h - 0.16),
        *arc((0.02, h - 0.17), (0.22, h), 0.16, 4), (0.214, h), (glow, h - 0.06),
    ]  # fmt: skip
    around = fine.turns(10)
    disc = turned([(glow, h - 0.06), (0, h - 0.06)], around)
    return [Part("stand", "brass", turned(profile, around)), Part("light", "lamp", disc, radiance)]


def table_lamp(fine: Fineness, radiance: tuple[float, float, float]) -> Piece:
    """Return a lamp with a glowing shade."""
    around = fine.turns(12)
    foot: Profile = [
        (0.07, 0), (0.07, 0.012), *arc((0.05, 0.02), (0.03, 0.22), 0.3, fine.steps(4)), (0.012, 0.24),
        (0.012, 0.29),
    ]  # fmt: skip
    shade = [(0.012, 0.29), (0.17, 0.29), (0.145, 0.37), (0.115, 0.5), (0, 0.5)]
    return [Part("foot", "glaze", turned(foot, around)), Part("light", "lamp", turned(shade, around), radiance)]


def ceiling_light(fine: Fineness, side: float, radiance: tuple[float, float, float]) -> Piece:
    """Return a square fitting that hangs down from y = 0: a rim around the light."""
    profile: Profile = [(0, 0), (0, 0.07), (0.02, 0.085), (0.05, 0.085), (0.06, 0.06)]
    rim = framed(side, side, profile, fine.cell(0.6))
    half = side / 2 - 0.06
    pane = patch(
        [(-half, -half, 0.06), (half, -half, 0.06), (half, half, 0.06), (-half, half, 0.06)], fine.cell(0.25)
    )
    return [Part("rim", "brass", moved(rim, lean=90)), Part("light", "lamp", moved(pane, lean=90), radiance)]


# On walls: seen from the front around the origin of the xy plane, the wall at z = 0


def picture(fine: Fineness, width: float, height: float, frame: str, bands: Sequence[tuple[str, Profile]]) -> Piece:
    """A framed picture of bands one above the other.

    bands : from below, the material of each and the line (x, y) that it reaches up to, from (0, .) to (1, .) of the
            picture; the last one reaches its top, whatever its line
    """
    rim = 0.07
    profile: Profile = [(0, 0), (0, 0.03), (0.03, 0.042), (rim, 0.012)]
    piece = [Part("frame", frame, framed(width, height, profile, fine.cell(0.45)))]
    w, h = width - 2 * rim, height - 2 * rim
    xs = np.unique(np.concatenate([lines(0, 1, fine.cell(0.6) / w), *(np.array(line)[:, 0] for _, line in bands)]))
    below = np.zeros(len(xs))
    for i, (material, line) in enumerate(bands):
        level = np.ones(len(xs)) if i == len(bands) - 1 else np.interp(xs, *np.array(line).T)
        strips = [
            patch([(a, b0, 0), (c, d0, 0), (c, d1, 0), (a, b1, 0)], fine.cell(0.4) / h)
            for (a, c), (b0, d0), (b1, d1) in zip(pairwise(xs), pairwise(below), pairwise(level), strict=True)
        ]
        corners = (np.concatenate(strips) - (0.5, 0.5, 0)) * (w, h, 1) + (0, 0, 0.012)
        piece.append(Part(f"{i}-{material}", material, corners))
        below = level
    return piece
