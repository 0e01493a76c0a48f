"""Rows of exchange areas: each facet traverses a BVH of all others, with the occluders in its shafts [SC].

A node's list of occluders is the part of its parent's list inside the shaft between the facet and the node's box.
If one occluder hides the whole box, the branch is skipped. If the list is empty, everything below is unoccluded,
and the search for occluders ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.apps.view_factors.convex import ROOM, Polygon, clip, height, measure
from glpath.apps.view_factors.exchange import exchange
from glpath.apps.view_factors.hidden import BLOCKS, MAX_POINTS, Sampling, hides_all, mixed, seen_share
from glpath.apps.view_factors.records import DEEPEST, MAX_CLIPPED
from glpath.radiosity.shafts.search import highest
from glpath.radiosity.shafts.shaft import classify_box, form_shaft
from glpath.system.kernels import inner_kernel, kernel

#: The target standard error of a factor F is this value times sqrt(F) times the target error of a row's sum. The
#: factors of a row add up to 1, so the row's standard error is at most this fraction of its target.
_SHARE = 0.4
#: Allowed error of unoccluded factors, as a fraction of the target error of a row's sum.
_EXACT = 0.05
#: Fraction of an error bound that counts as one standard error. Quadrature rules are chosen by bounds on their
#: errors; the true errors are 0.02 to 0.3 of these.
_OF_BOUND = 0.16
#: Exchange area, as a multiple of its tolerance, up to which four initial points suffice and no polygon is halved.
_COARSE = 6.0
#: The initial number of points of a pair of facets is its exchange area divided by its tolerance and by this value.
#: For a part of a pair, it is the exchange area divided by the tolerance. If all of too few points miss a small
#: occluder, the result is too large and yet accepted.
_A_POINT = 3.0
#: Maximum number of initial points.
_TRIED = 128
#: Number of occluders between two polygons above which the larger polygon is halved if `_TRIED` points do not
#: suffice.
_FEW_OCCLUDERS = 6
#: Number of occluders above which the larger polygon is halved before any point is tried.
_MANY_OCCLUDERS = 48

# Indices into the counts.
PAIRS, FACING, BRANCHES, HIDDEN, FREE, PARTIAL, POINTS, CROWDED = range(8)
#: Names of the counts. "pairs" are pairs of facets tested, and "facing" those that face each other. "hidden" ones
#: are hidden by a single occluder, "free" ones are proven to be unoccluded, and "partial" are all others, for which
#: "points" are the points of visibility. "crowded" are parts of pairs with more occluders than `MAX_CLIPPED` or too
#: many visible pieces.
COUNT_NAMES = (
    "pairs", "facing", "hidden_branches", "hidden_pairs", "free_pairs", "partial_pairs", "points", "crowded_pairs",
)  # fmt: skip


class Rows(NamedTuple):
    """Exchange areas, stored row after row.

    columns, values, errors : (C,) column, exchange area and standard error of each entry
    ends                    : (rows,) index after each row's last entry
    """

    columns: NDArray[np.int32]
    values: NDArray[np.float64]
    errors: NDArray[np.float32]
    ends: NDArray[np.int64]


@inner_kernel
def _may_occlude(o, occluders, polygon, box, eps):  # type: ignore[no-untyped-def]
    """Return how occluder o may occlude segments between a polygon and a box.

    0 : not at all, because both lie on one side of its plane, or one of them lies in the plane
    2 : its plane separates them, and no part of the box lies in the plane
    1 : otherwise
    """
    p = occluders.planes
    low_a, high_a = _heights(p, o, polygon)
    low_b = high_b = p[o, 3]
    for k in range(3):
        f = p[o, k]
        low_b += f * (box[k] if f > 0 else box[k + 3])
        high_b += f * (box[k + 3] if f > 0 else box[k])
    parted = _parted(low_a, high_a, low_b, high_b, eps)
    # The occluder does not hide faces in its own plane, such as its neighbours.
    return 1 if parted == 2 and low_b <= eps and high_b >= -eps else parted


@inner_kernel
def _heights(planes, i, polygon):  # type: ignore[no-untyped-def]
    """Return the lowest and the highest corner's height over planes[i]."""
    points, n = polygon
    low, high = np.inf, -np.inf
    for k in range(n):
        h = height(planes, i, points[k, 0], points[k, 1], points[k, 2])
        low, high = min(low, h), max(high, h)
    return low, high


@inner_kernel
def _parted(low_a, high_a, low_b, high_b, eps):  # type: ignore[no-untyped-def]
    if (low_a >= -eps and low_b >= -eps) or (high_a <= eps and high_b <= eps):
        return 0
    if (low_a >= -eps and high_a <= eps) or (low_b >= -eps and high_b <= eps):
        return 0
    return 2 if (low_a >= -eps and high_b <= eps) or (high_a <= eps and low_b >= -eps) else 1


@inner_kernel
def _supports(first, second, count, work):  # type: ignore[no-untyped-def]
    """Append supporting planes to work.hull, and return the new number of planes.

    Each contains an edge of the first polygon and a corner of the second, and has both polygons in front.
    """
    a, n = first
    b, m = second
    hull, eps = work.hull, work.eps
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        ex, ey, ez = a[j, 0] - a[k, 0], a[j, 1] - a[k, 1], a[j, 2] - a[k, 2]
        for i in range(m):
            dx, dy, dz = b[i, 0] - a[k, 0], b[i, 1] - a[k, 1], b[i, 2] - a[k, 2]
            x, y, z = ey * dz - ez * dy, ez * dx - ex * dz, ex * dy - ey * dx
            length = np.sqrt(x * x + y * y + z * z)
            # A plane through a corner close to the edge's line is undetermined.
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
    """Return True if occluder o lies behind one of the planes work.hull[:count]."""
    hull, corners = work.hull, occluders.corners
    for p in range(count):
        outside = True
        for k in range(occluders.sides[o]):
            if height(hull, p, corners[o, k, 0], corners[o, k, 1], corners[o, k, 2]) > work.eps:
                outside = False
                break
        if outside:
            return True
    return False


@inner_kernel
def _between(i, j, facets, occluders, begin, end, error, work):  # type: ignore[no-untyped-def]
    """Return the exchange area of facets i and j, and its variance; candidate occluders are work.lists[begin:end].

    If many occluders remain, the larger polygon is halved, because a smaller shaft contains fewer or none.
    """
    eps, lists, pairs, counts = work.eps, work.lists, work.pairs, work.counts
    smaller = min(facets.areas[i], facets.areas[j])
    floor = 0.5 * error * smaller / len(facets.sides)
    counts[FACING] += 1
    n = clip(Polygon(facets.corners[i], facets.sides[i]), facets.planes, j, eps, work.a[0])
    m = clip(Polygon(facets.corners[j], facets.sides[j]), facets.planes, i, eps, work.b[0])
    if n == 0 or m == 0:
        return 0.0, 0.0
    pairs[0, 0], pairs[0, 1], pairs[0, 2], pairs[0, 3], pairs[0, 4] = n, m, begin, end, 0
    top = 1
    value = variance = 0.0
    tolerance = -1.0
    seed = mixed(mixed(i) ^ j)
    while top and work.stop[0] == 0:
        top -= 1
        a, b = Polygon(work.a[top], pairs[top, 0]), Polygon(work.b[top], pairs[top, 1])
        begin, end, depth = pairs[top, 2], pairs[top, 3], pairs[top, 4]
        put = end
        hidden = False
        if end > begin:
            planes = _supports(a, b, 0, work)
            planes = _supports(b, a, planes, work)
            for c in range(begin, end):
                o = np.int64(lists[c])
                parted = _apart(o, occluders, a, b, eps)
                if parted == 0 or _outside_hull(occluders, o, planes, work):
                    continue
                if parted == 2 and hides_all(a, b, occluders, o, work):
                    hidden = True
                    break
                lists[put] = o
                put += 1
        if hidden:
            if depth == 0:
                counts[HIDDEN] += 1
            continue
        # Clip the occluders to the half-spaces in front of both polygons; a face's coplanar neighbours disappear.
        clipped, kept = 0, end
        for c in range(end, put):
            o = np.int64(lists[c])
            k = clip(Polygon(occluders.corners[o], occluders.sides[o]), facets.planes, i, eps, work.spare)
            last = min(clipped, MAX_CLIPPED - 1)
            k = clip(Polygon(work.spare, k), facets.planes, j, eps, work.clipped[last]) if k else 0
            if k:
                lists[kept] = o
                kept += 1
                if clipped < MAX_CLIPPED:
                    work.clipped_count[clipped] = k
                    for c in range(4):
                        work.clipped_planes[clipped, c] = occluders.planes[o, c]
                    clipped += 1
        put = kept
        part = max(tolerance, 0.0) * 0.7**depth
        allowed = max(_EXACT * floor, 0.1 * part)
        whole, wrong = exchange(a, b, facets.planes[i], facets.planes[j], allowed, _EXACT * error, work)
        if put == end:
            if depth == 0:
                counts[FREE] += 1
            value += whole
            variance += (_OF_BOUND * wrong) ** 2
            continue
        # The squared tolerances of a pair's parts add up to that of the pair, however unequal the parts are.
        part = _SHARE * error * np.sqrt(whole * smaller)
        if depth == 0:
            counts[PARTIAL] += 1
            tolerance = part
        coarse = whole <= _COARSE * part
        crowded = put - end > MAX_CLIPPED
        may_halve = depth < DEEPEST and (crowded or (put - end > _FEW_OCCLUDERS and not coarse))
        if may_halve and put - end > _MANY_OCCLUDERS and _halve(a, b, top, work):
            top = _push_halves(pairs, top, end, put, depth)
            continue
        _, radius_a = measure(a, work.centre_a)
        _, radius_b = measure(b, work.centre_b)
        on_a = radius_a <= radius_b
        smaller_one, other, facet = (a, b, i) if on_a else (b, a, j)
        if depth < DEEPEST and not coarse:
            # Visibility is discontinuous where a point crosses the line on which an occluder stands. The polygon is
            # therefore split along this line.
            stands = _standing(smaller_one, facets.planes, facet, clipped, work)
            if stands >= 0:
                for k in range(4):
                    work.hull[0, k] = work.clipped_planes[stands, k]
                    work.hull[1, k] = -work.hull[0, k]
                if _divide(a, b, on_a, top, work):
                    top = _push_halves(pairs, top, end, put, depth)
                    continue
        first = BLOCKS
        while first < _TRIED and first * (_A_POINT if depth == 0 else 1.0) * part < whole:
            first *= 2
        sampling = Sampling(first, _TRIED if may_halve else MAX_POINTS, part)
        seed = mixed(seed)
        work.lost[0] = 0
        share, uncertain, points = seen_share(
            smaller_one, facets.planes[facet], other, whole, sampling, seed, clipped, work
        )
        counts[POINTS] += points
        if may_halve and whole * uncertain > part and _halve(a, b, top, work):
            top = _push_halves(pairs, top, end, put, depth)
            continue
        counts[CROWDED] += work.lost[0] > 0 or put - end > MAX_CLIPPED
        value += whole * share
        variance += (whole * uncertain) ** 2 + (_OF_BOUND * wrong) ** 2
    return value, variance


@inner_kernel
def _push_halves(pairs, top, begin, end, depth):  # type: ignore[no-untyped-def]
    """Set the candidates of the two halves at `top` and `top + 1`; return the index after both."""
    for t in (top, top + 1):
        pairs[t, 2], pairs[t, 3], pairs[t, 4] = begin, end, depth + 1
    return top + 2


@inner_kernel
def _apart(o, occluders, a, b, eps):  # type: ignore[no-untyped-def]
    """Return 0 if occluder o cannot occlude polygon b from a, 2 if its plane separates them, otherwise 1."""
    low_a, high_a = _heights(occluders.planes, o, a)
    low_b, high_b = _heights(occluders.planes, o, b)
    return _parted(low_a, high_a, low_b, high_b, eps)


@inner_kernel
def _halve(a, b, top, work):  # type: ignore[no-untyped-def]
    """Split the larger polygon, and store its halves, each with the other polygon, at `top` and `top + 1`.

    Returns False if the larger polygon has too many corners to be split.
    """
    _, radius_a = measure(a, work.centre_a)
    _, radius_b = measure(b, work.centre_b)
    first = radius_a >= radius_b
    source, count = a if first else b
    centre = work.centre_a if first else work.centre_b
    # Split perpendicular to the line from the centre to the farthest corner.
    farthest, at = -1.0, 0
    for k in range(count):
        square = 0.0
        for j in range(3):
            square += (source[k, j] - centre[j]) ** 2
        if square > farthest:
            farthest, at = square, k
    length = np.sqrt(farthest)
    cut = work.hull
    for side in range(2):
        cut[side, 3] = 0.0
        for j in range(3):
            cut[side, j] = (source[at, j] - centre[j]) / length * (1 - 2 * side)
            cut[side, 3] -= cut[side, j] * centre[j]
    return _divide(a, b, first, top, work)


@inner_kernel
def _divide(a, b, first, top, work):  # type: ignore[no-untyped-def]
    """Split a, if `first`, or b by the planes work.hull[:2], and store the parts at `top` and `top + 1`.

    Each part is in front of one of the planes, and gets a copy of the other polygon. Returns False if a part is
    empty, or if the polygon has too many corners to be split.
    """
    cut, still = (a, b) if first else (b, a)
    if cut.n > ROOM - 3:
        return False
    second, copy = (work.a[top + 1], work.b[top + 1]) if first else (work.b[top + 1], work.a[top + 1])
    one = clip(cut, work.hull, 0, work.eps, work.spare)
    two = clip(cut, work.hull, 1, work.eps, second)
    if one == 0 or two == 0:
        return False
    for j in range(3):
        for k in range(still.n):
            copy[k, j] = still.points[k, j]
        for k in range(one):
            cut.points[k, j] = work.spare[k, j]
    pairs, side = work.pairs, 0 if first else 1
    pairs[top, side], pairs[top, 1 - side] = one, still.n
    pairs[top + 1, side], pairs[top + 1, 1 - side] = two, still.n
    return True


@inner_kernel
def _standing(base, planes, i, clipped, work):  # type: ignore[no-untyped-def]
    """Return the index of the clipped occluder that stands on a polygon along the longest line; -1 if none does.

    Such a line is an edge of an occluder that lies inside the polygon, in planes[i]. Lines along the polygon's own
    edges do not count.
    """
    polygon, n = base
    eps = work.eps
    found, longest = -1, 8 * eps
    for s in range(clipped):
        count = work.clipped_count[s]
        outline = work.clipped[s]
        last = count - 1
        touches = abs(height(planes, i, outline[last, 0], outline[last, 1], outline[last, 2])) <= 2 * eps
        for k in range(count):
            touched, touches = (
                touches,
                abs(height(planes, i, outline[k, 0], outline[k, 1], outline[k, 2])) <= 2 * eps,
            )
            if touched and touches:
                x, y, z = outline[last, 0], outline[last, 1], outline[last, 2]
                dx, dy, dz = outline[k, 0] - x, outline[k, 1] - y, outline[k, 2] - z
                begin, end = 0.0, 1.0
                for c in range(n):
                    j = c + 1 if c + 1 < n else 0
                    ex, ey, ez = (
                        polygon[j, 0] - polygon[c, 0], polygon[j, 1] - polygon[c, 1], polygon[j, 2] - polygon[c, 2]
                    )  # fmt: skip
                    # Inward normal with the length of the edge.
                    mx = planes[i, 1] * ez - planes[i, 2] * ey
                    my = planes[i, 2] * ex - planes[i, 0] * ez
                    mz = planes[i, 0] * ey - planes[i, 1] * ex
                    at = mx * (x - polygon[c, 0]) + my * (y - polygon[c, 1]) + mz * (z - polygon[c, 2])
                    at -= 4 * eps * np.sqrt(ex * ex + ey * ey + ez * ez)
                    slope = mx * dx + my * dy + mz * dz
                    if slope > 0:
                        begin = max(begin, -at / slope)
                    elif slope < 0:
                        end = min(end, -at / slope)
                    elif at < 0:
                        end = -1.0
                length = (end - begin) * np.sqrt(dx * dx + dy * dy + dz * dz)
                if length > longest:
                    found, longest = s, length
            last = k
    return found


@kernel
def exchange_rows(first, last, facets, tree, occluders, error, rows, work):  # type: ignore[no-untyped-def]
    """Write a row of exchange areas into `rows` for each facet from `first` up to, not including, `last`.

    A row has the exchange areas of a facet with the facets of higher index.

    error : target error of the sum of a row of view factors

    Returns the first row that did not fit, or `last`; -1 if it was stopped.
    """
    pending, lists, eps, counts, shaft = work.pending, work.lists, work.eps, work.counts, work.shaft
    boxes, skip = tree.boxes, tree.skip
    total = len(facets.sides)
    size = 0
    for i in range(first, last):
        if size + total - i > len(rows.columns):
            return i
        own, plane = Polygon(facets.corners[i], facets.sides[i]), facets.planes[i]
        for k in range(6):
            shaft.a[k] = facets.boxes[i, k]
        # Collect all occluders with a part in front of the facet.
        count = 0
        for o in range(len(occluders.sides)):
            _, high = _heights(facets.planes, i, Polygon(occluders.corners[o], occluders.sides[o]))
            if high > eps:
                lists[count] = o
                count += 1
        pending[0, 0], pending[0, 1], pending[0, 2] = 0, 0, count
        top = 1
        while top:
            if work.stop[0] != 0:
                return -1
            top -= 1
            node, begin, end = pending[top, 0], pending[top, 1], pending[top, 2]
            if tree.first[skip[node]] <= i + 1:
                continue
            if highest(boxes, node, plane) <= eps:
                continue
            leaf = tree.leaf[node]
            j = np.int64(tree.first[node])
            if leaf:
                counts[PAIRS] += 1
                _, high = _heights(facets.planes, j, own)
                if high <= eps:
                    continue
            put = end
            if end > begin:
                box = shaft.b
                for k in range(6):
                    box[k] = boxes[node, k]
                form_shaft(shaft, eps, -1.0)
                hidden = False
                for c in range(begin, end):
                    hider = np.int64(lists[c])
                    if classify_box(occluders.boxes, hider, -1, shaft, False) == 0:
                        continue
                    parted = _may_occlude(hider, occluders, own, box, eps)
                    if parted == 0:
                        continue
                    if parted == 2 and not leaf:
                        for k in range(8):
                            work.box[k, 0] = box[3 * (k & 1)]
                            work.box[k, 1] = box[1 + 3 * (k >> 1 & 1)]
                            work.box[k, 2] = box[2 + 3 * (k >> 2)]
                        if hides_all(own, Polygon(work.box, len(work.box)), occluders, hider, work):
                            hidden = True
                            break
                    lists[put] = hider
                    put += 1
                if hidden:
                    counts[BRANCHES] += 1
                    continue
            if leaf:
                value, variance = _between(i, j, facets, occluders, end, put, error, work)
                if value > 0 or variance > 0:
                    rows.columns[size], rows.values[size], rows.errors[size] = j, value, np.sqrt(variance)
                    size += 1
                continue
            child = node + 1
            while child < skip[node]:
                pending[top, 0], pending[top, 1], pending[top, 2] = child, end, put
                top += 1
                child = skip[child]
        rows.ends[i - first] = size
        work.done[0] += 1
    # If the computation was stopped, the last pair may be unfinished.
    return last if work.stop[0] == 0 else -1
