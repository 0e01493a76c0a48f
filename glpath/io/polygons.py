"""Plane polygons with holes as triangles.

A polygon is cut across, at the height of each corner, into bands, and a band between its edges into trapezoids. So
holes may touch the boundary and each other, which ends of bridges between rings may not.

Poor at: corners of other polygons, which the cuts do not share; thin triangles where corners are nearly level.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from glpath.scene.geometry import Float64, Int32

# Of the extent: corners that are level.
_LEVEL = 1e-9


def polygon_normal(ring: Float64) -> Float64:
    """(3,) float64, twice the area long, out of the front of a ring (N, 3) [Newell]."""
    ring = ring - ring[0]
    return np.asarray(np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0))


def triangulated(boundary: Float64, holes: Sequence[Float64] = ()) -> tuple[Float64, Int32, float]:
    """Vertices (V, 3), faces (F, 3), and the area that is missing: boundary less holes less triangles.

    boundary : (N, 3) corners, counter-clockwise seen from the front, as the faces are
    holes    : (M, 3) corners of each, in either order, in the plane of the boundary and within it

    The missing area is not zero where rings cross each other. What has no area has no faces.
    """
    normal = polygon_normal(boundary)
    size = float(np.linalg.norm(normal))
    if size == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32), 0.0
    if not holes and _is_convex(boundary, normal):
        ahead = np.arange(1, len(boundary) - 1, dtype=np.int32)
        return boundary, np.stack([np.zeros_like(ahead), ahead, ahead + 1], axis=1), 0.0
    n = normal / size
    # Cuts across are level on a wall.
    across = np.cross([0.0, 0.0, 1.0], n) if abs(n[2]) < 0.99 else np.cross([0.0, 1.0, 0.0], n)
    across /= np.linalg.norm(across)
    frame = np.array([across, np.cross(n, across)])
    origin = boundary[0]
    rings = [(ring - origin) @ frame.T for ring in (boundary, *holes)]
    corners = _trapezoids(rings)
    vertices, faces = _faces(corners)
    wanted = 0.5 * size - sum(0.5 * float(np.linalg.norm(polygon_normal(hole))) for hole in holes)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    covered = 0.5 * float(((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum())
    return vertices @ frame + origin, faces, wanted - covered


def _is_convex(ring: Float64, normal: Float64) -> bool:
    edges = np.roll(ring, -1, axis=0) - ring
    turns = np.cross(edges, np.roll(edges, -1, axis=0)) @ normal
    return len(ring) == 3 or (len(ring) == 4 and bool((turns > 0).all()))


def _trapezoids(rings: Sequence[Float64]) -> Float64:
    """(K, 4, 2) corners, counter-clockwise; two of a triangle's are the same."""
    starts = np.concatenate(rings)
    ends = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    levels = np.unique(starts[:, 1])
    apart = _LEVEL * float(np.ptp(starts, axis=0).max())
    levels = levels[np.concatenate([[True], np.diff(levels) > apart])]
    found = []
    for low, high in pairwise(levels):
        middle = 0.5 * (low + high)
        crosses = (starts[:, 1] < middle) != (ends[:, 1] < middle)
        a, b = starts[crosses], ends[crosses]

        def at(y: float, a: Float64 = a, b: Float64 = b) -> Float64:
            return np.asarray(a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))

        order = np.argsort(at(middle), kind="stable")
        below, above = at(low)[order], at(high)[order]
        for i in range(0, len(order) - 1, 2):
            left, right = i, i + 1
            if max(below[right] - below[left], above[right] - above[left]) > apart:
                found.append([[below[left], low], [below[right], low], [above[right], high], [above[left], high]])
    return np.array(found, np.float64).reshape(-1, 4, 2)


def _faces(corners: Float64) -> tuple[Float64, Int32]:
    """Vertices (V, 2) of trapezoids, each once, and their triangles (F, 3) with an area."""
    vertices, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    quads = number.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 1.0
    return vertices, faces[doubled > _LEVEL * extent**2].astype(np.int32)
