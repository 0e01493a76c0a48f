"""Bounding volume hierarchy (BVH): a few box tests exclude most geometry for a ray or a shaft.

It is built from the top by the surface area heuristic over bins of centroids [Wald 2007], compiled by numba,
without GL. It serves rays of the ray tracer on the GPU and shafts of radiosity on the CPU. For the rays of paths,
whose trees may have millions of triangles, it is built in threads.

Cost:     half a second for a million boxes on one core, a millisecond for a few hundred.
Poor at:  boxes that all overlap each other, such as the long diagonal slivers of a triangulated disc.

[Wald 2007] I. Wald, "On fast construction of SAH-based bounding volume hierarchies", IEEE Symposium on Interactive
Ray Tracing, 33-40.
"""

from __future__ import annotations

from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from threading import Event
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from glpath.accel.nodes import Bvh, Tree
from glpath.errors import UsageError
from glpath.system.heartbeat import heartbeat
from glpath.system.kernels import inner_kernel, kernel, kernel_part
from glpath.system.machine import core_count
from glpath.system.time_limit import check_time

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

BINS = 16
#: Cost of testing the boxes of two children, relative to testing one item of a leaf.
NODE_COST = 2.0
# Number of boxes up to which one thread builds a whole subtree. For more boxes, it makes one node, and other
# threads may build the two subtrees below.
_ALONE = 1 << 14
# Number of subtrees per thread in large trees, so that no thread waits long for the last subtree.
_SHARES = 8
# Number of boxes, counted at each level of the tree, after which a build checks the time: about 0.1 seconds.
_BOXES_PER_CALL = 1 << 22
# Time between two checks while threads build, seconds.
_CHECK_INTERVAL = 0.1


def build_bvh(lower: ArrayLike, upper: ArrayLike, leaf_size: int = 4) -> Bvh:
    """Build a binary tree over boxes, deterministically.

    Parameters
    ----------
    lower, upper : (N, 3) corners of the items' boxes, finite; boxes may be flat, points, or equal to each other
    leaf_size    : maximum number of items in a leaf. Leaves have fewer if another split reduces the cost; 1 gives
                   every item its own leaf, whose box is the item's

    Raises UsageError if boxes are not finite or have lower > upper.
    """
    low, high = checked_boxes(lower, upper)
    if leaf_size < 1:
        raise UsageError(f"build_bvh: leaf_size is {leaf_size}; allowed is a whole number from 1.")
    boxes = np.concatenate([low, high], axis=1)
    count = len(boxes)
    tree, work = Tree.empty(count), _Workspace.of(count, boxes.dtype)
    while (end := _build(boxes, 0, count, int(leaf_size), count, 0, tree, work, _BOXES_PER_CALL)) < 0:
        check_time("building the BVH")
        heartbeat.beat()
    return tree.bvh(end)


def build_in_threads(boxes: NDArray[Any], threads: int | None = None) -> Bvh:
    """Build the tree of `build_bvh` with one item a leaf, in threads; their number does not change the result.

    boxes   : (N, 6) float32 or float64, lower and upper corners, finite and in order, which is not checked. This
              array is reordered in place, like the tree's items
    threads : number of threads; None for the number of cores

    The nodes' boxes have the type of `boxes`: 32 bits save memory. A single thread makes each of the first nodes,
    so that more than some eight threads gain little.
    """
    threads = core_count() if threads is None else threads
    count = len(boxes)
    tree = Tree.empty(count, boxes.dtype)
    # A subtree over n items has 2 n - 1 nodes, so the index of each subtree's first node is known in advance.
    alone = max(_ALONE, count // (_SHARES * threads))

    def build(begin: int, end: int, node: int) -> list[tuple[int, int, int]]:
        work = _Workspace.of(min(end - begin, alone), boxes.dtype)
        while _build(boxes, begin, end, 1, alone, node, tree, work, _BOXES_PER_CALL) < 0:
            if stopped.is_set():
                return []
        return [(int(a), int(b), int(at)) for a, b, at in work.left_over if a < b]

    stopped = Event()
    with ThreadPoolExecutor(threads) as pool:
        running: set[Future[list[tuple[int, int, int]]]] = {pool.submit(build, 0, count, 0)}
        try:
            while running:
                done, running = wait(running, _CHECK_INTERVAL, FIRST_COMPLETED)
                check_time("building the BVH")
                if done:
                    heartbeat.beat()
                running |= {pool.submit(build, *part) for each in done for part in each.result()}
        except BaseException:
            stopped.set()
            pool.shutdown(cancel_futures=True)
            raise
    return tree.bvh(max(2 * count - 1, 0))


def checked_boxes(lower: ArrayLike, upper: ArrayLike) -> tuple[Float64, Float64]:
    """Return corners as (N, 3) float64. Raises UsageError for wrong shapes, NaN, infinities, and lower > upper."""
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
def _build(boxes, begin, end, leaf_size, alone, node, tree, work, limit):  # type: ignore[no-untyped-def]
    """Fill the nodes over items `begin` to `end`, depth first, from index `node` on; return the next node's index.

    Returns -1 if nodes over `limit` items were filled and others are left; another call with the same arguments
    continues. Permutes `boxes` along with the tree's order, so that the items of each node are contiguous. With one
    item a leaf, children with more than `alone` items are left over for other threads.
    """
    skip, first, count = tree.skip, tree.first, tree.items
    pending, centres, halves, left_over = work.pending, work.centres, work.halves, work.left_over
    start, waiting, left = node, work.reached[0], work.reached[2]
    if waiting:
        node = work.reached[1]
    elif end > begin:
        pending[0, 0], pending[0, 1] = begin, end
        _clear(centres, 0)
        for i in range(begin, end):
            _enclose_centre(centres, 0, boxes, i)
        waiting = 1
    while waiting:
        if limit < 0:
            work.reached[0], work.reached[1], work.reached[2] = waiting, node, left
            return -1
        waiting -= 1
        begin, end = pending[waiting, 0], pending[waiting, 1]
        if end - begin > alone and node > start:
            left_over[left, 0], left_over[left, 1], left_over[left, 2] = begin, end, node
            left += 1
            node += 2 * (end - begin) - 1
            continue
        limit -= end - begin
        middle = _split(boxes, begin, end, leaf_size, tree, node, work, waiting)
        first[node] = begin
        skip[node] = node + 2 * (end - begin) - 1  # for one item a leaf; otherwise replaced below
        if middle == begin:
            count[node] = end - begin
        else:
            count[node] = 0
            pending[waiting, 0], pending[waiting, 1] = middle, end
            pending[waiting + 1, 0], pending[waiting + 1, 1] = begin, middle
            for j in range(6):
                centres[waiting + 1, j], centres[waiting, j] = halves[0, j], halves[1, j]
            waiting += 2
        node += 1
    if leaf_size > 1:
        for i in range(node - 1, start - 1, -1):
            skip[i] = i + 1 if count[i] else skip[skip[i + 1]]
    return node


class _Workspace(NamedTuple):
    """Working memory of the build.

    pending      : (N + 2, 2), ranges still to build; they are disjoint, so never more than items
    centres      : (N + 2, 6), box around the centroids of each range
    halves       : (2, 6), boxes around the centroids of the two parts of a split range
    bins, filled : (3 BINS, 6) boxes and (3 BINS,) number of items in each bin, by axis
    right_cost   : (BINS,) cost of all bins from each bin to the last
    around       : (1, 6), box around the bins visited so far
    left_over    : (2, 3), begin, end and node of ranges that were not built; zeros for none
    reached      : (3,), numbers of ranges still to build, of the next node and of ranges left over; zeros at first
    """

    pending: NDArray[np.int64]
    centres: Float64
    halves: Float64
    bins: NDArray[Any]
    filled: NDArray[np.int64]
    right_cost: Float64
    around: NDArray[Any]
    left_over: NDArray[np.int64]
    reached: NDArray[np.int64]

    @classmethod
    def of(cls, items: int, dtype: DTypeLike) -> _Workspace:
        """Allocate the working memory for ranges of up to `items` items, with boxes of type `dtype`."""
        return cls(
            np.empty((items + 2, 2), np.int64),
            np.empty((items + 2, 6)),
            np.empty((2, 6)),
            np.empty((3 * BINS, 6), dtype),
            np.empty(3 * BINS, np.int64),
            np.empty(BINS),
            np.empty((1, 6), dtype),
            np.zeros((2, 3), np.int64),
            np.zeros(3, np.int64),
        )


@kernel_part
def _split(boxes, begin, end, leaf_size, tree, node, work, at):  # type: ignore[no-untyped-def]
    """Write the range's box, split its items, and return the begin of the second part; `begin` for a leaf.

    at : index of the box around the range's centroids
    """
    nodes, order = tree.boxes, tree.order
    bins, filled, right_cost, around = work.bins, work.filled, work.right_cost, work.around
    centres, halves = work.centres, work.halves
    n = end - begin
    _clear(nodes, node)
    if n == 1:
        _enclose(nodes, node, boxes, begin)
        return begin
    low0, low1, low2 = centres[at, 0], centres[at, 1], centres[at, 2]
    extent0, extent1, extent2 = centres[at, 3] - low0, centres[at, 4] - low1, centres[at, 5] - low2
    for b in range(3 * BINS):
        _clear(bins, b)
        filled[b] = 0
    for i in range(begin, end):
        if extent0 > 0:
            _fill(bins, filled, _bin(boxes, i, 0, low0, extent0), boxes, i)
        if extent1 > 0:
            _fill(bins, filled, BINS + _bin(boxes, i, 1, low1, extent1), boxes, i)
        if extent2 > 0:
            _fill(bins, filled, 2 * BINS + _bin(boxes, i, 2, low2, extent2), boxes, i)

    # Cost is area times items; boxes in a line have no area, and then balance decides.
    best, best_lopsided, best_axis, best_bin = np.inf, n, -1, 0
    for k in range(3):
        if not (extent0 if k == 0 else (extent1 if k == 1 else extent2)) > 0:
            continue
        of_axis = k * BINS
        _clear(around, 0)
        items = 0
        for b in range(BINS - 1, 0, -1):
            items += filled[of_axis + b]
            _enclose(around, 0, bins, of_axis + b)
            right_cost[b] = items * _area(around, 0) if items else np.inf
        _clear(around, 0)
        items = 0
        for b in range(1, BINS):
            if filled[of_axis + b - 1] == 0:  # an empty bin: the split would be the same as the previous one
                continue
            items += filled[of_axis + b - 1]
            if items == n:
                break
            _enclose(around, 0, bins, of_axis + b - 1)
            cost = items * _area(around, 0) + right_cost[b]
            lopsided = abs(n - 2 * items)
            if cost < best or (cost == best and lopsided < best_lopsided):
                best, best_lopsided, best_axis, best_bin = cost, lopsided, k, b

    if best_axis < 0:
        for i in range(begin, end):
            _enclose(nodes, node, boxes, i)
    else:
        for b in range(BINS):
            _enclose(nodes, node, bins, best_axis * BINS + b)
    whole = _area(nodes, node)
    if n <= leaf_size and (best_axis < 0 or n * whole <= NODE_COST * whole + best):
        return begin
    if best_axis < 0:  # all centroids coincide
        for j in range(6):
            halves[0, j], halves[1, j] = centres[at, j], centres[at, j]
        return begin + n // 2
    low = low0 if best_axis == 0 else (low1 if best_axis == 1 else low2)
    extent = extent0 if best_axis == 0 else (extent1 if best_axis == 1 else extent2)
    _clear(halves, 0)
    _clear(halves, 1)
    left, right = begin, end - 1
    while left <= right:
        if _bin(boxes, left, best_axis, low, extent) < best_bin:
            _enclose_centre(halves, 0, boxes, left)
            left += 1
        else:
            _enclose_centre(halves, 1, boxes, left)
            order[left], order[right] = order[right], order[left]
            for j in range(6):
                boxes[left, j], boxes[right, j] = boxes[right, j], boxes[left, j]
            right -= 1
    return left


# The functions below take an array and the index of a box, not the box. Creating an array view would take as long
# as using it. Boxes may have 32 bits; computations use 64.


@inner_kernel
def _centre(boxes, i, axis):  # type: ignore[no-untyped-def]
    return 0.5 * boxes[i, axis] + 0.5 * boxes[i, axis + 3]


@inner_kernel
def _bin(boxes, i, axis, low, extent):  # type: ignore[no-untyped-def]
    return min(int((_centre(boxes, i, axis) - low) / extent * BINS), BINS - 1)


@inner_kernel
def _fill(bins, filled, b, boxes, i):  # type: ignore[no-untyped-def]
    filled[b] += 1
    _enclose(bins, b, boxes, i)


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
def _enclose_centre(centres, i, boxes, j):  # type: ignore[no-untyped-def]
    for k in range(3):
        centre = _centre(boxes, j, k)
        centres[i, k] = min(centres[i, k], centre)
        centres[i, k + 3] = max(centres[i, k + 3], centre)


@inner_kernel
def _area(boxes, i):  # type: ignore[no-untyped-def]
    """Return half of the surface area of a nonempty box."""
    x = np.float64(boxes[i, 3]) - boxes[i, 0]
    y = np.float64(boxes[i, 4]) - boxes[i, 1]
    z = np.float64(boxes[i, 5]) - boxes[i, 2]
    return x * y + y * z + z * x
