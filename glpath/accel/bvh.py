"""Bounding volume hierarchy (BVH): what a ray or a shaft need not look at, found by a few box tests.

Built top down by the surface area heuristic over bins of centroids [Wald 2007], compiled by numba; no GL. For the
cones of rays of the ray tracer on the GPU and for the shafts of radiosity on the CPU.

Cost:     two or three seconds for a million boxes, a millisecond for a few hundred, on one core.
Poor at:  boxes that all overlap each other, such as the long diagonal slivers of a triangulated disc.

[Wald 2007] I. Wald, "On fast construction of SAH-based bounding volume hierarchies", IEEE Symposium on Interactive
Ray Tracing, 33-40.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.accel.nodes import Bvh, Tree
from glpath.errors import UsageError
from glpath.system.kernels import inner_kernel, kernel, kernel_part

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

BINS = 16
#: Testing the boxes of two children, in units of testing one item of a leaf.
NODE_COST = 2.0


def build_bvh(lower: ArrayLike, upper: ArrayLike, leaf_size: int = 4) -> Bvh:
    """A binary tree over boxes, the same one every time.

    Parameters
    ----------
    lower, upper : (N, 3) corners of the items' boxes, finite; they may be flat, points, or equal to each other
    leaf_size    : most items in a leaf. Fewer stand there where splitting pays; 1 gives every item a leaf of its
                   own, whose box is the item's

    Raises UsageError where the boxes are not finite or inside out.
    """
    low, high = checked_boxes(lower, upper)
    if leaf_size < 1:
        raise UsageError(f"build_bvh: leaf_size is {leaf_size}; allowed is a whole number from 1.")
    boxes = np.concatenate([low, high], axis=1)
    tree = Tree.empty(len(boxes))
    return tree.bvh(_build(boxes, int(leaf_size), tree, _Workspace.of(len(boxes))))


def checked_boxes(lower: ArrayLike, upper: ArrayLike) -> tuple[Float64, Float64]:
    """Corners as (N, 3) float64 each. Raises UsageError for another form, NaN, infinities, and boxes inside out."""
    low = np.ascontiguousarray(lower, np.float64)
    high = np.ascontiguousarray(upper, np.float64)
    if low.ndim != 2 or low.shape[1] != 3 or low.shape != high.shape:
        raise UsageError(f"boxes: corners of shape {low.shape} and {high.shape}; both must be (N, 3).")
    wrong = ~(np.isfinite(low) & np.isfinite(high) & (low <= high)).all(axis=1)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise UsageError(
            f"boxes[{i}]: from {low[i].tolist()} to {high[i].tolist()}, but corners must be finite and in order.",
            "What has no end, such as a plane, has no box: keep it out of the BVH.",
        )
    return low, high


@kernel
def _build(boxes, leaf_size, tree, work):  # type: ignore[no-untyped-def]
    """Fill the nodes of all ranges, depth first; return how many there are. Permutes `boxes` along with the tree's
    order, so that each range lies together."""
    skip, first, count, pending = tree.skip, tree.first, tree.items, work.pending
    n = len(boxes)
    pending[0, 0], pending[0, 1] = 0, n
    waiting = 1 if n else 0
    size = 0
    while waiting:
        waiting -= 1
        begin, end = pending[waiting, 0], pending[waiting, 1]
        middle = _split(boxes, begin, end, leaf_size, tree, size, work)
        first[size] = begin
        if middle == begin:
            count[size] = end - begin
        else:
            count[size] = 0
            pending[waiting, 0], pending[waiting, 1] = middle, end
            pending[waiting + 1, 0], pending[waiting + 1, 1] = begin, middle
            waiting += 2
        size += 1
    for node in range(size - 1, -1, -1):
        skip[node] = node + 1 if count[node] else skip[skip[node + 1]]
    return size


class _Workspace(NamedTuple):
    """Room to build in.

    pending      : (N + 1, 2), ranges yet to come; they are disjoint, so never more than items
    bins, filled : (BINS, 6) boxes and (BINS,) how many items are in each
    right_cost   : (BINS,) of what lies to the right of each
    around       : (1, 6), a box around what was passed
    """

    pending: NDArray[np.int64]
    bins: Float64
    filled: NDArray[np.int64]
    right_cost: Float64
    around: Float64

    @classmethod
    def of(cls, items: int) -> _Workspace:
        pending = np.empty((items + 1, 2), np.int64)
        return cls(pending, np.empty((BINS, 6)), np.empty(BINS, np.int64), np.empty(BINS), np.empty((1, 6)))


@kernel_part
def _split(boxes, begin, end, leaf_size, tree, node, work):  # type: ignore[no-untyped-def]
    """Write the range's box, part its items in two and return where the second begins; `begin` for a leaf."""
    nodes, order = tree.boxes, tree.order
    n = end - begin
    _clear(nodes, node)
    low0 = low1 = low2 = np.inf  # of the centroids
    high0 = high1 = high2 = -np.inf
    for i in range(begin, end):
        _enclose(nodes, node, boxes, i)
        x, y, z = _centre(boxes, i, 0), _centre(boxes, i, 1), _centre(boxes, i, 2)
        low0, low1, low2 = min(low0, x), min(low1, y), min(low2, z)
        high0, high1, high2 = max(high0, x), max(high1, y), max(high2, z)
    if n == 1:
        return begin

    # Cost is area times items; boxes in a line have no area at all, and then balance decides.
    best, best_lopsided, best_axis, best_bin = np.inf, n, -1, 0
    best_low = best_extent = 0.0
    bins, filled, right_cost, around = work.bins, work.filled, work.right_cost, work.around
    for k in range(3):
        low = low0 if k == 0 else (low1 if k == 1 else low2)
        extent = (high0 if k == 0 else (high1 if k == 1 else high2)) - low
        if not extent > 0:
            continue
        for b in range(BINS):
            _clear(bins, b)
            filled[b] = 0
        for i in range(begin, end):
            b = _bin(boxes, i, k, low, extent)
            filled[b] += 1
            _enclose(bins, b, boxes, i)
        _clear(around, 0)
        items = 0
        for b in range(BINS - 1, 0, -1):
            items += filled[b]
            _enclose(around, 0, bins, b)
            right_cost[b] = items * _area(around, 0) if items else np.inf
        _clear(around, 0)
        items = 0
        for b in range(1, BINS):
            items += filled[b - 1]
            _enclose(around, 0, bins, b - 1)
            if items == 0 or items == n:
                continue
            cost = items * _area(around, 0) + right_cost[b]
            lopsided = abs(n - 2 * items)
            if cost < best or (cost == best and lopsided < best_lopsided):
                best, best_lopsided, best_axis, best_bin = cost, lopsided, k, b
                best_low, best_extent = low, extent

    whole = _area(nodes, node)
    if n <= leaf_size and (best_axis < 0 or n * whole <= NODE_COST * whole + best):
        return begin
    if best_axis < 0:  # all centroids are one
        return begin + n // 2
    left, right = begin, end - 1
    while left <= right:
        if _bin(boxes, left, best_axis, best_low, best_extent) < best_bin:
            left += 1
        else:
            order[left], order[right] = order[right], order[left]
            for j in range(6):
                boxes[left, j], boxes[right, j] = boxes[right, j], boxes[left, j]
            right -= 1
    return left


# Below, an array and the index of a box in it instead of the box: making a view costs as much as its use.


@inner_kernel
def _centre(boxes, i, axis):  # type: ignore[no-untyped-def]
    return 0.5 * boxes[i, axis] + 0.5 * boxes[i, axis + 3]


@inner_kernel
def _bin(boxes, i, axis, low, extent):  # type: ignore[no-untyped-def]
    return min(int((_centre(boxes, i, axis) - low) / extent * BINS), BINS - 1)


@inner_kernel
def _clear(boxes, i):  # type: ignore[no-untyped-def]
    for j in range(3):
        boxes[i, j], boxes[i, j + 3] = np.inf, -np.inf


@inner_kernel
def _enclose(boxes, i, others, j):  # type: ignore[no-untyped-def]
    for k in range(3):
        boxes[i, k] = min(boxes[i, k], others[j, k])
        boxes[i, k + 3] = max(boxes[i, k + 3], others[j, k + 3])


@inner_kernel
def _area(boxes, i):  # type: ignore[no-untyped-def]
    """Half of the surface; of a box that encloses something."""
    x, y, z = boxes[i, 3] - boxes[i, 0], boxes[i, 4] - boxes[i, 1], boxes[i, 5] - boxes[i, 2]
    return x * y + y * z + z * x
