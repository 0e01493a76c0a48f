"""Sheets, blocks, turned and cushioned solids as triangles, for procedural scenes.

Each function returns corners (T, 3, 3) float64, counter-clockwise from the front, with fronts outwards. A face on
which one solid stands on another is omitted (`without`, or a profile that does not start on its axis), so that no
two surfaces coincide; the open inside is not visible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.scene.model import Float64

Profile = Sequence[tuple[float, float]]

AXES = "xyz"


def lines(low: float, high: float, cell: float, cuts: Iterable[float] = ()) -> Float64:
    """Return lines that divide [low, high]: the cuts in it, and even parts between them, of at most `cell`."""
    stops = [low]
    for cut in sorted(float(c) for c in cuts if low < c < high - 1e-9):
        if cut > stops[-1] + 1e-9:
            stops.append(cut)
    stops.append(high)
    parts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / cell - 1e-9))) + 1)[:-1] for a, b in pairwise(stops)]
    return np.append(np.concatenate(parts), high)


def sheet(
    corner: ArrayLike,
    along: ArrayLike,
    across: ArrayLike,
    us: Float64,
    vs: Float64,
    keep: Callable[[Float64, Float64], NDArray[np.bool_]] | None = None,
) -> Float64:
    """Return rectangles of corner + u * along + v * across between adjacent `us` and `vs`; front: along x across.

    keep : function that says, given u (N,) and v (N,) of the rectangles' middles, which rectangles to keep
    """
    u, v = np.meshgrid(us, vs, indexing="ij")
    points = np.asarray(corner, float) + u[..., None] * np.asarray(along, float) + v[..., None] * np.asarray(across)
    quads = _quads(points)
    if keep is not None:
        middle_u, middle_v = np.meshgrid((us[:-1] + us[1:]) / 2, (vs[:-1] + vs[1:]) / 2, indexing="ij")
        quads = quads[keep(middle_u.ravel(), middle_v.ravel())]
    return _split(quads)


def patch(corners: ArrayLike, cell: float = np.inf) -> Float64:
    """Divide a flat quadrilateral, corners (4, 3) counter-clockwise from the front, into parts of about `cell`."""
    a, b, c, d = np.asarray(corners, float)
    n, m = (
        max(1, int(np.ceil(max(np.linalg.norm(p), np.linalg.norm(q)) / cell)))
        for p, q in ((b - a, c - d), (d - a, c - b))
    )
    u, v = np.linspace(0, 1, n + 1)[:, None, None], np.linspace(0, 1, m + 1)[None, :, None]
    points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    return _split(_quads(points))


def _quads(points: Float64) -> Float64:
    """Return (N, 4, 3) quads between neighbours of a grid (U, V, 3)."""
    return np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2).reshape(-1, 4, 3)


def _split(quads: Float64) -> Float64:
    """Split quads (Q, 4, 3) into (2 * Q, 3, 3) triangles along the diagonal from the first corner to the third."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def outside(rectangles: Sequence[tuple[float, float, float, float]]) -> Callable[..., NDArray[np.bool_]]:
    """Return a function for `sheet` that keeps what is in none of the rectangles (u0, u1, v0, v1)."""

    def keep(u: Float64, v: Float64) -> NDArray[np.bool_]:
        inside = np.zeros(len(u), bool)
        for u0, u1, v0, v1 in rectangles:
            inside |= (u > u0) & (u < u1) & (v > v0) & (v < v1)
        return ~inside

    return keep


def block(lower: ArrayLike, upper: ArrayLike, cell: float = np.inf, without: str = "") -> Float64:
    """Return a box along the axes, whose faces are divided so that no part exceeds `cell`.

    without : faces to omit, such as "-y +z"
    """
    low, high = np.asarray(lower, float), np.asarray(upper, float)
    assert (high > low).all(), (low, high)
    divided = [lines(low[k], high[k], cell) for k in range(3)]
    unit = np.eye(3)
    parts = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3  # i x j = k
        for sign, at, (a, b) in (("-", low, (j, i)), ("+", high, (i, j))):
            if f"{sign}{AXES[k]}" not in without.split():
                parts.append(sheet(at[k] * unit[k], unit[a], unit[b], divided[a], divided[b]))
    return np.concatenate(parts)


def skin(loops: ArrayLike) -> Float64:
    """Return the surface between loops (K, N, 3), counter-clockwise from the side of the next; fronts outwards.

    If a loop is a single point, the rectangles there become triangles: the half without area is removed.
    """
    points = np.asarray(loops, float)
    after = np.roll(points, -1, axis=1)
    quads = np.stack([points[:-1], after[:-1], after[1:], points[1:]], axis=2).reshape(-1, 4, 3)
    triangles = _split(quads)
    edges = np.roll(triangles, -1, axis=1) - triangles
    return np.asarray(triangles[(np.linalg.norm(edges, axis=2) > 1e-9).all(axis=1)])


def turned(profile: Profile, segments: int) -> Float64:
    """Return a solid of revolution around the y axis.

    profile : (radius, y) from the bottom up along the outside; the solid is closed at an end with radius 0
    """
    radius, y = np.array(profile, float).T
    angle = 2 * np.pi * np.arange(segments) / segments
    x, z = np.outer(radius, np.cos(angle)), np.outer(radius, -np.sin(angle))
    return skin(np.stack([x, np.broadcast_to(y[:, None], x.shape), z], axis=2))


def arc(
    start: tuple[float, float], end: tuple[float, float], bulge: float, steps: int
) -> list[tuple[float, float]]:
    """Return points of a profile from `start` to `end`, inclusive, that bulges to the right by `bulge` x length.

    The curve is a parabola, which approximates an arc. The right side of an upward profile is the outside.
    """
    t = np.linspace(0, 1, steps + 1)
    (r0, y0), (r1, y1) = start, end
    bow = 4 * bulge * t * (1 - t)
    r, y = r0 + t * (r1 - r0) + bow * (y1 - y0), y0 + t * (y1 - y0) - bow * (r1 - r0)
    return [(float(a), float(b)) for a, b in zip(r, y, strict=True)]


def cushion(
    size: ArrayLike, radius: float, steps: int, cell: float, crown: float = 0.0, without: str = ""
) -> Float64:
    """Return a block of `size` centred on the y axis, its bottom at 0, with edges rounded by `radius`.

    steps : number of parts of each quarter circle; even
    crown : height by which top and bottom swell in their middle
    """
    half = np.asarray(size, float) / 2
    inner = half - radius
    turn = np.tan(np.pi / 4 * np.arange(steps // 2 + 1) / (steps // 2)) * radius
    divided = [
        np.concatenate([-inner[k] - turn[::-1], lines(-inner[k], inner[k], cell)[1:-1], inner[k] + turn])
        for k in range(3)
    ]
    unit = np.eye(3)
    parts = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for sign, at, (a, b) in (("-", -half, (j, i)), ("+", half, (i, j))):
            if f"{sign}{AXES[k]}" not in without.split():
                parts.append(sheet(at[k] * unit[k], unit[a], unit[b], divided[a], divided[b]))
    points = np.concatenate(parts)
    core = np.clip(points, -inner, inner)
    away = points - core
    points = core + radius * away / np.linalg.norm(away, axis=2, keepdims=True)
    swell = np.prod(1 - np.minimum(np.abs(points[..., [0, 2]]) / half[[0, 2]], 1.0) ** 2, axis=2)
    points[..., 1] += crown * swell * points[..., 1] / half[1]
    points[..., 1] += half[1]
    return np.asarray(points)


def framed(width: float, height: float, profile: Profile, cell: float = np.inf) -> Float64:
    """Return a mitred frame around the origin of the xy plane, which faces +z.

    width, height : size of the outer edge
    profile       : (inset from the outer edge, z) from the wall over the top to the inner edge
    """
    us, vs = (lines(-size / 2, size / 2, cell) for size in (width, height))
    around = np.concatenate(
        [
            np.stack([us, np.full(len(us), -height / 2)], axis=1)[:-1],
            np.stack([np.full(len(vs), width / 2), vs], axis=1)[:-1],
            np.stack([us[::-1], np.full(len(us), height / 2)], axis=1)[:-1],
            np.stack([np.full(len(vs), -width / 2), vs[::-1]], axis=1)[:-1],
        ]
    )
    half = np.array([width, height]) / 2
    loops = [np.column_stack([around * (half - inset) / half, np.full(len(around), z)]) for inset, z in profile]
    return skin(np.stack(loops))


def moved(
    corners: Float64, by: ArrayLike = (0, 0, 0), turn: float = 0.0, lean: float = 0.0, roll: float = 0.0
) -> Float64:
    """Roll around z, lean around x, turn around y, in degrees, then shift."""
    for (i, j), angle in (((0, 1), roll), ((1, 2), lean), ((2, 0), turn)):
        if angle:
            a = np.radians(angle)
            rotation = np.eye(3)
            rotation[[i, j], [i, j]] = np.cos(a)
            rotation[i, j], rotation[j, i] = -np.sin(a), np.sin(a)
            corners = corners @ rotation.T
    return np.asarray(corners + np.asarray(by, float))


def sheared(corners: Float64, x: float = 0.0, z: float = 0.0, level: float = 0.0) -> Float64:
    """Shift each point along x and z by these amounts for every unit of its height above `level`."""
    above = corners[..., 1] - level
    return corners + np.stack([x * above, np.zeros_like(above), z * above], axis=-1)
