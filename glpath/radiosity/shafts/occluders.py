"""Occluders: flat polygons that may block a segment, and the test of a segment against a polygon.

Every search for an occluder ends in `height` and `crosses`, so all searches agree bit for bit. This requires boxes
of the BVH that are widened by more than any rounding error of a hit. In slivers, edge coordinates are less exact.
A sliver's hit counts only if the computed point lies in the sliver's box, which is widened less than the BVH's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.accel.bvh import Float64, Int32
from glpath.errors import UsageError
from glpath.scene.appearance import Appearance
from glpath.scene.model import Scene
from glpath.system.kernels import inner_kernel, kernel, kernel_part

#: Fraction of a segment at each end in which hits are ignored, because neighbours of the surfaces there would block
#: it.
ENDS = 1e-5
#: Length by which a box is widened on every side, as a fraction of the occluders' largest coordinate.
_WIDER = 1e-9
#: Rounding error of a distance from a plane, as a fraction of the largest coordinate.
_ROUNDING = 1e-12
#: Maximum coordinate of a point, as a multiple of the occluders' largest, for which the two values above cover
#: rounding errors. Points beyond it are rejected.
_FARTHEST = 1e3

PARALLELOGRAM, SOLID, SLIVER = 1, 2, 4
#: Sine of the angle between a polygon's edges, below which it is a sliver, whose hits need a further test.
_THIN = 1e-3
#: Mean opacity below which a polygon does not occlude.
_CLEAR = 0.5


class Polygons(NamedTuple):
    """Records of polygons for the kernels.

    forms  : (N, 12) float64, three linear forms of a point with four numbers each: height over the polygon's plane
             towards its front, and coordinates along its two edges, 0 to 1 inside
    bounds : (N, 6) float64, box that must contain a sliver's hit
    flags  : (N,) uint8, bits PARALLELOGRAM (otherwise a triangle), SOLID and SLIVER
    length : (N,) float64, L1 norms of the normals: factors from rounding errors of coordinates to those of heights
    """

    forms: Float64
    bounds: Float64
    flags: NDArray[np.uint8]
    length: Float64


class Segment(NamedTuple):
    """Segment from point a to point b, for the kernels; own_a and own_b are the ends' polygons, -1 for none."""

    ax: float
    ay: float
    az: float
    bx: float
    by: float
    bz: float
    own_a: int
    own_b: int


@dataclass(frozen=True)
class Occluders:
    """Triangles and parallelograms that occlude.

    corners       : (N, 3, 3) float64, a corner and both neighbouring corners, counter-clockwise seen from the front
    parallelogram : (N,) bool, True for parallelograms, False for triangles
    solid         : (N,) bool, True for parts of closed surfaces, so that a segment that hits a back has also hit a
                    front
    shape         : (N,) int32, index of the scene's shape
    clear         : (N,) bool, True for polygons that do not occlude; None if all occlude
    culled        : (N,) bool, True for polygons with a culled back, which block only light from an emitter behind
                    them to a receiver in front of them; None if no back is culled
    """

    corners: Float64
    parallelogram: NDArray[np.bool_]
    solid: NDArray[np.bool_]
    shape: Int32
    clear: NDArray[np.bool_] | None = None
    culled: NDArray[np.bool_] | None = None

    @classmethod
    def of_scene(cls, scene: Scene, *, culling: bool = False) -> Occluders:
        """Return a scene's triangles as occluders, in which two successive triangles may form one parallelogram.

        Spheres and planes of the scene are left out. Visibility is binary: a polygon that is partly transparent or
        of glass occludes if it is at least half opaque.

        culling : True if culled backs do not occlude for receivers behind them; False if they occlude
        """
        shape = scene.triangle_shape
        triangles = np.ascontiguousarray(scene.triangles, np.float64)
        count = len(triangles)
        corners, first, two = np.empty((count, 3, 3)), np.empty(count, np.int32), np.zeros(count, np.bool_)
        n = _parallelograms(triangles, shape, corners, first, two)
        corners, first, two = corners[:n].copy(), first[:n].copy(), two[:n].copy()
        closed = closed_shapes(scene)
        clear = None
        appearance = Appearance(scene)
        see_through = appearance.varies("opacity") | (appearance.clear_shares() > 0)
        if see_through.any():
            opacity = appearance.mean_opacity() * (1.0 - appearance.mean_clear().mean(axis=1))
            clear = np.where(
                two, 0.5 * (opacity[first] + opacity[np.minimum(first + 1, count - 1)]), opacity[first]
            )
            clear = clear < _CLEAR
            closed &= ~see_through
        culled = appearance.culled[first] if culling and appearance.culled.any() else None
        return cls(corners, two, closed[shape[first]], shape[first], clear, culled)

    @classmethod
    def of_triangles(cls, triangles: ArrayLike) -> Occluders:
        """Return triangles (N, 3, 3) as occluders, unmerged."""
        corners = np.ascontiguousarray(triangles, np.float64)
        if corners.ndim != 3 or corners.shape[1:] != (3, 3):
            raise UsageError(f"Occluders.of_triangles: shape {corners.shape}; must be (N, 3, 3).")
        n = len(corners)
        return cls(corners, np.zeros(n, bool), np.zeros(n, bool), np.zeros(n, np.int32))

    def __len__(self) -> int:
        return len(self.corners)

    @cached_property
    def size(self) -> float:
        """Largest absolute coordinate of the occluders, to which rounding errors are proportional."""
        return float(np.abs(self._outlines()).max(initial=np.finfo(float).tiny))

    @property
    def slack(self) -> float:
        """Length by which a shaft has to be larger than the hull of its points."""
        return _WIDER * self.size

    @cached_property
    def normals(self) -> Float64:
        """Unit normals (N, 3) on the front side; meaningless for polygons without an area."""
        n = self._normals()
        return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(float).tiny))

    @property
    def areas(self) -> Float64:
        """Areas (N,) in scene units squared."""
        return np.asarray(np.linalg.norm(self._normals(), axis=1) * np.where(self.parallelogram, 1.0, 0.5))

    def boxes(self) -> tuple[Float64, Float64]:
        """Return lower and upper corners of the boxes, (N, 3) each, widened for a BVH."""
        outlines = self._outlines()
        wide = 2 * _WIDER * self.size
        return outlines.min(axis=1) - wide, outlines.max(axis=1) + wide

    def polygons(self, solids: bool) -> Polygons:
        """Return the kernels' records of the polygons.

        solids : True if polygons of closed surfaces block only segments that come from their front
        """
        corner = self.corners[:, 0]
        e1, e2 = self.corners[:, 1] - corner, self.corners[:, 2] - corner
        normal, front_only = self._normals(), self.solid & solids
        if self.culled is not None:
            # A polygon with a culled back is flipped and treated as a solid's. It then blocks only segments from
            # emitters behind the original polygon.
            e1, e2 = np.where(self.culled[:, None], e2, e1), np.where(self.culled[:, None], e1, e2)
            normal = np.where(self.culled[:, None], -normal, normal)
            front_only = front_only | self.culled
        square = np.einsum("ij,ij->i", normal, normal)
        proper = square > np.finfo(float).tiny * 2**52
        if self.clear is not None:
            proper &= ~self.clear
        over = np.where(proper, square, 1.0)[:, None]
        forms = np.zeros((len(self), 3, 4))
        for k, direction in enumerate((normal, np.cross(e2, normal) / over, np.cross(normal, e1) / over)):
            forms[:, k, :3] = direction
            forms[:, k, 3] = -np.einsum("ij,ij->i", direction, corner)
        forms[~proper] = 0  # heights are 0, so that polygons without area and clear ones block nothing
        outlines = self._outlines()
        wide = _WIDER * self.size
        bounds = np.concatenate([outlines.min(axis=1) - wide, outlines.max(axis=1) + wide], axis=1)
        edges = np.linalg.norm(e1, axis=1) * np.linalg.norm(e2, axis=1)
        sliver = ~(np.sqrt(square) > _THIN * edges)
        flags = PARALLELOGRAM * self.parallelogram + SOLID * front_only + SLIVER * sliver
        length = np.abs(forms[:, 0, :3]).sum(axis=1)
        return Polygons(forms.reshape(-1, 12), bounds, flags.astype(np.uint8), length)

    def check_points(self, points: Float64, name: str) -> None:
        """Raise UsageError for points so far away that rounding errors could exceed the tolerances."""
        if points.ndim != 2 or points.shape[1] != 3:
            raise UsageError(f"{name}: shape {points.shape}; must be (n, 3).")
        largest = np.abs(points).max(initial=0.0)
        if not largest <= _FARTHEST * self.size and len(self):
            raise UsageError(
                f"{name}: a coordinate is {largest:g}, but those of the occluders go to {self.size:g} only.",
                f"Points must be finite and within {_FARTHEST:g} times that: is it another unit of length?",
            )

    def _normals(self) -> Float64:
        corner = self.corners[:, 0]
        return np.cross(self.corners[:, 1] - corner, self.corners[:, 2] - corner)

    def _outlines(self) -> Float64:
        """Return (N, 4, 3), all corners; a triangle's last corner is repeated."""
        a, b, c = self.corners[:, 0], self.corners[:, 1], self.corners[:, 2]
        fourth = np.where(self.parallelogram[:, None], b + c - a, c)
        return np.stack([a, b, c, fourth], axis=1)


def closed_shapes(scene: Scene) -> NDArray[np.bool_]:
    """Return (S,) bool, True for shapes of triangles in which every edge occurs once in each direction.

    Vertices are compared exactly.
    """
    shape = np.repeat(scene.triangle_shape.astype(np.int64), 3)
    vertex = shape
    for coordinate in scene.triangles.reshape(-1, 3).T:
        value = np.unique(coordinate, return_inverse=True)[1]
        vertex = np.unique(vertex << 32 | value, return_inverse=True)[1]
    following = np.roll(vertex.reshape(-1, 3), -1, axis=1).ravel()
    edges, reversed_edges = vertex << 32 | following, following << 32 | vertex
    order = np.argsort(edges)
    found = edges[order]
    repeated = order[1:][found[1:] == found[:-1]]
    single = found[np.searchsorted(found[:-1], reversed_edges)] != reversed_edges
    closed = np.array([s.primitive == "triangle" for s in scene.shapes], bool)
    closed &= np.bincount(scene.triangle_shape, minlength=len(closed)) > 0
    closed[shape[repeated]] = closed[shape[single]] = False
    return closed


@kernel
def _parallelograms(triangles, shape, corners, first, two):  # type: ignore[no-untyped-def]
    """Merge successive triangles that form a parallelogram; return the number of polygons.

    Fills corners (N, 3, 3), first triangle of each polygon (N,), and True if it was merged (N,).
    """
    count = len(triangles)
    n, i = 0, 0
    while i < count:
        apex = -1
        if i + 1 < count and shape[i] == shape[i + 1]:
            apex = _apex(triangles, i)
        for j in range(3):
            for k in range(3):
                corners[n, j, k] = triangles[i, (max(apex, 0) + j) % 3, k]
        first[n] = i
        two[n] = apex >= 0
        i += 2 if apex >= 0 else 1
        n += 1
    return n


@kernel_part
def _apex(triangles, t):  # type: ignore[no-untyped-def]
    """Return the corner of triangle t opposite to the next triangle; -1 if the two do not form a parallelogram.

    They form one if they share an edge, in opposite directions, whose midpoint is also that of the other corners.
    """
    a, b = triangles[t], triangles[t + 1]
    for i in range(3):
        for j in range(3):
            shared = True
            for k in range(3):
                shared = (
                    shared and a[(i + 1) % 3, k] == b[(j + 2) % 3, k] and a[(i + 2) % 3, k] == b[(j + 1) % 3, k]
                )
            if not shared:
                continue
            size, gap = 0.0, 0.0
            for k in range(3):
                size += abs(a[(i + 1) % 3, k]) + abs(a[(i + 2) % 3, k]) + abs(a[i, k])
                gap += abs(a[i, k] + b[j, k] - a[(i + 1) % 3, k] - a[(i + 2) % 3, k])
            if gap <= 1e-14 * size:
                return i
    return -1


@inner_kernel
def height(f0, f1, f2, f3, x, y, z):  # type: ignore[no-untyped-def]
    """Return the value of a linear form at a point. All tests use this function, so that they round equally."""
    return f0 * x + f1 * y + f2 * z + f3


@inner_kernel
def crosses(ha, ua, va, hb, ub, vb, parallelogram):  # type: ignore[no-untyped-def]
    """Return True if a segment crosses a polygon, given the polygon's three forms at the segment's ends.

    h is the height, positive at end a; u and v are the coordinates along the polygon's edges. The hit divides the
    segment in the ratio ha to -hb. All terms are multiplied by ha - hb, which saves the division. There are no
    branches, so that the code is vectorized.
    """
    d = ha - hb
    u = ha * ub - hb * ua
    v = ha * vb - hb * va
    within = (ha > ENDS * d) & (ha < (1 - ENDS) * d) & (u >= 0) & (v >= 0)
    # Inside a triangle, u + v is at most 1. Inside a parallelogram, u and v are each at most 1. Here 1 becomes d.
    return within & ((u <= d) & (v <= d) if parallelogram else u + v <= d)


@inner_kernel
def hits(x, segment, polygons):  # type: ignore[no-untyped-def]
    """Return True if polygon x crosses a segment; all other tests must agree with this one."""
    ax, ay, az, bx, by, bz, _, _ = segment
    forms, bounds = polygons.forms, polygons.bounds
    f0, f1, f2, f3 = forms[x, 0], forms[x, 1], forms[x, 2], forms[x, 3]
    ha, hb = height(f0, f1, f2, f3, ax, ay, az), height(f0, f1, f2, f3, bx, by, bz)
    if (ha > 0) == (hb > 0):
        return False
    flag = polygons.flags[x]
    if ha <= 0:
        if flag & SOLID:
            return False
        ha, hb = -ha, -hb
    f0, f1, f2, f3 = forms[x, 4], forms[x, 5], forms[x, 6], forms[x, 7]
    ua, ub = height(f0, f1, f2, f3, ax, ay, az), height(f0, f1, f2, f3, bx, by, bz)
    f0, f1, f2, f3 = forms[x, 8], forms[x, 9], forms[x, 10], forms[x, 11]
    va, vb = height(f0, f1, f2, f3, ax, ay, az), height(f0, f1, f2, f3, bx, by, bz)
    if not crosses(ha, ua, va, hb, ub, vb, flag & PARALLELOGRAM != 0):
        return False
    if not flag & SLIVER:
        return True
    t = ha / (ha - hb)
    px, py, pz = ax + t * (bx - ax), ay + t * (by - ay), az + t * (bz - az)
    return (
        bounds[x, 0] <= px <= bounds[x, 3]
        and bounds[x, 1] <= py <= bounds[x, 4]
        and bounds[x, 2] <= pz <= bounds[x, 5]
    )


@kernel_part
def never_hit(x, a, b, polygons, size):  # type: ignore[no-untyped-def]
    """Return True if polygon x cannot block a segment from box a to box b, as both lie on one side of its plane.

    One box may also touch the plane, because the hit would be within `ENDS` of the segment's end. Also True for a
    polygon of a closed solid if box a is behind it, because a segment enters the solid by another polygon
    [SC, Enhancements]. `size` is the occluders' largest coordinate.
    """
    forms = polygons.forms
    min_a = max_a = min_b = max_b = forms[x, 3]
    for k in range(3):
        f = forms[x, k]
        i, j = (k, k + 3) if f > 0 else (k + 3, k)
        min_a += f * a[i]
        max_a += f * a[j]
        min_b += f * b[i]
        max_b += f * b[j]
    tiny = _ROUNDING * size * polygons.length[x]
    far = 2 * tiny / ENDS
    if (min_a > tiny and min_b > tiny) or (max_a < -tiny and max_b < -tiny):
        return True
    if (min_a >= -tiny and min_b >= far) or (min_a >= far and min_b >= -tiny):
        return True
    if (max_a <= tiny and max_b <= -far) or (max_a <= -far and max_b <= tiny):
        return True
    return polygons.flags[x] & SOLID and max_a < -tiny
