"""Candidates between an emitter and a group of receiver points: the emitter list, and the lists of shafts.

Kernels. A list is a range of `Work`, and starts from the list of the group around, if there is one: shafts within
shafts [SC, Future Work].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.bvh import Float64, Int32
from glpath.accel.nodes import Bvh
from glpath.radiosity.shafts.occluders import ENDS, never_hit
from glpath.radiosity.shafts.options import CANDIDATES, EMPTY, LARGEST_FIRST, LISTS, SHAFT_TESTS, SHAFTS
from glpath.radiosity.shafts.shaft import (
    Strategy,
    Tree,
    empty_shaft,
    empty_stack,
    encloses,
    form_shaft,
    gather,
    overlaps,
)
from glpath.radiosity.shafts.sorting import merge_sort
from glpath.system.kernels import inner_kernel, kernel, kernel_part

_KEEP_CLOSED, _ALWAYS_OPEN, _RATIO_OPEN = (
    int(s) for s in (Strategy.KEEP_CLOSED, Strategy.ALWAYS_OPEN, Strategy.RATIO_OPEN)
)


class SearchTree(NamedTuple):
    """`Tree`, with the parents."""

    boxes: Float64
    skip: Int32
    first: Int32
    items: Int32
    order: Int32
    parent: Int32
    leaf_of: Int32

    @classmethod
    def of(cls, bvh: Bvh) -> SearchTree:
        tree = Tree.of(bvh)
        parent = np.full(len(tree.skip), -1, np.int32)
        leaf_of = np.full(len(tree.order), -1, np.int32)
        _upwards(tree, parent, leaf_of)
        return cls(*tree, parent, leaf_of)


class Settings(NamedTuple):
    """`ShaftOptions` for the kernels."""

    strategy: int
    ratio: float
    open_enclosing: bool
    coplanar: bool
    tolerance: bool
    coherency: bool
    together: bool
    object_boxes: bool
    order: int
    min_cut: float
    longest: int
    no_shaft_below: int
    keep_closed_below: int
    slack: float
    size: float


class Work(NamedTuple):
    """Room that a thread works in.

    nodes, flags, objects : lists of candidates one behind the other, those of the groups around before a group's
                            own: nodes of the tree, what is known of each (see `classify_box`), the polygon of a
                            leaf or -1
    planes .. extent      : the latest shaft
    a, b                  : its reference boxes
    stack                 : of `gather`
    mark                  : (M,) nodes that are outside a shaft, by its number; empty where they aren't marked
    latest                : (2,) the latest shaft's number, and the latest occluder or -1
    keys, by, spare       : (M,) of `merge_sort`; empty where lists are not sorted
    clear, before         : of rays that are tested together, (S, K) and (K,): which are not blocked yet, and which
                            points lie before the emitter
    at_a, at_b            : (3, S) and (3, K), forms of a polygon at their ends
    ends, lists           : (L,) of the groups around the current one where each ends, and (L, 4) its list
    """

    nodes: Int32
    flags: NDArray[np.int8]
    objects: Int32
    planes: Float64
    near: NDArray[np.int64]
    extent: Float64
    a: Float64
    b: Float64
    stack: Int32
    mark: NDArray[np.int64]
    latest: NDArray[np.int64]
    keys: Float64
    by: NDArray[np.int64]
    spare: NDArray[np.int64]
    clear: NDArray[np.uint8]
    before: NDArray[np.uint8]
    at_a: Float64
    at_b: Float64
    ends: NDArray[np.int64]
    lists: NDArray[np.int64]

    @classmethod
    def of(
        cls, tree: SearchTree, levels: int, samples: int, together: int, mailbox: bool, sorted_lists: bool
    ) -> Work:
        """For groups of so many levels, an emitter of so many samples, and at most `together` points at once."""
        nodes = len(tree.skip)
        room = (levels + 2) * nodes + 1
        longest = nodes if sorted_lists else 0
        planes, near, extent = empty_shaft()
        return cls(
            np.empty(room, np.int32), np.empty(room, np.int8), np.empty(room, np.int32), planes, near, extent,
            np.empty(6), np.empty(6), empty_stack(nodes), np.zeros(nodes if mailbox else 0, np.int64),
            np.array([0, -1]), np.empty(longest), np.empty(longest, np.int64), np.empty(longest, np.int64),
            np.empty((samples, together), np.uint8), np.empty(together, np.uint8), np.empty((3, samples)),
            np.empty((3, together)), np.empty(levels + 2, np.int64), np.empty((levels + 2, 4), np.int64),
        )  # fmt: skip


NUMBER, OCCLUDER = 0, 1


class CandidateRange(NamedTuple):
    """Candidates in `Work`: their range, whether boxes are tested, and the number of the shaft (-1: of none)."""

    begin: int
    end: int
    boxed: bool
    number: int


@kernel
def _upwards(tree, parent, leaf_of):  # type: ignore[no-untyped-def]
    """Fill each node's parent and each item's leaf, which are -1."""
    for node in range(len(tree.skip)):
        child = node + 1
        while child < tree.skip[node]:
            parent[child] = node
            child = tree.skip[child]
        for i in range(tree.first[node], tree.first[node] + tree.items[node]):
            leaf_of[tree.order[i]] = node


@inner_kernel
def highest(boxes, i, plane):  # type: ignore[no-untyped-def]
    """The largest height of boxes[i] over a plane (4,)."""
    max_height = plane[3]
    for k in range(3):
        max_height += plane[k] * boxes[i, k + 3 if plane[k] > 0 else k]
    return max_height


@kernel
def find_emitter_list(tree, box, plane, leaf, wanted, behind, touching, found, flags, pending):  # type: ignore[no-untyped-def]
    """See `Visibility.emitter_list`. Fills found and flags, (M,) as pending, and returns how many there are.

    leaf     : of the emitter's polygon, left out; -1 where it has none
    touching : the flag of what overlaps the emitter's box
    """
    n = 0
    if not len(tree.skip):
        return n
    # Walk up from the emitter; the siblings of its nodes are looked at. An emitter that is none of the objects, or
    # that has a larger box than its polygon, starts at the root.
    below = leaf
    node = tree.parent[leaf] if leaf >= 0 and wanted and encloses(tree.boxes, leaf, box) else -1
    if node < 0:
        pending[0] = 0
        node, below, waiting = -1, -1, 1
    else:
        waiting = 0
    while True:
        if node >= 0:
            child = node + 1
            while child < tree.skip[node]:
                if child != below:
                    pending[waiting] = child
                    waiting += 1
                child = tree.skip[child]
        while waiting:
            waiting -= 1
            item = pending[waiting]
            if item == leaf or (behind and highest(tree.boxes, item, plane) < 0):
                continue
            opened = wanted and tree.items[item] == 0 and encloses(tree.boxes, item, box)
            if opened:
                child = item + 1
                while child < tree.skip[item]:
                    pending[waiting] = child
                    waiting += 1
                    child = tree.skip[child]
            else:
                touches = overlaps(tree.boxes, item, box)
                found[n] = item
                flags[n] = -1 if encloses(tree.boxes, item, box) else (touching if touches else 0)
                n += 1
        if node < 0:
            break
        below, node = node, tree.parent[node]
    return n


@inner_kernel
def objects_of(tree, polygons, coplanar, object_boxes, size, own_a, own_b, begin, end, work):  # type: ignore[no-untyped-def]
    """Note which candidates are single polygons; leave out those that can't block between work.a and work.b.

    Returns the new end, and whether boxes are left.
    """
    items, first, order = tree.items, tree.first, tree.order
    nodes, flags, objects, a, b = work.nodes, work.flags, work.objects, work.a, work.b
    forms, kinds, length = polygons.forms, polygons.flags, polygons.length
    n = begin
    boxed = object_boxes
    for i in range(begin, end):
        node = np.int64(nodes[i])
        x = np.int64(-1)
        if items[node] == 1:
            x = np.int64(order[first[node]])
            if (x == own_a) | (x == own_b):
                continue
            if coplanar and never_hit(x, a, b, forms, kinds, length, size):
                continue
        else:
            boxed = True
        nodes[n], flags[n], objects[n] = node, flags[i], x
        n += 1
    return n, boxed


@kernel_part
def _largest_first(tree, begin, end, work):  # type: ignore[no-untyped-def]
    """Sort a list by the surface of the part of each box that lies in the shaft's extent box."""
    n = end - begin
    extent, boxes = work.extent, tree.boxes
    keys, by, spare = work.keys, work.by, work.spare
    for i in range(n):
        node = work.nodes[begin + i]
        x = min(boxes[node, 3], extent[3]) - max(boxes[node, 0], extent[0])
        y = min(boxes[node, 4], extent[4]) - max(boxes[node, 1], extent[1])
        z = min(boxes[node, 5], extent[5]) - max(boxes[node, 2], extent[2])
        keys[i] = -(x * y + y * z + z * x)
        by[i] = i
    merge_sort(keys, by, spare, n)
    _permute(work.nodes, begin, by, spare, n)
    _permute(work.objects, begin, by, spare, n)
    _permute(work.flags, begin, by, spare, n)


@inner_kernel
def _permute(values, begin, by, spare, n):  # type: ignore[no-untyped-def]
    for i in range(n):
        spare[i] = values[begin + by[i]]
    for i in range(n):
        values[begin + i] = spare[i]


@kernel  # and not a part of its callers, so that it can be compiled beside them
def shaft_list(tree, polygons, source, groups, group, parent, settings, leaf, work, counts):  # type: ignore[no-untyped-def]
    """Form the shaft between the emitter and a group; its candidates' range, behind the parent's."""
    share = ENDS if settings.tolerance else 0.0
    for k in range(6):
        # The points that lie this share along the segments from all of one box to all of the other.
        emitter, receiver = source.box[k], groups.boxes[group, k]
        work.a[k] = emitter + share * (receiver - emitter)
        work.b[k] = receiver + share * (emitter - receiver)
    work.latest[NUMBER] += 1
    number = work.latest[NUMBER]
    strategy = settings.strategy
    if ray_count(source, groups, group) < settings.keep_closed_below:
        strategy = _KEEP_CLOSED
    n = form_shaft(
        work.a, work.b, settings.slack, settings.min_cut, work.planes, work.near, work.extent
    )  # fmt: skip
    size, tests = gather(
        tree, work.nodes, work.flags, parent.begin, parent.end, work.a, work.b, work.extent, work.planes, work.near,
        n, strategy, settings.ratio, settings.open_enclosing, work.mark, number, work.stack, work.nodes, work.flags,
        parent.end, settings.longest if strategy == _ALWAYS_OPEN else len(tree.skip),
    )  # fmt: skip
    if size < 0:  # too many to test one by one: keep boxes of them
        size, more = gather(
            tree, work.nodes, work.flags, parent.begin, parent.end, work.a, work.b, work.extent, work.planes,
            work.near, n, _RATIO_OPEN, settings.ratio, settings.open_enclosing, work.mark, number, work.stack,
            work.nodes, work.flags, parent.end, len(tree.skip),
        )  # fmt: skip
        tests += more
    end, boxed = objects_of(
        tree, polygons, settings.coplanar, settings.object_boxes, settings.size, source.polygon,
        groups.polygon[group], parent.end, size, work,
    )  # fmt: skip
    if leaf and settings.order == LARGEST_FIRST:
        _largest_first(tree, parent.end, end, work)
    counts[SHAFTS] += 1
    counts[SHAFT_TESTS] += tests
    if end == parent.end:
        counts[EMPTY] += 1
    elif leaf:
        counts[LISTS] += 1
        counts[CANDIDATES] += end - parent.end
    return CandidateRange(parent.end, end, boxed, number)


@inner_kernel
def ray_count(source, groups, group):  # type: ignore[no-untyped-def]
    return (groups.end[group] - groups.begin[group]) * len(source.points)
