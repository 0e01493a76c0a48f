"""Convex polyhedra as faces, computed from their planes, for drawings of shafts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.radiosity import Shaft

Float64 = NDArray[np.float64]


def box_planes(box: ArrayLike) -> Float64:
    """Return the (6, 4) planes of a box (lower corner, upper corner): outward normal and distance.

    Points x inside the box have normal . x + distance <= 0.
    """
    b = np.asarray(box, float)
    return np.column_stack([np.vstack([-np.eye(3), np.eye(3)]), np.concatenate([b[:3], -b[3:]])])


def box_corners(box: ArrayLike) -> Float64:
    """Return the (8, 3) corners of a box (lower corner, upper corner)."""
    b = np.asarray(box, float)
    return np.array([[b[x], b[y], b[z]] for x in (0, 3) for y in (1, 4) for z in (2, 5)])


def shaft_planes(shaft: Shaft) -> Float64:
    """Return (6 + P, 4) planes: the faces of the extent box, then the plane set."""
    return np.concatenate([box_planes(shaft.extent), shaft.planes])


def faces(planes: Float64) -> list[Float64]:
    """Return the face in each plane as (n, 3) corners in order around it; no corners if the plane is redundant.

    planes : (P, 4), which together bound a volume
    """
    unit = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    return [_face(unit, i) for i in range(len(unit))]


def _face(unit: Float64, i: int) -> Float64:
    """Return a large square in the plane, clipped by all other planes [Sutherland and Hodgman 1974]."""
    normal, half = unit[i, :3], 1e3
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    polygon = [-unit[i, 3] * normal + half * (x * u + y * v) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for j, plane in enumerate(unit):
        if j == i or not polygon:
            continue
        heights = [float(plane[:3] @ p + plane[3]) for p in polygon]
        cut = []
        for k, (p, h) in enumerate(zip(polygon, heights, strict=True)):
            q, g = polygon[k - 1], heights[k - 1]
            if (g <= 1e-9) != (h <= 1e-9):
                cut.append(q + (p - q) * (g / (g - h)))
            if h <= 1e-9:
                cut.append(p)
        polygon = cut
    corners = np.array(polygon).reshape(-1, 3)
    # Drop repeated corners. A plane that only touches the volume then has fewer than three corners, so no face.
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 1e-7
    corners = corners[apart]
    return corners if len(corners) >= 3 else np.zeros((0, 3))
