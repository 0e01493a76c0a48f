"""Convert faces to facets, which are convex polygons, and merge faces to occluders.

A face may be any flat polygon. A concave one becomes several facets, and neighbouring facets in one plane and one
row of the matrix become one. Occluders are merged whatever row they belong to, so a wall of a thousand faces
occludes as one rectangle.

Cost:     merging takes some 20 microseconds a face.
Poor at:  merging faces whose edges meet in T-junctions, which stay separate.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.view_factors.convex import CORNERS
from glpath.apps.view_factors.records import Polygons

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Outline = tuple[int, ...]

#: Distance that counts as rounding of 32-bit coordinates, as a fraction of the scene's size.
ROUNDING = 5e-7
#: Sine of the angle up to which three corners are collinear.
_STRAIGHT = 1e-6


def polygons_of(vertices: Float64, outlines: Sequence[Sequence[int]]) -> Polygons:
    """Convert convex outlines, with at most `CORNERS` corners each, to the polygons that the kernels take."""
    total = len(outlines)
    corners = np.zeros((total, CORNERS, 3))
    count = np.array([len(outline) for outline in outlines], np.int64)
    for n in np.unique(count):
        which = np.flatnonzero(count == n)
        some = vertices[np.array([outlines[i] for i in which.tolist()])]
        corners[which, :n] = some
        corners[which, n:] = some[:, :1]
    # Unused entries repeat corner 0, and add nothing to the area.
    following = np.roll(corners, -1, axis=1)
    area_vectors = 0.5 * np.cross(corners - corners[:, :1], following - corners[:, :1]).sum(axis=1)
    areas = np.linalg.norm(area_vectors, axis=1)
    normals = area_vectors / np.maximum(areas, np.finfo(float).tiny)[:, None]
    inside = np.arange(CORNERS)[None, :] < count[:, None]
    centres = (corners * inside[..., None]).sum(axis=1) / np.maximum(count, 1)[:, None]
    planes = np.column_stack([normals, -(normals * centres).sum(axis=1)])
    # The last edge ends at corner 0, which is stored again after the last corner.
    along = np.where(inside[..., None], following - corners, 0.0)
    inward = np.cross(normals[:, None], along)
    inward /= np.maximum(np.linalg.norm(inward, axis=2, keepdims=True), np.finfo(float).tiny)
    edges = np.concatenate([inward, -(inward * corners).sum(axis=2, keepdims=True)], axis=2)
    boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    return Polygons(corners, count, planes, np.ascontiguousarray(edges), boxes, areas)


def merged(
    vertices: Float64, outlines: Sequence[Sequence[int]], labels: Sequence[int], size: float
) -> tuple[list[list[int]], list[int]]:
    """Merge neighbouring polygons of the same label and plane if their union is convex.

    vertices : (V, 3); equal vertices must have one index
    outlines : vertex indices of convex polygons
    labels   : label of each polygon
    size     : size of the scene, to which the rounding tolerance is proportional

    Returns the outlines after merging, and for each the index of a given polygon in it. Polygons with the longest
    common edge are merged first, so that the two triangles of a quad become one polygon.
    """
    shapes: list[list[int] | None] = [list(outline) for outline in outlines]
    points = list(map(tuple, np.asarray(vertices, np.float64).tolist()))
    # Area vectors add up when polygons are merged, which gives the normal of a union without its corners.
    vectors = [_area_vector(points, shape) for shape in shapes if shape is not None]
    units = [_unit(vector) for vector in vectors]
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
            # Each polygon grows as far as possible before the next, because a grid of squares would otherwise end
            # in pinwheels.
            while (shape := shapes[number]) is not None:
                neighbours = []
                for a, b in _edges(shape):
                    other = sides.get((b, a), number)
                    if (
                        other == number
                        or labels[other] != labels[number]
                        or _dot(units[number], units[other]) < 1 - 1e-9
                    ):
                        continue
                    neighbours.append((-round(_distance2(points[a], points[b]), 12), a, b, other))
                neighbours.sort(key=itemgetter(0))
                for _, a, b, other in neighbours:
                    two = shapes[other]
                    if two is None:
                        continue
                    union = _union(points, shape, two, a, b, units[number], eps)
                    if union is not None:
                        break
                else:
                    break
                for edge in (*_edges(shape), *_edges(two)):
                    sides.pop(edge, None)
                for edge in _edges(union):
                    sides[edge] = number
                shapes[number], shapes[other] = union, None
                vectors[number] = _plus(vectors[number], vectors[other])
                units[number] = _unit(vectors[number])
                changed = True
    kept = [i for i, shape in enumerate(shapes) if shape is not None]
    return [shape for shape in shapes if shape is not None], kept


def _edges(outline: list[int]) -> list[tuple[int, int]]:
    return list(zip(outline, [*outline[1:], outline[0]], strict=True))


def _union(points: list[Any], one: Any, two: Any, a: int, b: int, normal: Any, eps: float) -> list[int] | None:
    """Return the union of two convex polygons with the same normal, or None if it is not flat and convex.

    The polygons share an edge, which leads from a to b in the first polygon.
    """
    x, y, z = points[a]
    nx, ny, nz = normal
    for v in two:
        px, py, pz = points[v]
        if abs(nx * (px - x) + ny * (py - y) + nz * (pz - z)) > eps:
            return None
    i, j = one.index(b), two.index(a)
    first = [*one[i:], *one[:i]]  # from b around to a
    second = [*two[j:], *two[:j]][1:-1]  # corners of the other polygon between a and b
    if not set(first).isdisjoint(second) or not second:
        return None
    # Only at the joints a and b can the union's outline turn differently from the parts': inward, or not at all.
    at_a, at_b = _turn(points, first[-2], a, second[0], normal), _turn(points, second[-1], b, first[1], normal)
    if at_a < 0 or at_b < 0:
        return None
    union = [*first[0 if at_b else 1 : None if at_a else -1], *second]
    return union if 3 <= len(union) <= CORNERS else None


def _turn(points: list[Any], before: int, at: int, after: int, normal: Any) -> int:
    """Return 1 if the outline turns left at `at`, 0 if it continues straight, -1 if it turns right or back."""
    u, v = _minus(points[at], points[before]), _minus(points[after], points[at])
    turn = _dot(normal, _cross(u, v))
    straight = _STRAIGHT * (_dot(u, u) * _dot(v, v)) ** 0.5
    if turn > straight:
        return 1
    return 0 if turn >= -straight and _dot(u, v) >= 0 else -1


def _area_vector(points: Any, outline: Sequence[int]) -> tuple[float, float, float]:
    """Return the normal of an outline with the length of twice its area."""
    origin = points[outline[0]]
    x = y = z = 0.0
    before = _minus(points[outline[1]], origin)
    for v in outline[2:]:
        after = _minus(points[v], origin)
        n = _cross(before, after)
        x, y, z = x + n[0], y + n[1], z + n[2]
        before = after
    return x, y, z


def _normal(points: Any, outline: Sequence[int]) -> tuple[float, float, float]:
    return _unit(_area_vector(points, outline))


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = vector
    length = (x * x + y * y + z * z) ** 0.5 or 1.0
    return x / length, y / length, z / length


def _plus(a: Any, b: Any) -> tuple[float, float, float]:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


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


def planar_regions(vertices: Float64, outlines: Sequence[Outline], size: float) -> Int64:
    """Return (F,) int64, for each face the index of its region: coplanar faces that are connected by common edges.

    Regions are numbered in the order of their first faces.
    """
    points = [tuple(map(float, v)) for v in vertices]
    normals = [_normal(points, outline) for outline in outlines]
    sides: dict[tuple[int, int], int] = {}
    leader = list(range(len(outlines)))

    def found(i: int) -> int:
        while leader[i] != i:
            leader[i] = leader[leader[i]]
            i = leader[i]
        return i

    eps = ROUNDING * size
    for number, outline in enumerate(outlines):
        for a, b in _edges(list(outline)):
            other = sides.get((b, a))
            # In a finely divided cylinder, all neighbours have nearly equal normals, so the corners are tested too.
            if other is not None and _dot(normals[number], normals[other]) > 1 - 1e-9:
                origin = points[outlines[found(other)][0]]
                normal = normals[found(other)]
                if all(abs(_dot(normal, _minus(points[v], origin))) <= eps for v in outline):
                    one, two = sorted((found(number), found(other)))
                    leader[two] = one
            sides[a, b] = number
    _, first, labels = np.unique([found(i) for i in range(len(outlines))], return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    return np.asarray(order[labels], np.int64)


def convex_parts(vertices: Float64, outline: Outline, max_corners: int) -> list[Outline]:
    """Split a flat polygon into convex ones with at most `max_corners` corners; return a convex one unchanged.

    Ears are cut off: the first convex corner whose triangle contains no other corner.
    """
    if len(outline) == 3:
        return [outline]
    points = {v: tuple(map(float, vertices[v])) for v in outline}
    normal = _normal(points, outline)

    def turn(a: int, b: int, c: int) -> float:
        return _dot(normal, _cross(_minus(points[b], points[a]), _minus(points[c], points[b])))

    n = len(outline)
    # An outline that turns outward nowhere is convex, unless it intersects itself and winds around more than once.
    if all(turn(outline[k - 1], outline[k], outline[(k + 1) % n]) >= 0 for k in range(n)):
        step = max_corners - 2
        return [(outline[0], *outline[k : k + step + 1]) for k in range(1, n - 1, step)]
    left = list(outline)
    parts: list[Outline] = []
    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            if turn(a, b, c) <= 0:
                continue
            others = (v for v in left if v not in (a, b, c))
            if not any(turn(a, b, v) >= 0 and turn(b, c, v) >= 0 and turn(c, a, v) >= 0 for v in others):
                parts.append((a, b, c))
                del left[k]
                break
        else:
            break  # only collinear corners are left
    if len(left) == 3:
        parts.append((left[0], left[1], left[2]))
    return parts
