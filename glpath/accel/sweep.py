"""BVH built without compiled code, for up to some thousands of boxes: importing numba alone takes longer than this.

It is built from the top by the surface area heuristic, with one item a leaf. The heuristic tests all splits between
two items in the order of their centroids along each axis.

Cost:     some 50 microseconds an item.
Source:   MacDonald & Booth 1990, Heuristics for ray tracing using space subdivision.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.accel.nodes import Bvh

Float64 = NDArray[np.float64]

#: Number of boxes up to which `sweep_bvh` is faster than numba's import and the binned build together.
SWEPT = 8192


def sweep_bvh(lower: Float64, upper: Float64) -> Bvh:
    """Build a binary tree over finite boxes (N, 3), one a leaf, as described in `glpath.accel.bvh.build_bvh`."""
    n = len(lower)
    max_nodes = max(2 * n - 1, 0)
    nodes = np.empty((max_nodes, 6))
    skip, first, count = np.empty(max_nodes, np.int32), np.empty(max_nodes, np.int32), np.zeros(max_nodes, np.int32)
    order = np.arange(n, dtype=np.int32)
    boxes = np.concatenate([lower, -np.asarray(upper)], axis=1)  # negated, so that both corners merge by minimum
    centroid = 0.5 * (lower + upper)
    pending = [(0, n)] if n else []
    size = 0
    while pending:
        begin, end = pending.pop()
        first[size], skip[size] = begin, size + 2 * (end - begin) - 1
        if end - begin == 1:
            nodes[size] = boxes[order[begin]]
            count[size] = 1
        else:
            nodes[size] = np.minimum.reduce(boxes[order[begin:end]])
            split = _sweep if end - begin > 2 else _part
            middle = split(order, begin, end, boxes, centroid)
            pending += [(middle, end), (begin, middle)]
        size += 1
    return Bvh(nodes[:, :3], -nodes[:, 3:], skip, first, count, order)


def _sweep(order: NDArray[np.int32], begin: int, end: int, boxes: Float64, centroid: Float64) -> int:
    """Sort the range along the best axis; return the begin of its second part."""
    items = order[begin:end]
    sorted_along = items[np.argsort(centroid[items], axis=0, kind="stable")]  # (n, 3)
    of_sorted = boxes[sorted_along]  # (n, 3, 6)
    before = _half_area(np.minimum.accumulate(of_sorted, axis=0))[:-1]
    after = _half_area(np.minimum.accumulate(of_sorted[::-1], axis=0))[::-1][1:]
    parts = np.arange(1, len(items))[:, None]
    cost = before * parts + after * parts[::-1]
    if cost.any():
        split, axis = divmod(int(np.argmin(cost)), 3)
    else:  # boxes without area, in a line or at one point: balance decides
        split, axis = len(items) // 2 - 1, int(np.argmax(np.ptp(centroid[items], axis=0)))
    order[begin:end] = sorted_along[:, axis]
    return begin + split + 1


def _part(order: NDArray[np.int32], begin: int, end: int, boxes: Float64, centroid: Float64) -> int:
    """Split two items like `_sweep`; half of all ranges have two, and the cost is the same along all axes."""
    a, b = order[begin:end]
    apart = centroid[b] - centroid[a]
    axis = 0 if _half_area(boxes[order[begin:end]]).any() else int(np.argmax(np.abs(apart)))
    if apart[axis] < 0:
        order[begin], order[begin + 1] = b, a
    return begin + 1


def _half_area(boxes: Float64) -> Float64:
    """Return half of the surface area of boxes (..., 6), given as lower corner and negated upper corner."""
    extent = -boxes[..., 3:] - boxes[..., :3]
    x, y, z = extent[..., 0], extent[..., 1], extent[..., 2]
    return np.asarray(x * y + y * z + z * x)
