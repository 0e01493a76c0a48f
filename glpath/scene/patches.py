"""Bicubic Bézier and B-spline patches as triangles, displaced along their normals, without cracks.

The number of segments of an edge depends only on the edge's four control points, and on the camera if one is given.
So the adjacent patch finds the same number. Points of an edge are computed from these four points in one order, so
both patches have the same bits. If an edge has fewer segments than the interior, a strip joins them. A displaced
point moves along one normal by one height, the means over all patches that meet there.

The division is made once for the scene and is the same for eye, shadow and path rays. A surface with different
divisions would shadow itself.

Cost:     about 2 µs and 200 bytes a triangle.
Poor at:  displacement finer than the division, which is missed; overhangs, where a surface intersects itself.
Source:   Farin 2002, Curves and Surfaces for CAGD; Moreton 2001, Watertight Tessellation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.scene.camera import Camera
from glpath.scene.geometry import Float64, Mesh
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]

#: Maximum number of segments of an edge.
MAX_LEVEL = 256
#: Function that returns heights (N,) at texture coordinates (N, 2).
Heights = Callable[[Float64], Float64]

# Current work, for errors of the time limit.
_WORK = "dividing surfaces into triangles"
# Cosine of the angle up to which the normals of adjacent patches are merged.
_SMOOTH = np.cos(np.radians(30.0))
# If an edge of a patch degenerates to a point, it has no normal. The normal is then taken this fraction of the
# distance towards u = v = 1/2.
_INWARD = 1e-4
#: Maximum number of triangles in a chunk of streamed patches, unless a single patch has more.
CHUNK = 1 << 15


@dataclass(frozen=True, eq=False)
class Patches:
    """Surface of bicubic Bézier patches.

    control : (P, 4, 4, 3) float64, control points by u and v; seen from the front, u goes to the right and v up
    uv      : (P, 4) float64, texture coordinates at u = v = 0, and their increase to u = v = 1
    """

    control: Float64
    uv: Float64

    @classmethod
    def bezier(cls, points: ArrayLike, numbers: ArrayLike) -> Patches:
        """Return patches from control points. The texture coordinates of each patch go from 0 to 1.

        points  : (N, 3)
        numbers : (P, 16) indices into `points`, with v varying fastest
        """
        control = np.asarray(points, np.float64)[np.asarray(numbers)].reshape(-1, 4, 4, 3)
        return cls(control + 0.0, np.tile([0.0, 0.0, 1.0, 1.0], (len(control), 1)))

    @classmethod
    def bspline(cls, net: ArrayLike, closed: tuple[bool, bool] = (False, False)) -> Patches:
        """Return the uniform bicubic B-spline of a net (R, C, 3) of at least 4 x 4 points, with u along the rows.

        closed : True, for u and for v, if the first point follows the last. uv goes from 0 to 1 over the whole
                 surface
        """
        points = np.asarray(net, np.float64)
        for axis in (0, 1):
            if closed[axis]:
                points = np.concatenate([points, np.take(points, range(3), axis=axis)], axis=axis)
            points = _as_bezier(points, axis)
        rows, columns = points.shape[0] // 4, points.shape[1] // 4
        control = points.reshape(rows, 4, columns, 4, 3).swapaxes(1, 2).reshape(-1, 4, 4, 3)
        i, j = np.divmod(np.arange(rows * columns), columns)
        size = np.broadcast_to([1 / rows, 1 / columns], (len(i), 2))
        return cls(control + 0.0, np.column_stack([i / rows, j / columns, size]))

    @cached_property
    def edges(self) -> Float64:
        """Control points (P, 4, 4, 3) of the edges u = 0 and u = 1, along v, and of v = 0 and v = 1, along u."""
        c = self.control
        return np.stack([c[:, 0], c[:, 3], c[:, :, 0], c[:, :, 3]], axis=1)

    def levels(self, level: int) -> Int64:
        """Return (P, 4) segment counts, the same for all edges."""
        return np.full((len(self.control), 4), level, np.int64)

    def levels_seen(self, camera: Camera, pixels: float) -> Int64:
        """Return (P, 4) segment counts of edges, powers of two, so that a segment is at most about `pixels` long.

        The estimate uses the length of the edge's control polygon, which the edge cannot exceed. For a camera whose
        rays spread, it also uses the smallest distance between a control point and the camera in its shutter time.
        """
        curve = _in_one_order(self.edges)[0]
        length = np.linalg.norm(np.diff(curve, axis=2), axis=3).sum(axis=2)
        distance = np.ones_like(length)
        if camera.projection != "orthographic":
            distance = np.maximum(_distance_to_path(curve, camera).min(axis=2), 1e-6 * length + 1e-30)
        wanted = length * _pixels_at_distance_one(camera) / (pixels * distance)
        exponent = np.ceil(np.log2(np.clip(wanted, 1.0, MAX_LEVEL)))
        return np.asarray((2**exponent).astype(np.int64))

    def select(self, which: Int64) -> Patches:
        return Patches(self.control[which], self.uv[which])


@dataclass(frozen=True)
class _Division:
    """Division of a unit square.

    uv_points : (K, 2) u and v
    faces : (F, 3) indices of points, counter-clockwise
    edge  : (K,) edge of each point, 0 to 3 as in `Patches.edges`, -1 for none
    step : (K, 2) for a point of an edge, its index along the edge and the edge's segment count
    """

    uv_points: Float64
    faces: Int64
    edge: Int64
    step: Int64


def _pixels_at_distance_one(camera: Camera) -> float:
    """Return the pixels of one scene unit at distance 1, or at any distance for parallel rays."""
    if camera.projection == "panorama":
        width, height = camera.resolution
        return max(width / (2 * np.pi), height / np.pi)  # pixels of a radian
    return max(camera.focal_lengths)


def _distance_to_path(points: Float64, camera: Camera) -> Float64:
    """Return the distances (...) of points (..., 3) from the path of the camera while its shutter is open."""
    opened, closed = camera.shutter
    times = [opened, *(key.time for key in camera.motion if opened < key.time < closed), closed]
    found = np.full(points.shape[:-1], np.inf)
    for begin, end in pairwise(camera.at(time).position for time in times):
        step = end - begin
        share = np.clip((points - begin) @ step / max(float(step @ step), 1e-300), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(points - (begin + share[..., None] * step), axis=-1))
    return found


def triangle_counts(levels: Int64) -> Int64:
    """Return the (P,) number of triangles of each patch, including those without an area."""
    unique, which = np.unique(levels, axis=0, return_inverse=True)
    return np.array([len(_divided(*row).faces) for row in unique.tolist()], np.int64)[which.ravel()]


def diced(patches: Patches, levels: Int64, heights: Heights | None = None) -> Mesh:
    """Return the patches as triangles, with normals and texture coordinates.

    levels  : (P, 4) segment counts of the edges
    heights : displacement of the surface along its normal
    """
    points = _points(patches, levels, heights)
    normals = points.normals if heights is None else _of_faces(points)
    return Mesh(points.position, points.faces.astype(np.int32), uv=points.uv, normals=normals).welded()


@dataclass(frozen=True)
class PatchChunks:
    """Triangles of patches in pieces that are not kept in memory; see `glpath.io.streams.Chunks`.

    Each piece contains some patches. For displaced patches, the edges of adjacent patches are computed too, so that
    points shared by two pieces have the same bits.
    """

    patches: Patches
    levels: Int64
    heights: Heights | None = None

    @cached_property
    def _pieces(self) -> list[Int64]:
        counts = np.cumsum(triangle_counts(self.levels))
        pieces, first = [], 0
        while first < len(counts):
            done = counts[first - 1] if first else 0
            stop = max(first + 1, int(np.searchsorted(counts, done + CHUNK, side="right")))
            pieces.append(np.arange(first, stop))
            first = stop
        return pieces

    @cached_property
    def _corners(self) -> Int64:
        """Index (P, 4) of the point at each corner of a patch; corners at the same position have the same index."""
        corners = self.patches.control[:, [0, 0, 3, 3], [0, 3, 0, 3]].reshape(-1, 3)
        return _same_rows(corners).reshape(-1, 4)

    def __len__(self) -> int:
        return len(self._pieces)

    def chunk(self, index: int) -> Float64:
        """Return (F, 3, 3) corners of the triangles of a piece."""
        own = self._pieces[index]
        near = np.flatnonzero(np.isin(self._corners, self._corners[own]).any(axis=1)) if self.heights else own
        points = _points(self.patches.select(near), self.levels[near], self.heights, np.isin(near, own))
        return np.asarray(points.position[points.faces])


@dataclass(frozen=True)
class _Points:
    """Points and faces of divided patches.

    position, normals, uv : (V, 3), (V, 3), (V, 2)
    group : (V,) equal for points at the same position
    faces : (F, 3) indices of points; no face has two points at the same position
    """

    position: Float64
    normals: Float64
    uv: Float64
    group: Int64
    faces: Int64


def _points(
    patches: Patches, levels: Int64, heights: Heights | None, whole: NDArray[np.bool_] | None = None
) -> _Points:
    """Return the points and faces of divided patches.

    whole : (P,) True for patches with triangles, False for patches whose edges only are divided; None: all True
    """
    kinds = np.column_stack([levels, np.ones(len(levels), np.int64) if whole is None else whole])
    unique, which = np.unique(kinds, axis=0, return_inverse=True)
    of_patch = [_divided(*row[:4]) if row[4] else _edges_divided(*row[:4]) for row in unique.tolist()]
    sizes = np.array([len(division.uv_points) for division in of_patch])[which.ravel()]
    first = np.concatenate([[0], np.cumsum(sizes)])
    position, normals = np.empty((first[-1], 3)), np.empty((first[-1], 3))
    uv = np.empty((first[-1], 2))
    faces, patch = [], []
    for of, division in _parts(which.ravel(), of_patch):
        check_time(_WORK)
        at = (first[of][:, None] + np.arange(len(division.uv_points))).ravel()
        part = patches.select(of)
        position[at] = _positions(part, division).reshape(-1, 3)
        normals[at] = _normals(part.control, division.uv_points).reshape(-1, 3)
        uv[at] = (part.uv[:, None, :2] + division.uv_points * part.uv[:, None, 2:]).reshape(-1, 2)
        faces.append((first[of][:, None, None] + division.faces).reshape(-1, 3))
        patch.append(np.repeat(of, len(division.faces)))
    face = np.concatenate(faces)[np.argsort(np.concatenate(patch), kind="stable")]

    group = _same_rows(position)
    check_time(_WORK)
    own = group[face]
    apart = (own[:, 0] != own[:, 1]) & (own[:, 1] != own[:, 2]) & (own[:, 2] != own[:, 0])
    sums = np.zeros((group.max() + 1, 3))
    np.add.at(sums, group, normals)  # in patch order, so that the bits do not depend on other patches
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    common = sums / np.where(length > 0, length, 1.0)
    if heights is not None:
        height, count = np.zeros(len(common)), np.zeros(len(common))
        np.add.at(height, group, np.concatenate([heights(part) for part in _chunks(uv)]))
        np.add.at(count, group, 1.0)
        position = (position + (height / count)[group, None] * common[group]) + 0.0
    check_time(_WORK)
    agrees = np.ones(len(common))
    np.minimum.at(agrees, group, np.sum(normals * common[group], axis=1))
    normals = np.where((agrees > _SMOOTH)[group, None], common[group], normals)
    return _Points(position, normals, uv, group, face[apart])


def _parts(which: Int64, divisions: list[_Division]) -> Iterator[tuple[Int64, _Division]]:
    """Yield the patches of each division, in parts of at most CHUNK points, or of one patch.

    which : (P,) index of each patch's division
    """
    for number, division in enumerate(divisions):
        patches = np.flatnonzero(which == number)
        step = max(1, CHUNK // len(division.uv_points))
        for first in range(0, len(patches), step):
            yield patches[first : first + step], division


def _chunks(uv: Float64) -> Iterator[Float64]:
    """Yield texture coordinates (N, 2) in chunks, and check the time before each."""
    for first in range(0, len(uv), CHUNK):
        check_time(_WORK)
        yield uv[first : first + CHUNK]


def _of_faces(points: _Points) -> Float64:
    """Return (V, 3) normals of points from their triangles, weighted by area."""
    a, b, c = points.position[points.faces].swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    sums = np.zeros((points.group.max() + 1, 3))
    for corner in range(3):
        check_time(_WORK)
        np.add.at(sums, points.group[points.faces[:, corner]], normal)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray((sums / np.where(length > 0, length, 1.0))[points.group])


def _positions(patches: Patches, division: _Division) -> Float64:
    """Return (P, K, 3) positions of a division's points on the patches."""
    u, v = _bernstein(division.uv_points[:, 0]), _bernstein(division.uv_points[:, 1])
    found = np.zeros((len(patches.control), len(division.uv_points), 3))
    for i in range(4):
        for j in range(4):
            found += (u[i] * v[j])[None, :, None] * patches.control[:, None, i, j]
    for edge in range(4):
        here = np.flatnonzero(division.edge == edge)
        curve, turned = _in_one_order(patches.edges[:, edge])
        number, of = division.step[here].T
        b = [
            np.where(turned[:, None], back, forth)[..., None]
            for forth, back in zip(_bernstein(number / of), _bernstein((of - number) / of), strict=True)
        ]
        along = sum(b[k] * curve[:, None, k] for k in range(4))
        # An edge that is a point, for example at a pole, stays a point to the last bit.
        point = (curve == curve[:, :1]).all(axis=(1, 2))
        found[:, here] = np.where(point[:, None, None], curve[:, :1], along)
    return found + 0.0


def _normals(control: Float64, uv_points: Float64) -> Float64:
    """Return (P, K, 3) unit normals at points of the patches."""
    found = _cross_of_tangents(control, uv_points)
    length = np.linalg.norm(found, axis=2)
    size = np.ptp(control.reshape(len(control), -1, 3), axis=1).max(axis=1)
    lost = ~(length > 1e-9 * np.maximum(size, 1e-300)[:, None] ** 2)
    if lost.any():
        inward = _cross_of_tangents(control, uv_points + _INWARD * (0.5 - uv_points))
        found = np.where(lost[..., None], inward, found)
        length = np.linalg.norm(found, axis=2)
    return np.asarray(found / np.where(length > 0, length, 1.0)[..., None])


def _cross_of_tangents(control: Float64, uv_points: Float64) -> Float64:
    u, v = _bernstein(uv_points[:, 0]), _bernstein(uv_points[:, 1])
    du, dv = _slopes(uv_points[:, 0]), _slopes(uv_points[:, 1])
    along_u, along_v = (np.zeros((len(control), len(uv_points), 3)) for _ in range(2))
    for i in range(4):
        for j in range(4):
            along_u += (du[i] * v[j])[None, :, None] * control[:, None, i, j]
            along_v += (u[i] * dv[j])[None, :, None] * control[:, None, i, j]
    return np.cross(along_u, along_v)


def _bernstein(t: Float64) -> tuple[Float64, ...]:
    s = 1.0 - t
    return s * s * s, 3.0 * t * s * s, 3.0 * t * t * s, t * t * t


def _slopes(t: Float64) -> tuple[Float64, ...]:
    s = 1.0 - t
    return -3.0 * s * s, 3.0 * s * s - 6.0 * t * s, 6.0 * t * s - 3.0 * t * t, 3.0 * t * t


def _as_bezier(points: Float64, axis: int) -> Float64:
    """Return control points of Bézier curves, four for each segment of a uniform B-spline along an axis."""
    p = np.moveaxis(points, axis, 0)
    a, b, c, d = p[:-3], p[1:-2], p[2:-1], p[3:]
    # The last point of a curve and the first of the next curve are the same sum, so they have the same bits.
    curves = np.stack([(a + 4 * b + c) / 6, (2 * b + c) / 3, (b + 2 * c) / 3, (b + 4 * c + d) / 6], axis=1)
    return np.moveaxis(curves.reshape(-1, *p.shape[1:]), 0, axis)


def _in_one_order(curves: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Return curves (..., 4, 3), each from its lexicographically smaller end, and a mask (...) of reversed ones."""
    forth, back = curves.reshape(*curves.shape[:-2], 12), curves[..., ::-1, :].reshape(*curves.shape[:-2], 12)
    differ = forth != back
    first = np.argmax(differ, axis=-1)[..., None]
    turned = (np.take_along_axis(back, first, -1) < np.take_along_axis(forth, first, -1))[..., 0]
    return np.where(turned[..., None, None], curves[..., ::-1, :], curves), turned


def _same_rows(rows: Float64) -> Int64:
    """Return (N,) indices that are equal for points (N, 3) with the same bits."""
    which = np.zeros(len(rows), np.int64)
    for column in np.ascontiguousarray((rows + 0.0).T).view(np.int64):
        check_time(_WORK)
        _, own = np.unique(column, return_inverse=True)
        check_time(_WORK)
        _, which = np.unique(which * (own.max(initial=0) + 1) + own, return_inverse=True)
    return np.asarray(which, np.int64)


@lru_cache(maxsize=1024)
def _divided(u0: int, u1: int, v0: int, v1: int) -> _Division:
    """Return the division of a unit square for segment counts of the edges u = 0, u = 1, v = 0 and v = 1."""
    along_u, along_v = max(v0, v1), max(u0, u1)
    alike = u0 == u1 and v0 == v1
    if not alike:
        along_u, along_v = max(2, along_u), max(2, along_v)
    # Points of the edges, in order around the square, then interior points.
    ring: list[tuple[float, float, int, int, int]] = []
    ring += [(k / v0, 0.0, 2, k, v0) for k in range(v0)]
    ring += [(1.0, k / u1, 1, k, u1) for k in range(u1)]
    ring += [((v1 - k) / v1, 1.0, 3, v1 - k, v1) for k in range(v1)]
    ring += [(0.0, (u0 - k) / u0, 0, u0 - k, u0) for k in range(u0)]
    inside = [(i / along_u, j / along_v, -1, 0, 1) for i in range(1, along_u) for j in range(1, along_v)]
    table = np.array(ring + inside, np.float64)
    faces = _grid_faces(along_u, along_v, u0, v0) if alike else _joined_faces(along_u, along_v, u0, u1, v0, v1)
    return _Division(table[:, :2], faces, table[:, 2].astype(np.int64), table[:, 3:].astype(np.int64))


def _edges_divided(u0: int, u1: int, v0: int, v1: int) -> _Division:
    """Return the division of a unit square without its interior."""
    whole, ring = _divided(u0, u1, v0, v1), u0 + u1 + v0 + v1
    return _Division(whole.uv_points[:ring], np.zeros((0, 3), np.int64), whole.edge[:ring], whole.step[:ring])


def _inner(i: int, j: int, ring: int, along_v: int) -> int:
    return ring + (i - 1) * (along_v - 1) + j - 1


def _grid_faces(along_u: int, along_v: int, u: int, v: int) -> Int64:
    """Return the faces of a regular grid whose edges match the interior: squares, each split in two."""
    ring = 2 * (u + v)

    def number(i: int, j: int) -> int:
        if j == 0:
            return i
        if i == along_u:
            return v + j
        if j == along_v:
            return v + u + along_u - i
        if i == 0:
            return 2 * v + u + along_v - j
        return _inner(i, j, ring, along_v)

    faces = []
    for i in range(along_u):
        for j in range(along_v):
            a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
            faces += [(a, b, c), (a, c, d)]
    return np.array(faces, np.int64)


def _joined_faces(along_u: int, along_v: int, u0: int, u1: int, v0: int, v1: int) -> Int64:
    """Return the faces of an interior grid, and of strips from its border to each edge."""
    ring = u0 + u1 + v0 + v1
    faces = []
    for i in range(1, along_u - 1):
        for j in range(1, along_v - 1):
            a, b = _inner(i, j, ring, along_v), _inner(i + 1, j, ring, along_v)
            c, d = _inner(i + 1, j + 1, ring, along_v), _inner(i, j + 1, ring, along_v)
            faces += [(a, b, c), (a, c, d)]
    us, vs = range(1, along_u), range(1, along_v)
    # For each side, counter-clockwise: its segment count, its first point, the grid's segment count, and the
    # adjacent points of the grid.
    sides = [
        (v0, 0, along_u, [_inner(i, 1, ring, along_v) for i in us]),
        (u1, v0, along_v, [_inner(along_u - 1, j, ring, along_v) for j in vs]),
        (v1, v0 + u1, along_u, [_inner(i, along_v - 1, ring, along_v) for i in reversed(us)]),
        (u0, v0 + u1 + v1, along_v, [_inner(1, j, ring, along_v) for j in reversed(vs)]),
    ]
    for count, start, steps, beside in sides:
        outer = [(start + k) % ring for k in range(count + 1)]
        k = m = 0
        while k < count or m < len(beside) - 1:
            # Advance on the side that lags, by comparing the midpoints of the next segments.
            forth = m == len(beside) - 1 or (k < count and (k + 0.5) / count <= (m + 1.5) / steps)
            if forth:
                faces.append((outer[k], outer[k + 1], beside[m]))
                k += 1
            else:
                faces.append((outer[k], beside[m + 1], beside[m]))
                m += 1
    return np.array(faces, np.int64)
