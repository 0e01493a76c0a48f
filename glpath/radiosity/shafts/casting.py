"""Cast segments between an emitter's samples and receiver points against candidate lists.

`_cast_together` tests all rays of a group against one candidate at a time, which suits vector units.
`_cast_one_by_one` tests one ray at a time until it is blocked, as in the paper on shafts [SC].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glpath.radiosity.shafts.ends import before_emitter, before_receiver, segment_between
from glpath.radiosity.shafts.occluders import ENDS, PARALLELOGRAM, SLIVER, SOLID, crosses, height, hits
from glpath.radiosity.shafts.options import (
    BLOCKED,
    BOX_TESTS,
    CACHED,
    FREE,
    LAST_OCCLUDER_FIRST,
    OBJECT_TESTS,
    RAYS,
)
from glpath.radiosity.shafts.points import SEVERAL
from glpath.radiosity.shafts.search import OCCLUDER, CandidateRange, highest, objects_of, ray_count, shaft_list
from glpath.system.kernels import inner_kernel, kernel, kernel_part


@inner_kernel
def _box_hit(boxes, i, ax, ay, az, ix, iy, iz):  # type: ignore[no-untyped-def]
    """Return True if a segment hits boxes[i], except in the fraction `ENDS` of its length at either end.

    A segment that hits a box also hits every enclosing box, because every step preserves order despite rounding.

    ix, iy, iz : finite inverse of b - a
    """
    t0, t1 = (boxes[i, 0] - ax) * ix, (boxes[i, 3] - ax) * ix
    near, far = max(ENDS, min(t0, t1)), min(1 - ENDS, max(t0, t1))
    t0, t1 = (boxes[i, 1] - ay) * iy, (boxes[i, 4] - ay) * iy
    near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    t0, t1 = (boxes[i, 2] - az) * iz, (boxes[i, 5] - az) * iz
    near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near <= far


@inner_kernel
def _inverse(d):  # type: ignore[no-untyped-def]
    """Return 1 / d, limited to 1e300, so that its product with 0 is not NaN."""
    return 1 / d if abs(d) > 1e-300 else (1e300 if d >= 0 else -1e300)


@inner_kernel
def _occluder(segment, found, tree, polygons, object_boxes, lists):  # type: ignore[no-untyped-def]
    """Return the first polygon, in the order of a list, that a segment crosses, and its index in the list.

    Both are -1 if the segment crosses none. Also returned are the counts of box and object tests.
    """
    ax, ay, az, bx, by, bz, own_a, own_b = segment
    ix = iy = iz = 0.0
    if found.boxed:
        ix, iy, iz = _inverse(bx - ax), _inverse(by - ay), _inverse(bz - az)
    box_tests, object_tests = 0, 0
    boxes, skip, items, first, order = tree.boxes, tree.skip, tree.items, tree.first, tree.order
    nodes, objects, mark, number = lists.nodes, lists.objects, lists.mark, found.number
    for i in range(found.begin, found.end):
        x = np.int64(objects[i])  # the same type everywhere, so that functions are compiled once
        if x >= 0:
            if (x == own_a) | (x == own_b):
                continue
            if object_boxes:
                box_tests += 1
                if not _box_hit(boxes, nodes[i], ax, ay, az, ix, iy, iz):
                    continue
            object_tests += 1
            if hits(x, segment, polygons):
                return x, i, box_tests, object_tests
            continue
        node = np.int64(nodes[i])
        last = skip[node]
        while node < last:
            if len(mark) and mark[node] == number:
                node = np.int64(skip[node])
                continue
            leaf = items[node] > 0
            if not leaf or object_boxes:
                box_tests += 1
                if not _box_hit(boxes, node, ax, ay, az, ix, iy, iz):
                    node = np.int64(skip[node])
                    continue
            if leaf:
                for k in range(first[node], first[node] + items[node]):
                    x = np.int64(order[k])
                    if (x != own_a) & (x != own_b):
                        object_tests += 1
                        if hits(x, segment, polygons):
                            return x, i, box_tests, object_tests
            node += 1
    return -1, -1, box_tests, object_tests


@kernel_part
def _cast_one_by_one(step, group, found, built, work):  # type: ignore[no-untyped-def]
    """Cast the rays of a group as in the paper: test the last occluder, then the shaft's list up to the first hit.

    found : candidates to test if `built` is True; otherwise those of the enclosing group. The shaft of this group
            is then built from them when the first ray needs it
    """
    tree, polygons, source, lit, groups, settings, visible = step
    lists, latest, counts = work.lists, work.latest, work.counts
    samples = len(source.points)
    for k in range(groups.begin[group], groups.end[group]):
        if not before_emitter(lit, k, source):
            continue
        p = groups.order[k]
        for s in range(samples):
            if not before_receiver(lit, k, source, s):
                continue
            counts[RAYS] += 1
            segment = segment_between(source, s, lit, k)
            if not built or found.begin < found.end:
                last = latest[OCCLUDER]
                if settings.coherency and last >= 0 and last != segment.own_b:
                    counts[OBJECT_TESTS] += 1
                    if hits(last, segment, polygons):
                        counts[CACHED] += 1
                        counts[BLOCKED] += 1
                        continue
                if not built:
                    built = True
                    found = shaft_list(step, group, found, True, work)
            if found.begin == found.end:
                counts[FREE] += 1
                visible[p, s] = True
                continue
            x, at, box_tests, object_tests = _occluder(segment, found, tree, polygons, settings.object_boxes, lists)
            counts[BOX_TESTS] += box_tests
            counts[OBJECT_TESTS] += object_tests
            if x < 0:
                visible[p, s] = True
                continue
            counts[BLOCKED] += 1
            latest[OCCLUDER] = x
            if settings.order == LAST_OCCLUDER_FIRST:
                _to_front(at, found.begin, lists)


@kernel_part
def _to_front(at, begin, lists):  # type: ignore[no-untyped-def]
    nodes, flags, objects = lists.nodes, lists.flags, lists.objects
    node, flag, x = nodes[at], flags[at], objects[at]
    for k in range(at, begin, -1):
        nodes[k], flags[k], objects[k] = nodes[k - 1], flags[k - 1], objects[k - 1]
    nodes[begin], flags[begin], objects[begin] = node, flag, x


class _Clump(NamedTuple):
    """Points of a group: index of the first, number of points, and the polygon that contains all, see `Groups`."""

    begin: int
    size: int
    own: int


@kernel_part
def _cast_together(step, group, found, built, work):  # type: ignore[no-untyped-def]
    """Cast all rays of a group against one candidate after the other.

    The inner loops are over rays, so that the compiler can use SIMD instructions.
    """
    tree, polygons, source, lit, groups, settings, visible = step
    lists, latest, counts, bundle = work.lists, work.latest, work.counts, work.bundle
    begin, own = groups.begin[group], groups.polygon[group]
    clump = _Clump(begin, groups.end[group] - begin, own)
    samples, clear = len(source.points), bundle.clear
    left = _start(source, lit, groups.normal, group, clump, bundle)
    if left == 0:
        return
    rays = left
    counts[RAYS] += rays
    last = latest[OCCLUDER]
    if settings.coherency and last >= 0 and last != own and not (built and found.begin == found.end):
        counts[OBJECT_TESTS] += left
        left = _block(last, polygons, source, lit, clump, bundle, left)
        counts[CACHED] += rays - left
    if left and not built:
        found = shaft_list(step, group, found, True, work)
    if found.begin == found.end:
        counts[FREE] += left
    boxes = False
    max_blocked = 0
    for i in range(found.begin, found.end):
        if left == 0:
            break
        x = np.int64(lists.objects[i])
        if x < 0:
            boxes = True
        elif x != own:
            counts[OBJECT_TESTS] += left
            before = left
            left = _block(x, polygons, source, lit, clump, bundle, left)
            if before - left > max_blocked:
                max_blocked = before - left
                latest[OCCLUDER] = x
    if left and boxes:
        for k in range(clump.size):
            for s in range(samples):
                if clear[s, k]:
                    segment = segment_between(source, s, lit, begin + k)
                    x, _, box_tests, object_tests = _occluder(segment, found, tree, polygons, False, lists)
                    counts[BOX_TESTS] += box_tests
                    counts[OBJECT_TESTS] += object_tests
                    if x >= 0:
                        clear[s, k] = 0
                        left -= 1
    counts[BLOCKED] += rays - left
    if left:  # if no ray is left, `visible` stays all False, as it was before
        order = groups.order
        for k in range(clump.size):
            p = order[begin + k]
            for s in range(samples):
                visible[p, s] = clear[s, k]


@kernel_part
def _start(source, lit, common, group, clump, bundle):  # type: ignore[no-untyped-def]
    """Set `clear` to 1 for rays to be cast, whose ends face each other; return their number.

    common : (M, 3), common normal of each group's points; 0 if their normals differ
    """
    clear, before, begin, count = bundle.clear, bundle.before, clump.begin, clump.size
    samples = len(source.points)
    n, a, heights = lit.normals, source.points, lit.heights
    left = np.int64(0)  # 64 bits also when run as Python, because a sum of bytes would overflow
    for k in range(count):
        before[k] = before_emitter(lit, begin + k, source)
        left += before[k]
    if left == 0:
        return 0
    flat = lit.one_sided and (common[group, 0] != 0 or common[group, 1] != 0 or common[group, 2] != 0)
    left = np.int64(0)
    for s in range(samples):
        if not lit.one_sided:
            for k in range(count):
                clear[s, k] = before[k]
        elif flat:  # the same test as `before_receiver`, with the common normal
            height = n[begin, 0] * a[s, 0] + n[begin, 1] * a[s, 1] + n[begin, 2] * a[s, 2]
            for k in range(count):
                clear[s, k] = before[k] & (height > heights[begin + k])
        else:
            for k in range(count):
                clear[s, k] = before[k] and before_receiver(lit, begin + k, source, s)
        for k in range(count):
            left += clear[s, k]
    return left


@inner_kernel
def _block(x, polygons, source, lit, clump, bundle, left):  # type: ignore[no-untyped-def]
    """Set `bundle.clear` to 0 for the rays that polygon x blocks; return the number of rays that are still clear.

    left : number of clear rays before the call
    """
    begin, count, own = clump
    clear, at_a, at_b = bundle.clear, bundle.at_a, bundle.at_b
    forms, flag = polygons.forms, polygons.flags[x]
    a, bx, by, bz, own_b = source.points, lit.x, lit.y, lit.z, lit.own
    samples = len(a)
    before_a = before_b = 0
    f0, f1, f2, f3 = forms[x, 0], forms[x, 1], forms[x, 2], forms[x, 3]
    for s in range(samples):
        at_a[0, s] = height(f0, f1, f2, f3, a[s, 0], a[s, 1], a[s, 2])
        before_a += at_a[0, s] > 0
    for k in range(count):
        at_b[0, k] = height(f0, f1, f2, f3, bx[begin + k], by[begin + k], bz[begin + k])
        before_b += at_b[0, k] > 0
    # Stop if no segment can cross the plane, or only from the back of a solid.
    if not ((before_a and before_b < count) or (before_a < samples and before_b and not flag & SOLID)):
        return left
    for j in range(1, 3):
        i = 4 * j
        f0, f1, f2, f3 = forms[x, i], forms[x, i + 1], forms[x, i + 2], forms[x, i + 3]
        for s in range(samples):
            at_a[j, s] = height(f0, f1, f2, f3, a[s, 0], a[s, 1], a[s, 2])
        for k in range(count):
            at_b[j, k] = height(f0, f1, f2, f3, bx[begin + k], by[begin + k], bz[begin + k])
    mine = False
    if own == SEVERAL:
        for k in range(count):
            mine |= own_b[begin + k] == x
    if flag & SLIVER or mine:
        for s in range(samples):
            for k in range(count):
                segment = segment_between(source, s, lit, begin + k)
                if clear[s, k] and segment.own_b != x and hits(x, segment, polygons):
                    clear[s, k] = 0
    elif flag & PARALLELOGRAM:
        _cross_all(at_a, at_b, True, flag & SOLID != 0, samples, count, clear)
    else:
        _cross_all(at_a, at_b, False, flag & SOLID != 0, samples, count, clear)
    left = np.int64(0)
    for s in range(samples):
        for k in range(count):
            left += clear[s, k]
    return left


@inner_kernel
def _cross_all(at_a, at_b, parallelogram, solid, samples, count, clear):  # type: ignore[no-untyped-def]
    """Clear the rays that cross a polygon, tested as by `hits` but all at once.

    at_a, at_b : (3, n), values of the polygon's three linear forms at the samples and at the receiver points
    """
    for s in range(samples):
        ha, ua, va = at_a[0, s], at_a[1, s], at_a[2, s]
        if ha > 0:
            for k in range(count):
                clear[s, k] &= not crosses(ha, ua, va, at_b[0, k], at_b[1, k], at_b[2, k], parallelogram)
        elif not solid:
            for k in range(count):
                clear[s, k] &= not crosses(-ha, ua, va, -at_b[0, k], at_b[1, k], at_b[2, k], parallelogram)


@kernel_part
def _turned_away(source, groups, group):  # type: ignore[no-untyped-def]
    """Return the emitter's maximum height above a group's points along their common normal; 0 if they have none."""
    max_height = 0.0
    for k in range(3):
        n = groups.normal[group, k]
        i, j = (k + 3, k) if n > 0 else (k, k + 3)
        max_height += n * (source.box[i] - groups.boxes[group, j])
    return max_height


@kernel
def cast_groups(step, first, last, roots, root_flags, work):  # type: ignore[no-untyped-def]
    """Cast the rays of groups `first` to `last` - 1, whose descendants all lie in the same range.

    roots, root_flags : nodes and flags of the emitter list, from which candidate lists are made
    """
    source, lit, groups, settings = step.source, step.lit, step.groups, step.settings
    lists, around = work.lists, work.around
    for i in range(len(roots)):
        lists.nodes[i], lists.flags[i] = roots[i], root_flags[i]
    top, boxed = objects_of(step, False, -1, 0, len(roots), work)
    found = CandidateRange(0, top, boxed, -1)
    # Stack of the groups around the current one: end and candidate list of each. The outermost is the emitter list.
    ends, level = work.ends, 0
    ends[0] = last
    _keep_list(around, level, found)
    tiny = -1e-12 * settings.size

    group = first
    while group < last and work.stop[0] == 0:
        while group >= ends[level]:
            level -= 1
        # Facing tests come first, for all points of the group at once.
        if (source.one_sided and highest(groups.boxes, group, source.plane) < tiny) or (
            lit.one_sided and _turned_away(source, groups, group) < tiny
        ):
            group = groups.skip[group]
            continue
        found = _kept_list(around, level)
        built = settings.strategy < 0 or ray_count(source, groups, group) < settings.no_shaft_below
        if groups.skip[group] > group + 1:
            if not built:
                found = shaft_list(step, group, found, False, work)
            if found.begin < found.end:
                level += 1
                ends[level] = groups.skip[group]
                _keep_list(around, level, found)
                group += 1
                continue
            built = True  # an empty list: nothing occludes the parts of this group
        if settings.together:
            _cast_together(step, group, found, built, work)
        else:
            _cast_one_by_one(step, group, found, built, work)
        group = groups.skip[group]


@kernel_part
def _keep_list(lists, level, found):  # type: ignore[no-untyped-def]
    lists[level, 0], lists[level, 1], lists[level, 2] = found.begin, found.end, found.boxed
    lists[level, 3] = found.number


@kernel_part
def _kept_list(lists, level):  # type: ignore[no-untyped-def]
    return CandidateRange(lists[level, 0], lists[level, 1], lists[level, 2] != 0, lists[level, 3])
