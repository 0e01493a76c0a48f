"""Rows of exchange areas: from one facet through a BVH of all others, with the occluders of its shafts [SC].

On the way down, the list of occluders of a node is what is left of its parent's in the shaft between the facet and
the node's box. Where one of them hides all of the box, the whole branch is left out; where the list is empty, all
below is seen, and no occluder is looked for again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.bvh_nodes import Bvh
from glpath.kernels import inner_kernel, kernel
from glpath.radiosity.shafts.shaft import empty_shaft, form_shaft, place_box
from glpath.radiosity.view_factors.convex import CORNERS, ROOM, clip, height, measure
from glpath.radiosity.view_factors.exchange import FAR, FEW, MIDDLE, MORE, far_exchange, near_exchange
from glpath.radiosity.view_factors.hidden import PARTS, hides_all, seen_share

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

#: Of the error wanted of a row, what a factor F may have, times the square root of F: the squares of all errors of a
#: row then add up to less than that of the row, as the factors do to 1.
_SHARE = 0.3
#: Occluders between two facets, at most, that are looked at one by one.
MOST_SHADES = 512

# Where each stands in the counts.
PAIRS, FACING, BRANCHES, HIDDEN, FREE, PARTIAL, POINTS, CROWDED = range(8)
#: Pairs of facets looked at, and that face each other; branches of the BVH and pairs that one occluder hides; pairs
#: proven to see all of each other, and those that something may hide; points for these; pairs with more occluders
#: than `MOST_SHADES`.
COUNT_NAMES = (
    "pairs", "facing", "hidden_branches", "hidden_pairs", "free_pairs", "partial_pairs", "points", "crowded_pairs",
)  # fmt: skip


class Polygons(NamedTuple):
    """Convex polygons, facets or occluders.

    corners : (N, CORNERS, 3) float64, counter-clockwise from the front
    count   : (N,) int64, how many corners
    planes  : (N, 4) float64, unit normal out of the front and distance
    edges   : (N, CORNERS, 4) float64, of each edge the plane that it and the normal span, its normal inward
    boxes   : (N, 6) float64, lower and upper corner
    areas   : (N,) float64
    """

    corners: Float64
    count: Int64
    planes: Float64
    edges: Float64
    boxes: Float64
    areas: Float64


class Tree(NamedTuple):
    """A BVH over the facets, which are numbered in its order, a leaf for each.

    boxes : (M, 6) float64
    skip  : (M,) int64
    first : (M + 1,) int64; the facets below a node are first[node] to first[skip[node]]
    leaf  : (M,) bool
    """

    boxes: Float64
    skip: Int64
    first: Int64
    leaf: NDArray[np.bool_]

    @classmethod
    def of(cls, bvh: Bvh) -> Tree:
        first = np.append(bvh.first, len(bvh.order)).astype(np.int64)
        boxes = np.concatenate([bvh.lower, bvh.upper], axis=1)
        return cls(boxes, bvh.skip.astype(np.int64), first, bvh.count > 0)


class Work(NamedTuple):
    """Room for one thread; see where each is used."""

    eps: float
    a: Float64
    b: Float64
    spare: Float64
    box: Float64
    centre_a: Float64
    centre_b: Float64
    points_a: Float64
    points_b: Float64
    halves: Float64
    few: Float64
    more: Float64
    pending: Int64
    lists: Int32
    shaft: Float64
    near: Int64
    extent: Float64
    hull: Float64
    at_a: Float64
    at_b: Float64
    shades: Float64
    shade_count: Int64
    shade_plane: Int64
    pyramid: Float64
    sides: Int64
    parts: Float64
    part_corners: Int64
    following: Int64
    triangles: Float64
    values: Float64

    @classmethod
    def of(cls, eps: float, occluders: int, depth: int) -> Work:
        shaft, near, extent = empty_shaft()
        points = 6 * ROOM
        return cls(
            eps=eps,
            a=np.empty((ROOM, 3)),
            b=np.empty((ROOM, 3)),
            spare=np.empty((ROOM, 3)),
            box=np.empty((8, 3)),
            centre_a=np.empty(3),
            centre_b=np.empty(3),
            points_a=np.empty((points, 4)),
            points_b=np.empty((points, 4)),
            halves=np.empty((64, 3)),
            few=FEW,
            more=MORE,
            pending=np.empty((2 * depth + 4, 3), np.int64),
            lists=np.empty((depth + 3) * occluders, np.int32),
            shaft=shaft,
            near=near,
            extent=extent,
            hull=np.empty((4 * ROOM, 4)),
            at_a=np.empty(ROOM),
            at_b=np.empty(ROOM),
            shades=np.empty((MOST_SHADES, ROOM, 3)),
            shade_count=np.empty(MOST_SHADES, np.int64),
            shade_plane=np.empty(MOST_SHADES, np.int64),
            pyramid=np.empty((MOST_SHADES, ROOM, 3)),
            sides=np.empty(MOST_SHADES, np.int64),
            parts=np.empty((PARTS + 2, 2 * ROOM, 3)),
            part_corners=np.empty(PARTS + 2, np.int64),
            following=np.empty(PARTS + 2, np.int64),
            triangles=np.empty((64 + ROOM, 3, 3)),
            values=np.empty((64 + ROOM, 4)),
        )


@inner_kernel
def _in_reach(o, occluders, a, n, box, eps):  # type: ignore[no-untyped-def]
    """0 where occluder o cannot stand between a[:n] and a box, as neither reaches across its plane; 2 where its
    plane parts them, and nothing in the box lies in it; else 1."""
    p = occluders.planes
    low_a, high_a = np.inf, -np.inf
    for k in range(n):
        h = height(p, o, a[k, 0], a[k, 1], a[k, 2])
        low_a, high_a = min(low_a, h), max(high_a, h)
    low_b = high_b = p[o, 3]
    for k in range(3):
        f = p[o, k]
        low_b += f * (box[k] if f > 0 else box[k + 3])
        high_b += f * (box[k + 3] if f > 0 else box[k])
    parted = _parted(low_a, high_a, low_b, high_b, eps)
    # What lies in the plane, as the neighbours of the occluder do, is not hidden by it.
    return 1 if parted == 2 and low_b <= eps and high_b >= -eps else parted


@inner_kernel
def _parted(low_a, high_a, low_b, high_b, eps):  # type: ignore[no-untyped-def]
    if (low_a >= -eps and low_b >= -eps) or (high_a <= eps and high_b <= eps):
        return 0
    if (low_a >= -eps and high_a <= eps) or (low_b >= -eps and high_b <= eps):
        return 0
    return 2 if (low_a >= -eps and high_b <= eps) or (high_a <= eps and low_b >= -eps) else 1


@inner_kernel
def _supports(a, n, b, m, count, work):  # type: ignore[no-untyped-def]
    """Append to work.hull planes through an edge of a and a corner of b that have both in front; how many then."""
    hull, eps = work.hull, work.eps
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        ex, ey, ez = a[j, 0] - a[k, 0], a[j, 1] - a[k, 1], a[j, 2] - a[k, 2]
        for i in range(m):
            dx, dy, dz = b[i, 0] - a[k, 0], b[i, 1] - a[k, 1], b[i, 2] - a[k, 2]
            x, y, z = ey * dz - ez * dy, ez * dx - ex * dz, ex * dy - ey * dx
            length = np.sqrt(x * x + y * y + z * z)
            # Through a corner that is all but on the edge's line, a plane could be any.
            if length * length <= 1e-12 * (ex * ex + ey * ey + ez * ez) * (dx * dx + dy * dy + dz * dz):
                continue
            x, y, z = x / length, y / length, z / length
            w = -(x * a[k, 0] + y * a[k, 1] + z * a[k, 2])
            low = high = 0.0
            for t in range(n):
                h = x * a[t, 0] + y * a[t, 1] + z * a[t, 2] + w
                low, high = min(low, h), max(high, h)
            if low < -eps and high > eps:
                continue
            for t in range(m):
                h = x * b[t, 0] + y * b[t, 1] + z * b[t, 2] + w
                low, high = min(low, h), max(high, h)
            if low < -eps and high > eps:
                continue
            sign = 1.0 if high > eps else -1.0
            hull[count, 0], hull[count, 1], hull[count, 2], hull[count, 3] = sign * x, sign * y, sign * z, sign * w
            count += 1
            break
    return count


@inner_kernel
def _outside_hull(occluders, o, count, work):  # type: ignore[no-untyped-def]
    """Whether occluder o lies behind one of the planes of work.hull[:count]."""
    hull, corners = work.hull, occluders.corners
    for p in range(count):
        outside = True
        for k in range(occluders.count[o]):
            if height(hull, p, corners[o, k, 0], corners[o, k, 1], corners[o, k, 2]) > work.eps:
                outside = False
                break
        if outside:
            return True
    return False


@inner_kernel
def _between(i, j, facets, occluders, begin, end, floor, error, work, counts):  # type: ignore[no-untyped-def]
    """Exchange area of facets i and j, and an estimate of its error; candidates are work.lists[begin:end]."""
    a, b, eps = work.a, work.b, work.eps
    counts[FACING] += 1
    n = clip(facets.corners[i], facets.count[i], facets.planes, j, eps, a)
    m = clip(facets.corners[j], facets.count[j], facets.planes, i, eps, b)
    if n == 0 or m == 0:
        return 0.0, 0.0
    shades = 0
    overflow = False
    if end > begin:
        planes = _supports(a, n, b, m, 0, work)
        planes = _supports(b, m, a, n, planes, work)
        for c in range(begin, end):
            o = np.int64(work.lists[c])
            low_a, high_a, low_b, high_b = np.inf, -np.inf, np.inf, -np.inf
            for k in range(n):
                h = height(occluders.planes, o, a[k, 0], a[k, 1], a[k, 2])
                low_a, high_a = min(low_a, h), max(high_a, h)
            for k in range(m):
                h = height(occluders.planes, o, b[k, 0], b[k, 1], b[k, 2])
                low_b, high_b = min(low_b, h), max(high_b, h)
            parted = _parted(low_a, high_a, low_b, high_b, eps)
            if parted == 0 or _outside_hull(occluders, o, planes, work):
                continue
            if parted == 2 and hides_all(a, n, b, m, occluders, o, eps, work.at_a, work.at_b):
                counts[HIDDEN] += 1
                return 0.0, 0.0
            if shades == MOST_SHADES:
                overflow = True
                continue
            k = clip(occluders.corners[o], occluders.count[o], facets.planes, i, eps, work.spare)
            k = clip(work.spare, k, facets.planes, j, eps, work.shades[shades]) if k else 0
            if k:
                work.shade_count[shades], work.shade_plane[shades] = k, o
                shades += 1

    area_a, radius_a = measure(a, n, work.centre_a)
    area_b, radius_b = measure(b, m, work.centre_b)
    square = 0.0
    for k in range(3):
        square += (work.centre_a[k] - work.centre_b[k]) ** 2
    distance = np.sqrt(square)
    na, nb = facets.planes[i], facets.planes[j]
    apart = distance / (radius_a + radius_b)
    off = 0.0
    if apart >= FAR:
        whole = far_exchange(a, n, b, m, na, nb, work.few, work.points_a, work.points_b)
    elif apart >= MIDDLE:
        whole = far_exchange(a, n, b, m, na, nb, work.more, work.points_a, work.points_b)
    elif radius_a <= radius_b:
        whole, off = near_exchange(a, n, b, m, 0.01 * floor, work.halves)
    else:
        whole, off = near_exchange(b, m, a, n, 0.01 * floor, work.halves)
    if apart >= MIDDLE:
        off = 1e-5 * whole
    whole = max(whole, 0.0)
    if shades == 0:
        counts[FREE] += 1
        return whole, off
    counts[PARTIAL] += 1
    tolerance = _SHARE * error * np.sqrt(whole * min(facets.areas[i], facets.areas[j]))
    if radius_a <= radius_b:
        share, wrong, points = seen_share(
            a, n, na[0], na[1], na[2], b, m, whole, area_a, tolerance, shades, occluders.planes, work
        )  # fmt: skip
    else:
        share, wrong, points = seen_share(
            b, m, nb[0], nb[1], nb[2], a, n, whole, area_b, tolerance, shades, occluders.planes, work
        )  # fmt: skip
    counts[POINTS] += points
    if overflow:
        counts[CROWDED] += 1
        wrong = share
    return whole * share, off + whole * wrong


@kernel
def exchange_rows(  # type: ignore[no-untyped-def]
    first, last, facets, tree, occluders, error, work, columns, values, errors, ends, counts
):
    """Exchange areas of facets from `first` to `last` with all that follow them.

    error   : wanted of the sum of a row of view factors
    columns, values, errors : (C,) where they go, row after row
    ends    : (last - first,) where each row ends there

    Returns the row that there was no room for, or `last`.
    """
    pending, lists, eps = work.pending, work.lists, work.eps
    boxes, skip = tree.boxes, tree.skip
    total = len(facets.count)
    size = 0
    for i in range(first, last):
        if size + total - i > len(columns):
            return i
        n = facets.count[i]
        own = facets.corners[i]
        own_box = facets.boxes[i]
        # All occluders that reach before the facet.
        count = 0
        for o in range(len(occluders.count)):
            before = False
            for k in range(occluders.count[o]):
                if height(facets.planes, i, occluders.corners[o, k, 0], occluders.corners[o, k, 1],
                          occluders.corners[o, k, 2]) > eps:  # fmt: skip
                    before = True
                    break
            if before:
                lists[count] = o
                count += 1
        pending[0, 0], pending[0, 1], pending[0, 2] = 0, 0, count
        top = 1
        while top:
            top -= 1
            node, begin, end = pending[top, 0], pending[top, 1], pending[top, 2]
            if tree.first[skip[node]] <= i + 1:
                continue
            highest = facets.planes[i, 3]
            for k in range(3):
                f = facets.planes[i, k]
                highest += f * (boxes[node, k + 3] if f > 0 else boxes[node, k])
            if highest <= eps:
                continue
            leaf = tree.leaf[node]
            j = tree.first[node]
            if leaf:
                counts[PAIRS] += 1
                facing = False
                for k in range(n):
                    if height(facets.planes, j, own[k, 0], own[k, 1], own[k, 2]) > eps:
                        facing = True
                        break
                if not facing:
                    continue
            put = end
            if end > begin:
                box = boxes[node]
                planes = form_shaft(own_box, box, eps, -1.0, work.shaft, work.near, work.extent)
                hidden = False
                for c in range(begin, end):
                    o = np.int64(lists[c])
                    if place_box(
                        occluders.boxes, o, -1, own_box, box, work.extent, work.shaft, work.near, planes, False
                    ) == 0:  # fmt: skip
                        continue
                    parted = _in_reach(o, occluders, own, n, box, eps)
                    if parted == 0:
                        continue
                    if parted == 2 and not leaf:
                        for k in range(8):
                            work.box[k, 0] = box[3 * (k & 1)]
                            work.box[k, 1] = box[1 + 3 * (k >> 1 & 1)]
                            work.box[k, 2] = box[2 + 3 * (k >> 2)]
                        if hides_all(own, n, work.box, 8, occluders, o, eps, work.at_a, work.at_b):
                            hidden = True
                            break
                    lists[put] = o
                    put += 1
                if hidden:
                    counts[BRANCHES] += 1
                    continue
            if leaf:
                floor = 0.5 * error * min(facets.areas[i], facets.areas[j]) / total
                value, off = _between(i, j, facets, occluders, end, put, floor, error, work, counts)
                if value > 0:
                    columns[size], values[size], errors[size] = j, value, off
                    size += 1
                continue
            child = node + 1
            while child < skip[node]:
                pending[top, 0], pending[top, 1], pending[top, 2] = child, end, put
                top += 1
                child = skip[child]
        ends[i - first] = size
    return last
