"""Lattice of a triangle: its edges in n equal parts, n * n elements and (n + 1)(n + 2) / 2 vertices.

A point is c0 + b1 (c1 - c0) + b2 (c2 - c0), and x = n b1, y = n b2 are its lattice coordinates. Vertex (i, j) lies
at x = i, y = j. Cell (i, j) has a lower element with the vertices (i, j), (i + 1, j), (i, j + 1). Unless it lies at
the third edge, it has an upper element with (i + 1, j + 1), (i, j + 1), (i + 1, j). Vertices and elements are
numbered row by row.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.scene.model import Float64

Int64 = NDArray[np.int64]


def element_count(n: ArrayLike) -> Int64:
    """Return the number of elements of a triangle whose edges have n parts."""
    parts = np.asarray(n, np.int64)
    return np.asarray(parts * parts)


def vertex_count(n: ArrayLike) -> Int64:
    """Return the number of vertices of a triangle whose edges have n parts."""
    parts = np.asarray(n, np.int64)
    return np.asarray((parts + 1) * (parts + 2) // 2)


def starts(counts: ArrayLike) -> Int64:
    """Return (T + 1,) start indices of each triangle's elements or vertices, followed by their total number."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, np.int64))])


def of_all(divisions: Int64, table: Callable[[int], NDArray[Any]]) -> NDArray[Any]:
    """Return the arrays `table(n)` (k, ...) of all triangles, concatenated, where n is a triangle's division.

    divisions : (T,) parts of each triangle's edges
    """
    kinds, kind = np.unique(divisions, return_inverse=True)
    tables = [table(int(n)) for n in kinds]
    first = starts(np.array([len(rows) for rows in tables], np.int64)[kind])
    sample = table(1)
    found = np.empty((first[-1], *sample.shape[1:]), sample.dtype)
    for number, rows in enumerate(tables):
        found[first[:-1][kind == number][:, None] + np.arange(len(rows))] = rows
    return found


def vertex_index(n: ArrayLike, i: ArrayLike, j: ArrayLike) -> Int64:
    """Return the index of vertex (i, j) in its triangle."""
    n, i, j = (np.asarray(a, np.int64) for a in (n, i, j))
    return np.asarray(j * (n + 1) - j * (j - 1) // 2 + i)


def element_index(n: ArrayLike, i: ArrayLike, j: ArrayLike, upper: ArrayLike) -> Int64:
    """Return the index of an element of cell (i, j) in its triangle; upper is 0 or 1."""
    n, i, j, upper = (np.asarray(a, np.int64) for a in (n, i, j, upper))
    return np.asarray(j * (2 * n - j) + 2 * i + upper)


def locate(n: ArrayLike, b1: ArrayLike, b2: ArrayLike) -> tuple[Int64, Int64, Int64, Float64, Float64]:
    """Return i, j, upper of the elements at barycentric points, and the position (fx, fy) in the cell, 0 to 1.

    Points outside the triangle are moved to the nearest element in x, then in y.
    """
    parts = np.asarray(n, np.int64)
    x, y = parts * np.clip(b1, 0.0, 1.0), parts * np.clip(b2, 0.0, 1.0)
    i = np.minimum(x.astype(np.int64), parts - 1)
    j = np.clip(y.astype(np.int64), 0, parts - 1 - i)
    fx, fy = np.clip(x - i, 0.0, 1.0), np.clip(y - j, 0.0, 1.0)
    # Cells along the third edge have no upper element.
    upper = ((fx + fy > 1) & (i + j < parts - 1)).astype(np.int64)
    beyond = np.maximum(fx + fy - 1, 0) * (upper == 0)
    return i, j, upper, fx - 0.5 * beyond, fy - 0.5 * beyond


@lru_cache(maxsize=64)
def vertex_barycentrics(n: int) -> Float64:
    """Return (V, 2), b1 and b2 of the vertices in order, as a read-only array."""
    length = n + 1 - np.arange(n + 1)  # number of vertices in each row
    j = np.repeat(np.arange(n + 1), length)
    i = np.arange(len(j)) - np.repeat(np.cumsum(length) - length, length)
    corners = np.stack([i, j], axis=1) / n
    corners.flags.writeable = False
    return corners


@lru_cache(maxsize=64)
def element_vertices(n: int) -> Int64:
    """Return (n * n, 3), vertices of each element, counter-clockwise like the triangle, as a read-only array."""
    length = 2 * (n - np.arange(n)) - 1  # number of elements in each row
    j = np.repeat(np.arange(n), length)
    in_row = np.arange(n * n) - np.repeat(np.cumsum(length) - length, length)
    i, upper = in_row // 2, in_row % 2
    a = np.where(upper, vertex_index(n, i + 1, j + 1), vertex_index(n, i, j))
    b = np.where(upper, vertex_index(n, i, j + 1), vertex_index(n, i + 1, j))
    c = np.where(upper, vertex_index(n, i + 1, j), vertex_index(n, i, j + 1))
    found = np.stack([a, b, c], axis=1)
    found.flags.writeable = False
    return found
