"""The lattice of a triangle: its edges in n equal parts, n * n elements between (n + 1)(n + 2) / 2 vertices.

A point is c0 + b1 (c1 - c0) + b2 (c2 - c0), and x = n b1, y = n b2 are its lattice coordinates. Vertex (i, j) lies
at x = i, y = j. The cell (i, j) has a lower element, with the vertices (i, j), (i + 1, j), (i, j + 1), and, unless
it lies at the third edge, an upper one, with (i + 1, j + 1), (i, j + 1), (i + 1, j). Both are numbered row by row.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.scene.model import Float64

Int64 = NDArray[np.int64]


def element_count(n: ArrayLike) -> Int64:
    """Elements of a triangle whose edges are in n parts."""
    parts = np.asarray(n, np.int64)
    return np.asarray(parts * parts)


def vertex_count(n: ArrayLike) -> Int64:
    """Vertices of a triangle whose edges are in n parts."""
    parts = np.asarray(n, np.int64)
    return np.asarray((parts + 1) * (parts + 2) // 2)


def starts(counts: ArrayLike) -> Int64:
    """(T + 1,): where each triangle's elements or vertices begin, and the number of them all."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, np.int64))])


def vertex_index(n: ArrayLike, i: ArrayLike, j: ArrayLike) -> Int64:
    """The number of vertex (i, j) in its triangle."""
    n, i, j = (np.asarray(a, np.int64) for a in (n, i, j))
    return np.asarray(j * (n + 1) - j * (j - 1) // 2 + i)


def element_index(n: ArrayLike, i: ArrayLike, j: ArrayLike, upper: ArrayLike) -> Int64:
    """The number of an element of cell (i, j) in its triangle; upper: 0 or 1."""
    n, i, j, upper = (np.asarray(a, np.int64) for a in (n, i, j, upper))
    return np.asarray(j * (2 * n - j) + 2 * i + upper)


def locate(n: ArrayLike, b1: ArrayLike, b2: ArrayLike) -> tuple[Int64, Int64, Int64, Float64, Float64]:
    """Of barycentric points cell i, j, whether in its upper element, and the position (fx, fy) in it, 0 to 1.

    Points outside of the triangle are taken to the nearest element in x, then in y.
    """
    parts = np.asarray(n, np.int64)
    x, y = parts * np.clip(b1, 0.0, 1.0), parts * np.clip(b2, 0.0, 1.0)
    i = np.minimum(x.astype(np.int64), parts - 1)
    j = np.clip(y.astype(np.int64), 0, parts - 1 - i)
    fx, fy = np.clip(x - i, 0.0, 1.0), np.clip(y - j, 0.0, 1.0)
    # There is no upper element along the third edge.
    upper = ((fx + fy > 1) & (i + j < parts - 1)).astype(np.int64)
    beyond = np.maximum(fx + fy - 1, 0) * (upper == 0)
    return i, j, upper, fx - 0.5 * beyond, fy - 0.5 * beyond


@lru_cache(maxsize=64)
def vertex_barycentrics(n: int) -> Float64:
    """(V, 2): b1 and b2 of the vertices, in their order. Not to be written to."""
    length = n + 1 - np.arange(n + 1)  # of each row
    j = np.repeat(np.arange(n + 1), length)
    i = np.arange(len(j)) - np.repeat(np.cumsum(length) - length, length)
    corners = np.stack([i, j], axis=1) / n
    corners.flags.writeable = False
    return corners


@lru_cache(maxsize=64)
def element_vertices(n: int) -> Int64:
    """(n * n, 3): the vertices of each element, counter-clockwise like the triangle. Not to be written to."""
    length = 2 * (n - np.arange(n)) - 1  # of each row
    j = np.repeat(np.arange(n), length)
    in_row = np.arange(n * n) - np.repeat(np.cumsum(length) - length, length)
    i, upper = in_row // 2, in_row % 2
    a = np.where(upper, vertex_index(n, i + 1, j + 1), vertex_index(n, i, j))
    b = np.where(upper, vertex_index(n, i, j + 1), vertex_index(n, i + 1, j))
    c = np.where(upper, vertex_index(n, i + 1, j), vertex_index(n, i, j + 1))
    found = np.stack([a, b, c], axis=1)
    found.flags.writeable = False
    return found
