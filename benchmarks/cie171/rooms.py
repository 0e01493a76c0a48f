"""Parts of the scenes: black walls with openings, and the points that several cases use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from benchmarks.cie171.exact import Float64, Rectangle

UP, DOWN, NORTH, SOUTH = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]
#: Width, depth and height of most cases' room, in metres; one corner is the origin. Openings are in the ceiling,
#: or in the wall at y = 0.
ROOM = (4.0, 4.0, 3.0)
#: Positions of points in the middle plane x = 2: heights of A to F, and depths of eight points along the room.
HEIGHTS, DEPTHS = np.arange(2.75, 0.0, -0.5), np.arange(0.25, 4.0, 0.5)

Shape = dict[str, Any]


def scene(shapes: Sequence[Shape], lights: Sequence[Shape] = (), **fields: Any) -> dict[str, Any]:
    """Return the description of a scene in lumens and metres, with z up."""
    described = {
        "unit": "photometric",
        "camera": {"position": [2, -9, 2], "target": [2, 2, 1], "up": UP},
        "materials": {"black": {"reflectance": 0}},
        "shapes": list(shapes),
        "lights": list(lights),
    }
    return described | fields


def quad(at: Rectangle, material: str = "black", **fields: Any) -> Shape:
    """Return a quad; its front faces the cross product of the first and the second edge."""
    return {"type": "quad", "corners": at.corners.tolist(), "material": material, **fields}


def walls(size: Sequence[float] = ROOM, without: Sequence[str] = (), material: str = "black") -> list[Shape]:
    """Return the walls of a room, all of which face inwards; one corner is the origin."""
    x, y, z = np.diag(np.asarray(size, np.float64))
    every = {
        "floor": (0 * x, [x, y]),
        "ceiling": (z, [y, x]),
        "south": (0 * x, [z, x]),
        "north": (y, [x, z]),
        "west": (0 * x, [y, z]),
        "east": (x, [z, y]),
    }
    return [quad(Rectangle.of(*at), material) for name, at in every.items() if name not in without]


def around(wall: Rectangle, hole: tuple[float, float, float, float]) -> list[Shape]:
    """Return a black wall with a hole, whose start and end along each edge are fractions of the edge."""
    a, b = wall.edges
    a0, a1, b0, b1 = hole
    parts = [(0, a0, 0, 1), (a1, 1, 0, 1), (a0, a1, 0, b0), (a0, a1, b1, 1)]
    return [
        quad(Rectangle.of(wall.corner + s0 * a + t0 * b, [(s1 - s0) * a, (t1 - t0) * b]))
        for s0, s1, t0, t1 in parts
        if s1 - s0 > 1e-9 and t1 - t0 > 1e-9
    ]


def upright(y: float = 0.0, heights: ArrayLike = HEIGHTS) -> Float64:
    """Return (N, 3) points on a wall."""
    return np.array([[2.0, y, z] for z in np.asarray(heights)])


def level(z: float = 0.0, depths: ArrayLike = DEPTHS) -> Float64:
    """Return (N, 3) points on the floor or the ceiling."""
    return np.array([[2.0, y, z] for y in np.asarray(depths)])


def facing(*groups: tuple[Float64, Sequence[float]]) -> tuple[Float64, Float64]:
    """Concatenate groups of points; return the points and their normals. Each group has one normal."""
    points = np.concatenate([points for points, _ in groups])
    return points, np.concatenate([np.broadcast_to(normal, each.shape) for each, normal in groups])


def letters(first: str, count: int, mark: str = "") -> tuple[str, ...]:
    """Return names of points: successive letters."""
    return tuple(chr(ord(first) + k) + mark for k in range(count))


def surface_grid(size: Sequence[float], n: int) -> tuple[Float64, Float64, Float64]:
    """Return Gauss-Legendre points on all surfaces of a room, their normals, and their weights, which are areas."""
    u, w = leggauss(n)
    s, t = (each.ravel() for each in np.meshgrid((u + 1) / 2, (u + 1) / 2))
    weight = np.outer(w, w).ravel() / 4
    points, normals, weights = [], [], []
    for axis in range(3):
        for side in (0, 1):
            at = np.empty((n * n, 3))
            others = [k for k in range(3) if k != axis]
            at[:, others[0]], at[:, others[1]] = s * size[others[0]], t * size[others[1]]
            at[:, axis] = side * size[axis]
            points.append(at)
            normals.append(np.broadcast_to((1 - 2 * side) * np.eye(3)[axis], at.shape))
            weights.append(weight * size[others[0]] * size[others[1]])
    return np.concatenate(points), np.concatenate(normals), np.concatenate(weights)
