"""Shaft: the volume between two boxes, and tests of boxes and spheres against it [SC].

The shaft is the convex hull of the two boxes. Its faces are those of the extent box around both, and at most eight
planes. Each plane goes through a pair of parallel edges and cuts off an edge of the extent box.

The test never classifies a box outside the shaft as overlapping. The paper assumes this; here is why. Two convex
bodies are separate exactly if a facet normal of their Minkowski difference separates them. For all directions in an
octant, a box's support is one corner, and the hull's support is the farther of two corners. Within an octant, only
the plane of directions in which these two are equally far can bend the difference's support. Facet normals are
intersections of such bends: the axes, and directions of that plane with one coordinate 0. The former are the faces
of the extent box. The latter are the planes of the plane set, all of which are tested. Spheres have other normals.

Cost:     at most eight planes of four operations each to form a shaft; at most two products per plane to test a
          box.
Poor at:  boxes far larger than their contents, such as the box of a wide diagonal polygon.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", Eurographics Workshop on Rendering,
1991. [Arvo 1990] J. Arvo, "A simple method for box-sphere intersection testing", Graphics Gems, 335-339.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.accel.bvh import Float64, Int32
from glpath.accel.nodes import Bvh, Tree
from glpath.errors import UsageError
from glpath.system.kernels import inner_kernel, kernel, outer

#: Order of a box's six numbers, offsets and faces: lo.x lo.y lo.z hi.x hi.y hi.z.
FACES = ("MIN_X", "MIN_Y", "MIN_Z", "MAX_X", "MAX_Y", "MAX_Z")
MAX_PLANES = 8


class Containment(IntEnum):
    """Position of a box or a sphere relative to a shaft."""

    OUTSIDE = 0
    OVERLAPPING = 1
    INSIDE = 2


class Strategy(IntEnum):
    """Treatment of a box of several items that is not outside [SC, Creating the Candidate List].

    KEEP_CLOSED  : it becomes a candidate. The list is the fastest, the rays are the slowest
    ALWAYS_OPEN  : it is opened, so that the list holds objects only
    OVERLAP_OPEN : it becomes a candidate if it is inside, because rays may miss it; it is opened if it overlaps
    RATIO_OPEN   : as OVERLAP_OPEN, but an overlapping box stays closed if more than the fraction `ratio` of its
                   children is not outside. A single such child replaces its parent
    """

    KEEP_CLOSED = 0
    ALWAYS_OPEN = 1
    OVERLAP_OPEN = 2
    RATIO_OPEN = 3


_OUTSIDE, _OVERLAPPING, _INSIDE = (int(p) for p in Containment)
_ENCLOSING = 3  # overlaps and contains a whole reference box, so that every ray hits it
_KEEP_CLOSED, _ALWAYS_OPEN, _OVERLAP_OPEN, _RATIO_OPEN = (int(s) for s in Strategy)


@dataclass(frozen=True)
class Shaft:
    """Convex hull of two boxes, formed as in the paper.

    box_a, box_b     : (6,) float64, reference boxes: lo.x lo.y lo.z hi.x hi.y hi.z
    extent           : (6,) float64, box around both, `slack` larger on every side
    faces_a, faces_b : names of the extent box's faces that only that reference box reaches, such as "MIN_X"
    planes           : (P, 4) float64, outward normal (not of unit length, one coordinate is 0) and distance; a
                       point x is outside if normal . x + distance > 0
    near, far        : (P, 3) int64, indices into a box's six numbers for each plane: corner nearest to the inside,
                       and farthest corner

    Example
    -------
    >>> shaft = Shaft.between([[0, 0, 0], [1, 1, 0]], [[0, 0, 5], [1, 1, 5]])
    >>> shaft.classify([[[0.2, 0.2, 2], [0.4, 0.4, 3]], [[2, 0, 2], [3, 1, 3]]]).tolist()  # inside, outside
    [2, 0]
    """

    box_a: Float64
    box_b: Float64
    extent: Float64
    faces_a: tuple[str, ...]
    faces_b: tuple[str, ...]
    planes: Float64
    near: NDArray[np.int64]

    @property
    def far(self) -> NDArray[np.int64]:
        return (self.near + 3) % 6

    @classmethod
    def between(
        cls, box_a: ArrayLike, box_b: ArrayLike, *, slack: float = 0.0, min_cut: float | None = None
    ) -> Shaft:
        """Build the shaft between two boxes, each [lower, upper] or six numbers; they may be flat, equal or nested.

        Parameters
        ----------
        slack     : length by which the shaft is larger on every side, so that rounding does not lose boxes that
                    touch it
        min_cut : minimum volume that a plane cuts off the extent box, as a fraction of the box. Planes are sorted
                    by this volume, largest first, and smaller ones are left out [SC, Future Work]. None keeps all
                    planes unsorted
        """
        a, b = _box(box_a, "box_a"), _box(box_b, "box_b")
        formed = FormedShaft.between(a, b)
        _form_shaft(formed, slack, -1.0 if min_cut is None else min_cut)
        n = formed.size[0]
        faces_a = tuple(name for f, name in enumerate(FACES) if _beyond(a, b, f))
        faces_b = tuple(name for f, name in enumerate(FACES) if _beyond(b, a, f))
        full, corners = _with_three_axes(formed.planes[:n], formed.near[:n])
        return cls(a, b, formed.extent, faces_a, faces_b, full, corners)

    def classify(self, boxes: ArrayLike) -> NDArray[np.int8]:
        """Return (N,) int8 of `Containment` for boxes (N, 2, 3), lower and upper corners, or (N, 6)."""
        given = np.ascontiguousarray(boxes, np.float64)
        if given.ndim < 2 or given[0:1].size not in (0, 6) or given.size % 6:
            raise UsageError(f"Shaft.classify: boxes of shape {given.shape}; allowed are (N, 2, 3) and (N, 6).")
        each = given.reshape(-1, 6)
        found = np.empty(len(each), np.int8)
        _classify_boxes(each, FormedShaft.of(self), found)
        return found

    def classify_spheres(self, centres: ArrayLike, radii: ArrayLike) -> NDArray[np.int8]:
        """Return (N,) int8 of `Containment` for spheres with centres (N, 3) and radii (N,) >= 0.

        Near an edge of the shaft, a sphere outside may be classified as overlapping [SC, figure 4], but never the
        reverse. INSIDE means T < -radius; the paper prints this comparison reversed.
        """
        centre = np.ascontiguousarray(centres, np.float64).reshape(-1, 3)
        radius = np.ascontiguousarray(np.broadcast_to(np.asarray(radii, np.float64), len(centre)))
        if not (radius >= 0).all():
            raise UsageError(f"Shaft.classify_spheres: a radius is {radius.min():g}; allowed are those from 0.")
        unit = self.planes / np.linalg.norm(self.planes[:, :3], axis=1, keepdims=True)
        found = np.empty(len(centre), np.int8)
        _classify_spheres(centre, radius, self.box_a, self.box_b, self.extent, unit, found)
        return found


class FormedShaft(NamedTuple):
    """Record of a `Shaft` for the kernels.

    a, b   : (6,) float64, reference boxes
    extent : (6,) float64, box around both
    planes : (8, 4) float64, the two coordinates of the normal that are not 0, the distance, and the fraction that
             the plane cuts off, if requested
    near   : (8, 2) int64, indices into a box's six numbers for both coordinates; the axis is the index modulo 3
    size   : (1,) int64, number of planes
    """

    a: Float64
    b: Float64
    extent: Float64
    planes: Float64
    near: NDArray[np.int64]
    size: NDArray[np.int64]

    @classmethod
    def between(cls, a: Float64, b: Float64) -> FormedShaft:
        """Allocate the shaft between two boxes, which `form_shaft` fills."""
        planes, near = np.empty((MAX_PLANES, 4)), np.empty((MAX_PLANES, 2), np.int64)
        return cls(a, b, np.empty(6), planes, near, np.zeros(1, np.int64))

    @classmethod
    def of(cls, shaft: Shaft) -> FormedShaft:
        planes, near = _with_two_axes(shaft.planes, shaft.near)
        return cls(shaft.box_a, shaft.box_b, shaft.extent, planes, near, np.array([len(planes)]))


class Opening(NamedTuple):
    """Rule that opens boxes of several items: a `Strategy`, its ratio, and True to open enclosing boxes."""

    strategy: int
    ratio: float
    enclosing: bool


class CandidateLists(NamedTuple):
    """Lists of candidates one after the other, and working memory of `gather`.

    nodes   : (L,) int32, nodes of the tree
    flags   : (L,) int8, flag of each node, see `classify_box`
    objects : (L,) int32, polygon of a leaf or -1; empty if only nodes are requested
    mark    : (M,) int64, number of the latest shaft that found this node outside while its parent became a
              candidate [SC, Enhancements: mailbox]. Empty if nodes are not marked
    stack   : (M + 1, 3) int32, nodes still to be tested: node, flag and containment
    """

    nodes: Int32
    flags: NDArray[np.int8]
    objects: Int32
    mark: NDArray[np.int64]
    stack: Int32

    @classmethod
    def empty(cls, nodes: int, room: int, objects: int = 0, mailbox: bool = False) -> CandidateLists:
        """Allocate for a tree of `nodes` nodes, `room` candidates and `objects` polygons."""
        return cls(
            np.empty(room, np.int32),
            np.empty(room, np.int8),
            np.empty(objects, np.int32),
            np.zeros(nodes if mailbox else 0, np.int64),
            np.empty((nodes + 1, 3), np.int32),
        )


def candidate_list(
    bvh: Bvh,
    shaft: Shaft,
    strategy: Strategy = Strategy.RATIO_OPEN,
    *,
    ratio: float = 0.4,
    open_enclosing: bool = True,
) -> Int32:
    """Return the nodes whose items may occlude one box of a shaft from the other.

    Items that are below none of these nodes are outside the shaft. If no node is returned, nothing occludes.
    Source: [SC, Creating the Candidate List].

    Parameters
    ----------
    ratio          : fraction of children, see `Strategy.RATIO_OPEN`
    open_enclosing : True to open nodes that enclose one of the two boxes, with any strategy, because every ray
                     would hit such nodes

    Returns (n,) int32, nodes of the BVH: leaves, and nodes that the strategy keeps closed.
    """
    tree = Tree.of(bvh)
    n = len(tree.skip)
    roots = min(n, 1)
    lists = CandidateLists.empty(n, n + roots)
    # Start at the root; its overlap with the first box is unknown.
    lists.nodes[:roots], lists.flags[:roots] = 0, -1
    opening = Opening(int(strategy), float(ratio), open_enclosing)
    end, _ = _gather(tree, FormedShaft.of(shaft), opening, lists, 0, roots, 0, n)
    return lists.nodes[roots:end]


def _box(box: ArrayLike, name: str) -> Float64:
    corners = np.array(box, np.float64)
    if (
        corners.size != 6
        or not np.isfinite(corners).all()
        or not (corners.ravel()[:3] <= corners.ravel()[3:]).all()
    ):
        raise UsageError(
            f"Shaft.between: {name} is {corners.tolist()}; a box is its lower and its upper corner, both finite."
        )
    return corners.reshape(6)


def _with_three_axes(planes: Float64, near: NDArray[np.int64]) -> tuple[Float64, NDArray[np.int64]]:
    """Convert the kernels' planes of two coordinates, (P, 4) and (P, 2), to the paper's (P, 4) and (P, 3)."""
    rows = np.arange(len(planes))
    full = np.zeros((len(planes), 4))
    corner = np.tile(np.arange(3), (len(planes), 1))  # if the normal is 0 there, either corner is right
    for k in range(2):
        full[rows, near[:, k] % 3] = planes[:, k]
        corner[rows, near[:, k] % 3] = near[:, k]
    full[:, 3] = planes[:, 2]
    return full, corner


def _with_two_axes(planes: Float64, near: NDArray[np.int64]) -> tuple[Float64, NDArray[np.int64]]:
    rows = np.arange(len(planes))[:, None]
    axes = np.argsort(planes[:, :3] == 0, axis=1, kind="stable")[:, :2]
    return np.concatenate([planes[rows, axes], planes[:, 3:]], axis=1), np.ascontiguousarray(near[rows, axes])


@inner_kernel
def _beyond(a, b, face):  # type: ignore[no-untyped-def]
    """Return True if only box a reaches that face of the box around both."""
    return a[face] < b[face] if face < 3 else a[face] > b[face]


@inner_kernel
def form_shaft(shaft, slack, min_cut):  # type: ignore[no-untyped-def]
    """Fill in the planes and the extent of the shaft between its boxes, see `Shaft.between`."""
    a, b, extent, planes, near, size = shaft
    for k in range(3):
        extent[k] = min(a[k], b[k]) - slack
        extent[k + 3] = max(a[k + 3], b[k + 3]) + slack
    n = 0
    for f in range(6):
        if not _beyond(a, b, f):
            continue
        for g in range(6):
            i, j = f % 3, g % 3
            if i == j or not _beyond(b, a, g):
                continue
            # The plane cuts off the extent box's edge between the faces f and g. It goes through the parallel edges
            # of a and b between their faces f and g.
            across, along = abs(a[f] - b[f]), abs(b[g] - a[g])
            ni = along if f >= 3 else -along
            nj = across if g >= 3 else -across
            distance = -(ni * a[f] + nj * a[g]) - slack * (along + across)
            cut = 0.0
            if min_cut >= 0:
                # The plane cuts off a prism. Its base is half a rectangle, relative to the box's cross-section.
                cut = 0.5 * (across / (extent[i + 3] - extent[i])) * (along / (extent[j + 3] - extent[j]))
                if cut < min_cut:
                    continue
            at = n
            while at > 0 and cut > planes[at - 1, 3]:  # stable insertion sort; all cuts are 0 without `min_cut`
                for k in range(4):
                    planes[at, k] = planes[at - 1, k]
                for k in range(2):
                    near[at, k] = near[at - 1, k]
                at -= 1
            planes[at, 0], planes[at, 1], planes[at, 2], planes[at, 3] = ni, nj, distance, cut
            near[at, 0] = i if f >= 3 else i + 3
            near[at, 1] = j if g >= 3 else j + 3
            n += 1
    size[0] = n


@inner_kernel
def overlaps(boxes, i, other):  # type: ignore[no-untyped-def]
    """Return True if boxes[i] overlaps the box `other`.

    The box is passed by its index, because creating an array view takes as long as the test.
    """
    return (
        boxes[i, 0] <= other[3] and other[0] <= boxes[i, 3]
        and boxes[i, 1] <= other[4] and other[1] <= boxes[i, 4]
        and boxes[i, 2] <= other[5] and other[2] <= boxes[i, 5]
    )  # fmt: skip


@inner_kernel
def encloses(boxes, i, other):  # type: ignore[no-untyped-def]
    """Return True if boxes[i] encloses the box `other`."""
    return (
        boxes[i, 0] <= other[0] and other[3] <= boxes[i, 3]
        and boxes[i, 1] <= other[1] and other[4] <= boxes[i, 4]
        and boxes[i, 2] <= other[2] and other[5] <= boxes[i, 5]
    )  # fmt: skip


@inner_kernel
def classify_box(boxes, i, flag, shaft, whole):  # type: ignore[no-untyped-def]
    """Return the `Containment` of boxes[i], or `_ENCLOSING`; INSIDE is only detected if `whole`.

    flag : overlap of the box with reference box a, the emitter's [SC, Enhancements]: 1 overlap, 0 no overlap, -1
           unknown. If it is known, the box does not enclose a
    """
    a, b, planes, near = shaft.a, shaft.b, shaft.planes, shaft.near
    touches = flag == 1
    if not touches:
        if not overlaps(boxes, i, shaft.extent):
            return _OUTSIDE
        if flag < 0 and overlaps(boxes, i, a):
            touches = True
            if encloses(boxes, i, a):
                return _ENCLOSING
    if overlaps(boxes, i, b):
        if encloses(boxes, i, b):
            return _ENCLOSING
    elif not touches:
        for p in range(shaft.size[0]):
            if planes[p, 0] * boxes[i, near[p, 0]] + planes[p, 1] * boxes[i, near[p, 1]] + planes[p, 2] > 0:
                return _OUTSIDE
    return _INSIDE if whole and _within(boxes, i, shaft) else _OVERLAPPING


@inner_kernel
def _within(boxes, i, shaft):  # type: ignore[no-untyped-def]
    """Return True if all of boxes[i] is in the shaft."""
    extent, planes, near = shaft.extent, shaft.planes, shaft.near
    for k in range(3):
        if boxes[i, k] < extent[k] or boxes[i, k + 3] > extent[k + 3]:
            return False
    for p in range(shaft.size[0]):
        j, k = (near[p, 0] + 3) % 6, (near[p, 1] + 3) % 6
        if planes[p, 0] * boxes[i, j] + planes[p, 1] * boxes[i, k] + planes[p, 2] > 0:
            return False
    return True


@kernel
def _classify_boxes(boxes, shaft, found):  # type: ignore[no-untyped-def]
    for i in range(len(boxes)):
        containment = classify_box(boxes, i, np.int64(-1), shaft, True)
        if containment == _ENCLOSING:  # may also be inside, if it is as large as the shaft
            containment = _INSIDE if _within(boxes, i, shaft) else _OVERLAPPING
        found[i] = containment


@kernel
def _classify_spheres(centres, radii, a, b, extent, planes, found):  # type: ignore[no-untyped-def]
    """Fill in the `Containment` of spheres; planes (P, 4) have unit normals."""
    for i in range(len(centres)):
        c, r = centres[i], radii[i]
        if _distance_squared(c, extent) > r * r:
            found[i] = _OUTSIDE
            continue
        found[i] = _OVERLAPPING
        inside = True
        for k in range(3):
            inside = inside and c[k] - r >= extent[k] and c[k] + r <= extent[k + 3]
        touches = _distance_squared(c, a) <= r * r or _distance_squared(c, b) <= r * r
        for p in range(len(planes)):
            t = planes[p, 0] * c[0] + planes[p, 1] * c[1] + planes[p, 2] * c[2] + planes[p, 3]
            if t > r and not touches:
                found[i] = _OUTSIDE
                inside = False
                break
            inside = inside and t <= -r
        if inside:
            found[i] = _INSIDE


@inner_kernel
def _distance_squared(point, box):  # type: ignore[no-untyped-def]
    """Return the squared distance from a point to a box [Arvo 1990]."""
    total = 0.0
    for k in range(3):
        d = max(max(box[k] - point[k], point[k] - box[k + 3]), 0.0)
        total += d * d
    return total


@inner_kernel
def gather(tree, shaft, opening, lists, begin, end, number, max_candidates):  # type: ignore[no-untyped-def]
    """Append the candidates found at or below the list entries `begin` to `end`; see `candidate_list`.

    number         : number of the shaft, for marks
    max_candidates : maximum number of candidates; the search stops if there are more

    Returns the new end, or -1 if the search stopped, and the number of tested boxes.
    """
    strategy, ratio, open_enclosing = opening
    whole = strategy in (_OVERLAP_OPEN, _RATIO_OPEN)
    boxes, skip, items = tree.boxes, tree.skip, tree.items
    nodes, flags, mark, stack = lists.nodes, lists.flags, lists.mark, lists.stack
    tests = 0
    size = end
    for r in range(begin, end):
        stack[0, 0], stack[0, 1], stack[0, 2] = nodes[r], flags[r], -1
        top = 1
        while top:
            top -= 1
            node, flag, containment = np.int64(stack[top, 0]), np.int64(stack[top, 1]), np.int64(stack[top, 2])
            if containment < 0:
                tests += 1
                containment = classify_box(boxes, node, flag, shaft, whole)
            if containment == _OUTSIDE:
                continue
            opened = strategy == _ALWAYS_OPEN or (containment == _ENCLOSING and open_enclosing)
            opened = opened or (strategy == _OVERLAP_OPEN and containment != _INSIDE)
            keep = items[node] > 0 or not (opened or (strategy == _RATIO_OPEN and containment != _INSIDE))
            if not keep:
                # A child's box overlaps the emitter's only if its parent's does.
                below = 0 if flag == 0 else -1
                base, children = top, 0
                child = node + 1
                while child < skip[node]:
                    children += 1
                    containment = np.int64(-1)
                    if not opened:
                        tests += 1
                        containment = classify_box(boxes, child, below, shaft, whole)
                    if containment != _OUTSIDE:
                        stack[top, 0], stack[top, 1], stack[top, 2] = child, below, containment
                        top += 1
                    elif len(mark):
                        mark[child] = number
                    child = np.int64(skip[child])
                if not opened and top - base > 1 and top - base > ratio * children:
                    top = base
                    keep = True
            if keep:
                if size - end >= max_candidates:
                    return -1, tests
                nodes[size], flags[size] = node, flag
                size += 1
    return size, tests


# Variants that Python can call.
_form_shaft, _gather = outer(form_shaft), outer(gather)
