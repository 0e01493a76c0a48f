"""Directions and cells of a point light's shadow-buffer, slow and obvious: the twin of point_shadow_map.glsl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


def sphere_direction(row: float, column: float, rows: int, columns: int) -> Float64:
    """The unit direction of an entry's ray [TB (4), (5), as corrected]."""
    theta = ((row + 0.5) / rows - 0.5) * np.pi
    phi = (column + 0.5) / columns * 2 * np.pi
    return np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)])


def sphere_directions(rows: int, columns: int) -> Float64:
    """(rows, columns, 3)"""
    return np.array([[sphere_direction(r, c, rows, columns) for c in range(columns)] for r in range(rows)])


def sphere_cell(d: Float64, rows: int, columns: int) -> tuple[int, int]:
    """Row and column of the entry that answers for a direction [TB (7), as corrected]."""
    theta = np.arctan2(d[2], np.hypot(d[0], d[1]))
    phi = np.arctan2(d[1], d[0]) % (2 * np.pi)
    row = int((theta / np.pi + 0.5) * rows)
    return min(row, rows - 1), min(int(phi / (2 * np.pi) * columns), columns - 1)


#: For each face: the axis it looks along, and those that its columns and rows run along.
CUBE_FACES = [
    (sign * np.eye(3)[a], np.eye(3)[(a + 1) % 3], np.eye(3)[(a + 2) % 3]) for a in range(3) for sign in (1, -1)
]


def cube_directions(side: int) -> Float64:
    """(6, rows, columns, 3), unit"""
    s = np.tan(((np.arange(side) + 0.5) / side - 0.5) * np.pi / 2)
    d = np.array([[[axis + x * u + y * v for x in s] for y in s] for axis, u, v in CUBE_FACES])
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))


def cube_cell(d: Float64, side: int) -> tuple[int, int, int]:
    """Face, row and column."""
    face = int(np.argmax([d @ axis for axis, _, _ in CUBE_FACES]))
    axis, u, v = CUBE_FACES[face]
    x, y = (np.arctan2(d @ across, d @ axis) for across in (u, v))
    row, column = (int((0.5 + 2 * angle / np.pi) * side) for angle in (y, x))
    return face, min(row, side - 1), min(column, side - 1)
