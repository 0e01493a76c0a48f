"""Slow, obvious horizons of height fields, and a rough field."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from glpath.apps.terrain.height_field import HeightField


def rough(rows: int, columns: int, size: float = 3.0, seed: int = 7) -> NDArray[np.float32]:
    """Hills under noise, so that horizons are near and far."""
    rng = np.random.default_rng(seed)
    r, c = np.mgrid[:rows, :columns]
    hills = np.sin(0.31 * c + 1) * np.cos(0.23 * r) + 0.5 * np.sin(0.11 * (c + 2 * r))
    return (size * hills + 0.2 * size * rng.random((rows, columns))).astype(np.float32)


def march(field: HeightField, column: float, row: float, azimuth: float, z: float | None = None) -> float:
    """The tangent of the horizon, 0 or more: over all places where the ray's plan crosses an edge of a triangle."""
    rows, columns = field.shape
    gx, gy = math.sin(azimuth) / field.spacing[0], -math.cos(azimuth) / field.spacing[1]
    where: list[float] = []
    for start, rate, low, high in (
        (column, gx, 0, columns - 1),
        (row, gy, 0, rows - 1),
        (column - row, gx - gy, 1 - rows, columns - 1),
    ):
        if abs(rate) > 1e-12:
            where += [(line - start) / rate for line in range(low, high + 1)]
    at = np.array([t for t in where if t > 1e-6 / max(abs(gx), abs(gy))])
    x, y = column + gx * at, row + gy * at
    inside = (x > -1e-9) & (x < columns - 1 + 1e-9) & (y > -1e-9) & (y < rows - 1 + 1e-9)
    if not inside.any():
        return 0.0
    positions = np.column_stack([x, y])[inside] * (field.spacing[0], -field.spacing[1]) + field.origin
    here = z
    if here is None:
        here = float(field.heights[round(row), round(column)])
    return max(0.0, float(((field.heights_at(positions) - here) / at[inside]).max()))
