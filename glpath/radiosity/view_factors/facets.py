"""Facets: convex polygons out of the faces that a user has, and the occluders that they make together.

A face may be any flat polygon; one that is not convex becomes several facets, and neighbours in one plane that belong
to one row of the matrix become one. Occluders are merged whatever they belong to: a wall of a thousand faces hides
what is behind it as one rectangle.

Cost:     merging takes some 20 microseconds a face.
Poor at:  merging faces whose edges meet in T-junctions, which stay apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.view_factors.convex import CORNERS
from glpath.radiosity.view_factors.rows import Polygons

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

#: Share of the size of the scene below which a distance is rounding, as of coordinates of 32 bits.
ROUNDING = 5e-7
#: Sine of an angle below which three corners are in line.
_STRAIGHT = 1e-6


def polygons_of(outlines: Sequence[Float64]) -> Polygons:
    """For the kernels, of convex outlines (n, 3) each with at most `CORNERS` corners."""
    total = len(outlines)
    corners = np.zeros((total, CORNERS, 3))
    count = np.array([len(outline) for outline in outlines], np.int64)
    for i, outline in enumerate(outlines):
        corners[i, : len(outline)] = outline
        corners[i, len(outline) :] = outline[0]
    # A corner that is there more than once adds nothing.
    following = np.roll(corners, -1, axis=1)
    area_vectors = 0.5 * np.cross(corners - corners[:, :1], following - corners[:, :1]).sum(axis=1)
    areas = np.linalg.norm(area_vectors, axis=1)
    normals = area_vectors / np.maximum(areas, np.finfo(float).tiny)[:, None]
    inside = np.arange(CORNERS)[None, :] < count[:, None]
    centres = (corners * inside[..., None]).sum(axis=1) / np.maximum(count, 1)[:, None]
    planes = np.column_stack([normals, -(normals * centres).sum(axis=1)])
    # The last edge goes back to corner 0, which is what stands behind the last corner.
    along = np.where(inside[..., None], following - corners, 0.0)
    inward = np.cross(normals[:, None], along)
    inward /= np.maximum(np.linalg.norm(inward, axis=2, keepdims=True), np.finfo(float).tiny)
    edges = np.concatenate([inward, -(inward * corners).sum(axis=2, keepdims=True)], axis=2)
    boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    return Polygons(corners, count, planes, np.ascontiguousarray(edges), boxes, areas)


def merged(
    vertices: Float64, outlines: Sequence[Sequence[int]], labels: Sequence[int], size: float
) -> tuple[list[list[int]], list[int]]:
    """Neighbours of one label in one plane put together, where what comes of it is convex.

    vertices : (V, 3); equal ones must be one
    outlines : numbers of vertices of convex polygons
    size     : of the scene, which rounding is measured by

    Returns outlines and the first polygon of each. The longest common edges go first, so that the two triangles of a
    quad find each other.
    """
    shapes: list[list[int] | None] = [list(outline) for outline in outlines]
    points = [tuple(map(float, v)) for v in vertices]
    normals = [_normal(points, shape) for shape in shapes if shape is not None]
    labels = list(labels)
    eps = ROUNDING * size
    sides: dict[tuple[int, int], int] = {}
    for number, shape in enumerate(shapes):
        assert shape is not None
        for edge in _edges(shape):
            sides[edge] = number
    changed = True
    while changed:
        changed = False
        for number in range(len(shapes)):
            # One grows as far as it goes before the next begins, or a grid of squares would end in pinwheels.
            while (shape := shapes[number]) is not None:
                edges = sorted(_edges(shape), key=lambda edge: -round(_distance2(points[edge[0]], points[edge[1]]), 12))
                for a, b in edges:
                    other = sides.get((b, a), number)
                    two = shapes[other]
                    if other == number or two is None or labels[other] != labels[number]:
                        continue
                    union = _union(points, shape, two, a, b, normals[number], normals[other], eps)
                    if union is not None:
                        break
                else:
                    break
                for edge in (*_edges(shape), *_edges(two)):
                    sides.pop(edge, None)
                for edge in _edges(union):
                    sides[edge] = number
                shapes[number], shapes[other] = union, None
                normals[number] = _normal(points, union)
                changed = True
    kept = [i for i, shape in enumerate(shapes) if shape is not None]
    return [shape for shape in shapes if shape is not None], kept


def _edges(outline: list[int]) -> list[tuple[int, int]]:
    return list(zip(outline, [*outline[1:], outline[0]], strict=True))


def _union(
    points: list[Any], one: Any, two: Any, a: int, b: int, normal: Any, normal_two: Any, eps: float
) -> list[int] | None:
    """Two polygons that share the edge from a to b (of the first) as one; None where that is not flat and convex."""
    if _dot(normal, normal_two) < 1 - 1e-9:
        return None
    origin = points[a]
    if any(abs(_dot(normal, _minus(points[v], origin))) > eps for v in two):
        return None
    i, j = one.index(b), two.index(a)
    outline = [*one[i:], *one[:i]]  # from b round to a
    outline += [*two[j:], *two[:j]][1:-1]  # what comes after a, up to before b
    if len(set(outline)) != len(outline):
        return None
    kept = []
    n = len(outline)
    for k in range(n):
        p, q, r = points[outline[k - 1]], points[outline[k]], points[outline[(k + 1) % n]]
        u, v = _minus(q, p), _minus(r, q)
        turn = _dot(normal, _cross(u, v))
        straight = _STRAIGHT * (_dot(u, u) * _dot(v, v)) ** 0.5
        if turn < -straight or (abs(turn) <= straight and _dot(u, v) < 0):
            return None
        if turn > straight:
            kept.append(outline[k])
    return kept if 3 <= len(kept) <= CORNERS else None


def _normal(points: list[Any], outline: Sequence[int]) -> tuple[float, float, float]:
    x = y = z = 0.0
    origin = points[outline[0]]
    for p, q in zip(outline[1:-1], outline[2:], strict=True):
        n = _cross(_minus(points[p], origin), _minus(points[q], origin))
        x, y, z = x + n[0], y + n[1], z + n[2]
    length = (x * x + y * y + z * z) ** 0.5 or 1.0
    return x / length, y / length, z / length


def _minus(a: Any, b: Any) -> tuple[float, float, float]:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _cross(a: Any, b: Any) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Any, b: Any) -> float:
    result: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return result


def _distance2(a: Any, b: Any) -> float:
    d = _minus(a, b)
    return _dot(d, d)
