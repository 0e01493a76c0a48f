"""Ends of the cast segments: samples of an emitter, and points of receivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.bvh import Float64, Int32
from glpath.radiosity.shafts.occluders import Occluders, Segment
from glpath.system.kernels import inner_kernel, kernel


@dataclass(frozen=True)
class Emitter:
    """Sample points of an emitter.

    points  : (S, 3) float64
    normal  : (3,) normal of a one-sided emitter, which lights only points in front of it; None for light to all
              sides
    polygon : index of the occluder that contains the points and does not block them; -1 for none
    box     : (6,) lower and upper corner of a box around the points; None for the smallest
    """

    points: Float64
    normal: Float64 | None = None
    polygon: int = -1
    box: Float64 | None = None

    @classmethod
    def on(cls, occluders: Occluders, polygon: int, side: int = 4, whole: bool = False) -> Emitter:
        """Return samples on a polygon's front, in the centres of side x side cells.

        A triangle has the samples of its parallelogram without those outside the triangle, about half of them.

        whole : True to build shafts for the box of the whole polygon, as in the paper; False for the samples' box
        """
        middles = (np.arange(side) + 0.5) / side
        points = _on_polygons(occluders, np.array([polygon]), middles, middles)[0]
        a, b, c = occluders.corners[polygon]
        outline = np.stack([a, b, c, b + c - a] if occluders.parallelogram[polygon] else [a, b, c])
        box = np.concatenate([outline.min(axis=0), outline.max(axis=0)])
        return cls(points, occluders.normals[polygon], polygon, box if whole else None)


@dataclass(frozen=True)
class Receivers:
    """Points that receive light, receiver after receiver.

    points   : (P, 3) float64
    receiver : (P,) int32, index of the receiver of each point, in ascending order
    normals  : (P, 3) normals of one-sided receivers, which are lit from their front only; None for all sides
    polygons : (P,) int32, index of the occluder that contains each point and does not block it, -1 for none; None
               if no point has one
    """

    points: Float64
    receiver: Int32
    normals: Float64 | None = None
    polygons: Int32 | None = None

    @classmethod
    def on(cls, occluders: Occluders, spacing: float) -> Receivers:
        """Return grid points on the front of every polygon, at most `spacing` apart, including the corners."""
        edges = np.linalg.norm(occluders.corners[:, 1:] - occluders.corners[:, :1], axis=2)
        cells = np.maximum(np.ceil(edges / spacing - 1e-9), 1).astype(int)
        kinds, kind = np.unique(np.column_stack([cells, occluders.parallelogram]), axis=0, return_inverse=True)
        points, number = [], []
        for i, (n, m, _) in enumerate(kinds):
            which = np.flatnonzero(kind.ravel() == i)
            grid = _on_polygons(occluders, which, np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1))
            points.append(grid.reshape(-1, 3))
            number.append(np.repeat(which, grid.shape[1]))
        numbers = np.concatenate([np.zeros(0, int), *number])
        order = np.argsort(numbers, kind="stable")
        numbers = numbers[order].astype(np.int32)
        return cls(np.concatenate([np.zeros((0, 3)), *points])[order], numbers, occluders.normals[numbers], numbers)


def _on_polygons(occluders: Occluders, which: NDArray[np.int64], u: Float64, v: Float64) -> Float64:
    """Return (n, points, 3), the points at all pairs of u and v on n polygons.

    Polygons are either all triangles or all parallelograms. On triangles, only pairs with u + v <= 1 count.
    """
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    if not occluders.parallelogram[which[0]]:
        uv = uv[uv.sum(axis=1) <= 1 + 1e-12]
    corner = occluders.corners[which, :1]
    edges = occluders.corners[which, 1:] - corner
    return np.asarray(corner + np.einsum("pk,nkj->npj", uv, edges))


class Source(NamedTuple):
    """Emitter in the form that the kernels take, made by `source_of`."""

    points: Float64
    box: Float64
    plane: Float64
    one_sided: bool
    polygon: int


class Lit(NamedTuple):
    """Receiver points in the order of the groups, as the kernels take them.

    x, y, z   : (P,) coordinates
    normals   : (P, 3) unit normals; empty if not `one_sided`
    heights   : (P,) normal . point, the offset of the point's plane; empty if not `one_sided`
    one_sided : True if points are lit from their front only
    own       : (P,) index of the polygon that contains each point; -1 for none
    """

    x: Float64
    y: Float64
    z: Float64
    normals: Float64
    heights: Float64
    one_sided: bool
    own: NDArray[np.int64]


def facing(emitter: Emitter, receivers: Receivers) -> NDArray[np.bool_]:
    """Return (P, S) bool, True if a receiver point and an emitter sample lie in front of each other."""
    order = np.arange(len(receivers.points))
    faces = np.zeros((len(order), len(emitter.points)), np.bool_)
    _facing(source_of(emitter), lit_of(receivers, order), order, faces)
    return faces


def source_of(emitter: Emitter) -> Source:
    points = np.ascontiguousarray(emitter.points, np.float64)
    return Source(points, _box(emitter), _plane(emitter), emitter.normal is not None, emitter.polygon)


def lit_of(receivers: Receivers, order: NDArray[np.int64]) -> Lit:
    points = np.asarray(receivers.points, np.float64)[order]
    one_sided = receivers.normals is not None
    normals = np.zeros((0, 3)) if receivers.normals is None else _unit(receivers.normals)[order]
    heights = (normals * points).sum(axis=1) if one_sided else np.zeros(0)
    own = np.full(len(order), -1, np.int32) if receivers.polygons is None else receivers.polygons[order]
    x, y, z = np.ascontiguousarray(points.T)
    return Lit(x, y, z, normals, heights, one_sided, np.ascontiguousarray(own, np.int64))


def _plane(emitter: Emitter) -> Float64:
    """Return the emitter's plane (nx, ny, nz, d) through its rearmost sample; zeros if it emits to all sides."""
    if emitter.normal is None:
        return np.zeros(4)
    normal = _unit(np.asarray(emitter.normal, np.float64))
    return np.array([*normal, -np.min(emitter.points @ normal)])


def _box(emitter: Emitter) -> Float64:
    if emitter.box is not None:
        return np.ascontiguousarray(emitter.box, np.float64).reshape(6)
    return np.concatenate([emitter.points.min(axis=0), emitter.points.max(axis=0)])


def _unit(vectors: Float64) -> Float64:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


@inner_kernel
def before_emitter(lit, k, source):  # type: ignore[no-untyped-def]
    """Return True if receiver point k lies in front of the emitter."""
    p = source.plane
    return not source.one_sided or p[0] * lit.x[k] + p[1] * lit.y[k] + p[2] * lit.z[k] + p[3] > 0


@inner_kernel
def before_receiver(lit, k, source, s):  # type: ignore[no-untyped-def]
    """Return True if sample s lies in front of receiver point k."""
    if not lit.one_sided:
        return True
    n, a = lit.normals, source.points
    return n[k, 0] * a[s, 0] + n[k, 1] * a[s, 1] + n[k, 2] * a[s, 2] > lit.heights[k]


@inner_kernel
def segment_between(source, s, lit, k):  # type: ignore[no-untyped-def]
    """Return the segment from sample s to receiver point k."""
    a = source.points
    return Segment(a[s, 0], a[s, 1], a[s, 2], lit.x[k], lit.y[k], lit.z[k], source.polygon, lit.own[k])


@kernel
def _facing(source, lit, order, faces):  # type: ignore[no-untyped-def]
    for k in range(len(order)):
        for s in range(len(source.points)):
            faces[order[k], s] = before_emitter(lit, k, source) and before_receiver(lit, k, source, s)
