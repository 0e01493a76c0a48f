"""Group receiver points into clumps of nearby points that share a shaft.

A shaft should be narrow enough to be empty and wide enough to be worth its cost. The paper makes one shaft per
receiver, and leaves clumps, nested shafts and shafts for several receivers to the future [SC, Future Work]. Here
each of these shafts serves a range of points, and all ranges refer to one common order of the points.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.bvh import Float64, Int32, build_bvh
from glpath.radiosity.shafts.sorting import merge_sort
from glpath.system.kernels import inner_kernel, kernel, kernel_part
from glpath.system.time_limit import check_time

#: Maximum number of points of a nested shaft, as a fraction of the enclosing shaft's points. Larger ranges get no
#: shaft of their own.
_PART = 0.25


#: Value instead of a polygon's index if points of a group lie on different polygons.
SEVERAL = -2


class Groups(NamedTuple):
    """Ranges of points that share a shaft, as a forest of M nodes in depth-first order.

    order      : (P,) int64, indices of the points; a group is order[begin : end]
    boxes      : (M, 6) float64, boxes around the points
    skip       : (M,) int64, node after a group and its parts
    begin, end : (M,) int64
    polygon    : (M,) int64, occluder that contains all points; -1 for none, SEVERAL if they lie on different ones
    normal     : (M, 3) float64, common unit normal of all points; 0 if their normals differ
    levels     : maximum number of nested groups that contain a point
    """

    order: NDArray[np.int64]
    boxes: Float64
    skip: NDArray[np.int64]
    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    polygon: NDArray[np.int64]
    normal: Float64
    levels: int

    def parts(self, number: int) -> list[slice]:
        """Split the nodes into at most `number` ranges with similar numbers of points; each tree stays in one."""
        roots = []
        node = 0
        while node < len(self.skip):
            roots.append(node)
            node = int(self.skip[node])
        starts = self.begin[roots]
        wanted = np.arange(1, number) * len(self.order) // number
        cuts = np.unique(np.searchsorted(starts, wanted, side="left"))
        nodes = [0, *(roots[c] for c in cuts if 0 < c < len(roots)), len(self.skip)]
        return [slice(a, b) for a, b in pairwise(nodes)]


def group_points(
    points: Float64,
    receiver: Int32,
    normals: Float64 | None,
    polygons: Int32 | None,
    clump: int,
    group: int,
    nested: bool,
) -> Groups:
    """Divide points into clumps, whose points share a shaft, and collect neighbouring receivers in groups.

    With groups, several receivers share a clump if they are small enough.

    clump  : maximum number of points of a clump; 0 to divide no receiver
    group  : maximum number of points of a group of receivers; 0 for no groups
    nested : True if groups and receivers also have shafts of their own, around those of their clumps
    """
    count = len(points)
    start = np.flatnonzero(np.diff(receiver, prepend=receiver[0] - 1))
    polygon = polygons if polygons is not None else np.full(count, -1, np.int32)
    if group:
        lower = np.minimum.reduceat(points, start)
        tree = build_bvh(lower, np.maximum.reduceat(points, start), 1)
        skip, leaves = tree.skip.astype(np.int64), tree.order
    else:
        leaves = np.arange(len(start), dtype=np.int32)
        skip = np.arange(1, len(start) + 1)
    size = np.diff(start, append=count)
    order = np.concatenate([np.arange(start[i], start[i] + size[i]) for i in leaves])
    max_nodes = 4 * count + len(skip)
    boxes = np.empty((max_nodes, 6))
    skips, begin, end, of_polygon = np.empty((4, max_nodes), np.int64)
    arrays = (
        np.ascontiguousarray(points),
        np.ascontiguousarray(polygon, np.int32),
        _Forest(skip, size[leaves], np.empty(len(skip) + 1, np.int64)),
        _Division(clump or count, group or count, nested),
        Groups(order, boxes, skips, begin, end, of_polygon, np.zeros((0, 3)), 0),
        _Workspace.of(count, max_nodes),
    )
    state = np.zeros(5, np.int64)
    while state[_ROOT] < len(skip):
        check_time()
        _groups(*arrays, state, _VISITS)
    n, levels = state[:2].tolist()
    skips, begin, end, of_polygon = (a[:n].copy() for a in (skips, begin, end, of_polygon))
    normal = np.zeros((n, 3))
    if normals is not None:
        # Normals are equal in a range if no change of the normal lies inside it.
        sorted_normals = normals[order]
        changes = np.any(np.diff(sorted_normals, axis=0, prepend=sorted_normals[:1]) != 0, axis=1)
        changed = np.cumsum(changes)
        same = changed[begin] == changed[end - 1]
        unit = sorted_normals / np.linalg.norm(sorted_normals, axis=1, keepdims=True)
        normal[same] = unit[begin[same]]
    return Groups(order, boxes[:n].copy(), skips, begin, end, of_polygon, normal, levels)


class _Forest(NamedTuple):
    """Receivers, as a forest in depth-first order.

    skip   : (F,) int64, node after a node's subtree
    size   : (receivers,) int64, number of points of each leaf
    before : (F + 1,) int64, number of points before each node, filled by `_groups`
    """

    skip: NDArray[np.int64]
    size: NDArray[np.int64]
    before: NDArray[np.int64]


class _Division(NamedTuple):
    """Limits for dividing points, see `group_points`."""

    clump: int
    group: int
    nested: bool


class _Workspace(NamedTuple):
    """Working memory to group P points.

    pending         : (M + 2, 4), ranges still to visit: node of the forest (-1 below a receiver), begin, end,
                      number of points of the enclosing group (0: none). (-2, group) marks a group's end
    box             : (1, 6), box of a range
    keys, by, spare : (P,) working memory to sort points
    """

    pending: NDArray[np.int64]
    box: Float64
    keys: Float64
    by: NDArray[np.int64]
    spare: NDArray[np.int64]

    @classmethod
    def of(cls, points: int, groups: int) -> _Workspace:
        pending = np.empty((groups + 2, 4), np.int64)
        return cls(pending, np.empty((1, 6)), np.empty(points), *np.empty((2, points), np.int64))


# Number of points that one call of `_groups` visits, about a tenth of a second.
_VISITS = 1 << 20
# Index of the next root of the forest in the state of `_groups`.
_ROOT = 3


@kernel
def _groups(points, polygon, forest, division, groups, work, state, visits):  # type: ignore[no-untyped-def]
    """Fill the arrays of `groups` except the normals, and permute its order; see `group_points`.

    A call ends after about `visits` points, so that the caller can check the time, and the next call continues.

    state : (5,) int64, first zeros: number of groups; maximum number of nested groups that contain a point; present
            number; next root of the forest; number of ranges in `work.pending`
    """
    order, boxes, skips, begins, ends, polygons, _, _ = groups
    clump, group, nested = division
    skip, before, pending = forest.skip, forest.before, work.pending
    n, levels, level, root, waiting = state[0], state[1], state[2], state[3], state[4]
    if root == 0 and waiting == 0:
        before[0] = 0
        leaf = 0
        for node in range(len(skip)):
            before[node + 1] = before[node]
            if skip[node] == node + 1:
                before[node + 1] += forest.size[leaf]
                leaf += 1

    while root < len(skip) and visits > 0:
        if waiting == 0:
            _push(pending, 0, root, before[root], before[skip[root]], 0)
            waiting = 1
        while waiting and visits > 0:
            waiting -= 1
            node, begin, end, around = (
                pending[waiting, 0], pending[waiting, 1], pending[waiting, 2], pending[waiting, 3]
            )  # fmt: skip
            if node == -2:
                skips[begin] = n
                level -= 1
                continue
            points_here = end - begin
            visits -= points_here
            single = node < 0 or skip[node] == node + 1
            last = points_here <= clump
            made = last
            if nested and not last:
                made = points_here <= group if around == 0 else points_here <= _PART * around
            if made:
                _around(points, order, begin, end, boxes, n)
                begins[n], ends[n] = begin, end
                polygons[n] = polygon[order[begin]]
                for i in range(begin, end):
                    if polygon[order[i]] != polygons[n]:
                        polygons[n] = SEVERAL
                around = points_here
                level += 1
                levels = max(levels, level)
                _push(pending, waiting, -2, n, 0, 0)
                waiting += 1
                n += 1
            if last:
                continue
            if not single:
                child = node + 1
                children = 0
                while child < skip[node]:
                    _push(pending, waiting, child, before[child], before[skip[child]], around)
                    waiting += 1
                    children += 1
                    child = skip[child]
                for i in range(children // 2):  # reversed, so that the first child is on top
                    for k in range(4):
                        x = pending[waiting - children + i, k]
                        pending[waiting - children + i, k] = pending[waiting - 1 - i, k]
                        pending[waiting - 1 - i, k] = x
            else:
                middle = _halve(points, order, begin, end, work)
                _push(pending, waiting, -1, middle, end, around)
                _push(pending, waiting + 1, -1, begin, middle, around)
                waiting += 2
        if waiting == 0:
            root = skip[root]
    state[0], state[1], state[2], state[3], state[4] = n, levels, level, root, waiting


@inner_kernel
def _push(pending, at, node, begin, end, around):  # type: ignore[no-untyped-def]
    pending[at, 0], pending[at, 1], pending[at, 2], pending[at, 3] = node, begin, end, around


@inner_kernel
def _around(points, order, begin, end, boxes, at):  # type: ignore[no-untyped-def]
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(begin, end):
            x = points[order[i], k]
            low, high = min(low, x), max(high, x)
        boxes[at, k], boxes[at, k + 3] = low, high


@kernel_part
def _halve(points, order, begin, end, work):  # type: ignore[no-untyped-def]
    """Sort a range of points along the longest side of its box; return the index where its second half begins."""
    box, keys, by = work.box, work.keys, work.by
    _around(points, order, begin, end, box, 0)
    axis = 0
    for k in range(1, 3):
        if box[0, k + 3] - box[0, k] > box[0, axis + 3] - box[0, axis]:
            axis = k
    n = end - begin
    for i in range(n):
        keys[i], by[i] = points[order[begin + i], axis], i
    merge_sort(keys, by, work.spare, n)
    for i in range(n):
        by[i] = order[begin + by[i]]
    for i in range(n):
        order[begin + i] = by[i]
    return begin + n // 2
