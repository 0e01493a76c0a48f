"""Points and lines as meshes that can be lit: small balls, and rods with balls at their ends.

They are made only for files without triangles, such as point clouds and line drawings. In files with triangles,
points and lines are marks of a program, and are left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.scene.tessellate import unit_sphere
from glpath.system.bounded_reading import without_bounds

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

# Radius of lines, as a fraction of the bounding box's diagonal.
_LINE = 0.004
# Minimum radius of points, as a fraction of the bounding box's diagonal.
_MIN_POINT = 0.0005
# Maximum radius of points, as a fraction of the bounding box's diagonal.
_MAX_POINT = 0.02
# Number of points above which each ball has only 20 triangles.
_MANY = 2_000
# Number of points above which each ball has only 8 triangles, and of lines above which each rod has only 8.
_VERY_MANY = 20_000

_OCTAHEDRON_VERTICES = np.concatenate([np.eye(3), -np.eye(3)])
# The sign of a corner on each axis; an odd number of minus signs swaps two corners, so that all fronts are outside.
_OCTAHEDRON_FACES = np.array(
    [(x, z, y) if (x + y + z) % 2 == 0 else (x, y, z) for x in (0, 3) for y in (1, 4) for z in (2, 5)]
)


def point_radius(points: Float64) -> float:
    """Return half the median nearest-neighbour distance of points (N, 3), within `_MIN_POINT` and `_MAX_POINT`."""
    with without_bounds():
        from scipy.spatial import cKDTree  # late, because the import is slow

    diagonal = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    if len(points) < 2 or diagonal == 0.0:
        return 0.01
    # Points at one position, such as corners that faces do not share, count once.
    cells = np.floor((points - points.min(axis=0)) / (_MIN_POINT * diagonal)).astype(np.int64)
    side = int(cells.max()) + 1
    points = points[np.unique(cells @ [side * side, side, 1], return_index=True)[1]]
    some = points[:: -(-len(points) // 10_000)]
    apart = cKDTree(points).query(some, 2)[0][:, 1]
    return float(np.clip(0.5 * np.median(apart), _MIN_POINT * diagonal, _MAX_POINT * diagonal))


def line_radius(points: Float64) -> float:
    """Return the radius of lines for the bounding box of all points (N, 3)."""
    return _LINE * float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))


def used_points(count: int, indices: Int64) -> NDArray[np.intp]:
    """Return the sorted unique values of indices below `count`; faster than `np.unique` for millions of indices."""
    is_used = np.zeros(count, np.bool_)
    is_used[indices] = True
    return np.flatnonzero(is_used)


def ball_triangles(count: int) -> int:
    """Return the number of triangles of `balls` around `count` points."""
    return count * len(_ball(count)[1])


def rod_triangles(points: Float64, lines: Int64) -> int:
    """Return the number of triangles of `rods` along lines (L, 2) between points (N, 3)."""
    long = _long_lines(points, lines)
    return 2 * _sides(len(lines)) * len(long) + ball_triangles(len(used_points(len(points), long)))


def _ball(count: int) -> tuple[Float64, Int64]:
    """Return the vertices and faces of a unit ball, which is coarser if there are many balls (`count`)."""
    if count > _VERY_MANY:
        return _OCTAHEDRON_VERTICES, _OCTAHEDRON_FACES
    sphere = unit_sphere(0 if count > _MANY else 1)
    return sphere.vertices, sphere.faces.astype(np.int64)


def _sides(count: int) -> int:
    """Return the number of sides of each of `count` rods."""
    return 4 if count > _VERY_MANY else 8


def _long_lines(points: Float64, lines: Int64) -> Int64:
    """Return the lines (L, 2) whose length is not 0."""
    return np.asarray(lines[np.linalg.norm(points[lines[:, 1]] - points[lines[:, 0]], axis=1) > 0])


def balls(points: Float64, radius: float) -> tuple[Float64, Int64, Float64, Int64]:
    """Return balls around points (N, 3).

    The result has vertices (V, 3), faces (F, 3), normals (V, 3), and the point of each vertex, (V,).
    """
    ball, sides = _ball(len(points))
    vertices = points[:, None] + radius * ball
    faces = sides + len(ball) * np.arange(len(points))[:, None, None]
    of = np.repeat(np.arange(len(points)), len(ball))
    return vertices.reshape(-1, 3), faces.reshape(-1, 3), np.tile(ball, (len(points), 1)), of


def rods(points: Float64, lines: Int64, radius: float) -> tuple[Float64, Int64, Float64, Int64]:
    """Return rods along lines (L, 2) between points (N, 3), with balls at their ends, in the form of `balls`."""
    sides = _sides(len(lines))
    lines = _long_lines(points, lines)
    start, end = points[lines[:, 0]], points[lines[:, 1]]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(sides) / sides
    out = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * np.cross(along, across)[:, None]
    vertices = np.stack([start, end], axis=1)[:, :, None] + radius * out[:, None]
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    strip = np.concatenate(
        [np.stack(each, axis=1) for each in ((k, after, after + sides), (k, after + sides, k + sides))]
    )
    faces = strip + 2 * sides * np.arange(len(lines))[:, None, None]
    used = used_points(len(points), lines)
    joints = balls(points[used], radius)
    first = vertices.size // 3
    return (
        np.concatenate([vertices.reshape(-1, 3), joints[0]]),
        np.concatenate([faces.reshape(-1, 3), joints[1] + first]),
        np.concatenate([np.broadcast_to(out[:, None], vertices.shape).reshape(-1, 3), joints[2]]),
        np.concatenate([np.repeat(lines.reshape(-1), sides), used[joints[3]]]),
    )
