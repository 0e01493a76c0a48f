"""Candidate occluders between an emitter and a group of receiver points: the emitter list, and lists of shafts.

A list is a range of `Work.lists`. The list of a nested shaft is made from that of the enclosing group [SC, Future
Work].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.bvh import Float64, Int32
from glpath.accel.nodes import Bvh, Tree
from glpath.radiosity.shafts.ends import Lit, Source
from glpath.radiosity.shafts.occluders import ENDS, Polygons, never_hit
from glpath.radiosity.shafts.options import CANDIDATES, EMPTY, LARGEST_FIRST, LISTS, SHAFT_TESTS, SHAFTS, STATISTICS
from glpath.radiosity.shafts.points import Groups
from glpath.radiosity.shafts.shaft import (
    CandidateLists,
    FormedShaft,
    Opening,
    Strategy,
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
    """Tree with the parent of each node, and the leaf of each item."""

    tree: Tree
    parent: Int32
    leaf_of: Int32

    @classmethod
    def of(cls, bvh: Bvh) -> SearchTree:
        tree = Tree.of(bvh)
        parent = np.full(len(tree.skip), -1, np.int32)
        leaf_of = np.full(len(tree.order), -1, np.int32)
        _upwards(tree, parent, leaf_of)
        return cls(tree, parent, leaf_of)


class Settings(NamedTuple):
    """`ShaftOptions` as numbers for the kernels."""

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


class Step(NamedTuple):
    """Input and output of the visibility between one emitter and all receivers.

    visible : (P, S) bool, the result
    """

    tree: Tree
    polygons: Polygons
    source: Source
    lit: Lit
    groups: Groups
    settings: Settings
    visible: NDArray[np.bool_]


class Bundle(NamedTuple):
    """Rays that are tested together.

    clear      : (S, K) 1 for rays that are not blocked so far
    before     : (K,) 1 for points in front of the emitter
    at_a, at_b : (3, S) and (3, K), a polygon's plane equation and its two equations of edges at the S samples and
                 at the K points
    """

    clear: NDArray[np.uint8]
    before: NDArray[np.uint8]
    at_a: Float64
    at_b: Float64


class Work(NamedTuple):
    """Working memory of a thread.

    lists           : candidate lists, those of enclosing groups before a group's own
    shaft           : latest shaft
    latest          : (2,) number of the latest shaft, and the latest occluder or -1
    keys, by, spare : (M,) working memory of `merge_sort`; empty if lists are not sorted
    ends, around    : (L,) end, and (L, 4) list, of each group around the current one
    counts          : counts of `Statistics`, which are increased
    stop            : flag of `worker_threads`, which ends the work
    """

    lists: CandidateLists
    shaft: FormedShaft
    latest: NDArray[np.int64]
    keys: Float64
    by: NDArray[np.int64]
    spare: NDArray[np.int64]
    bundle: Bundle
    ends: NDArray[np.int64]
    around: NDArray[np.int64]
    counts: NDArray[np.int64]
    stop: NDArray[np.int64]

    @classmethod
    def of(cls, step: Step, together: int, mailbox: bool, stop: NDArray[np.int64]) -> Work:
        """Allocate the working memory for groups of at most `together` points, whose rays are tested together."""
        nodes, levels, samples = len(step.tree.skip), step.groups.levels, len(step.source.points)
        room = (levels + 2) * nodes + 1
        longest = nodes if step.settings.order == LARGEST_FIRST else 0
        clear, before = np.empty((samples, together), np.uint8), np.empty(together, np.uint8)
        bundle = Bundle(clear, before, np.empty((3, samples)), np.empty((3, together)))
        return cls(
            CandidateLists.empty(nodes, room, room, mailbox),
            FormedShaft.between(np.empty(6), np.empty(6)),
            np.array([0, -1]),
            np.empty(longest),
            np.empty(longest, np.int64),
            np.empty(longest, np.int64),
            bundle,
            np.empty(levels + 2, np.int64),
            np.empty((levels + 2, 4), np.int64),
            np.zeros(STATISTICS, np.int64),
            stop,
        )


NUMBER, OCCLUDER = 0, 1


class CandidateRange(NamedTuple):
    """Candidates in `Work`: their range, True if rays are tested against boxes, and the shaft's number or -1."""

    begin: int
    end: int
    boxed: bool
    number: int


@kernel
def _upwards(tree, parent, leaf_of):  # type: ignore[no-untyped-def]
    """Fill in each node's parent and each item's leaf, which are -1 before."""
    for node in range(len(tree.skip)):
        child = node + 1
        while child < tree.skip[node]:
            parent[child] = node
            child = tree.skip[child]
        for i in range(tree.first[node], tree.first[node] + tree.items[node]):
            leaf_of[tree.order[i]] = node


@inner_kernel
def highest(boxes, i, plane):  # type: ignore[no-untyped-def]
    """Return the largest height of boxes[i] over a plane (4,)."""
    max_height = plane[3]
    for k in range(3):
        max_height += plane[k] * boxes[i, k + 3 if plane[k] > 0 else k]
    return max_height


@kernel
def find_emitter_list(search, source, wanted, behind, touching, lists):  # type: ignore[no-untyped-def]
    """Fill the nodes and flags of `lists` as `Visibility.emitter_list` describes, and return their number.

    touching : flag to store for nodes whose box overlaps the emitter's without enclosing it
    """
    tree, parent, leaf_of = search
    # Leaf of the emitter's own polygon, which the list leaves out, because it cannot block its own light.
    leaf = np.int64(leaf_of[source.polygon]) if source.polygon >= 0 else -1
    box, plane, pending = source.box, source.plane, lists.stack[:, 0]
    n = 0
    if not len(tree.skip):
        return n
    # Walk up from the emitter, and test the siblings of each node on the path. If the emitter is not an occluder,
    # or its box is larger than its polygon's, test nodes from the root down instead.
    below = leaf
    node = parent[leaf] if leaf >= 0 and wanted and encloses(tree.boxes, leaf, box) else -1
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
                lists.nodes[n] = item
                lists.flags[n] = -1 if encloses(tree.boxes, item, box) else (touching if touches else 0)
                n += 1
        if node < 0:
            break
        below, node = node, parent[node]
    return n


@inner_kernel
def objects_of(step, coplanar, own_b, begin, end, work):  # type: ignore[no-untyped-def]
    """Record which candidates are single polygons; remove those that cannot block between the shaft's boxes.

    coplanar : True to also remove polygons that have both of the shaft's boxes on one side of their plane
    own_b    : index of the polygon that contains the receiver points

    Returns the new end, and True if boxes must be tested.
    """
    tree, polygons, settings, own_a = step.tree, step.polygons, step.settings, step.source.polygon
    lists, shaft = work.lists, work.shaft
    items, first, order = tree.items, tree.first, tree.order
    nodes, flags, objects = lists.nodes, lists.flags, lists.objects
    n = begin
    boxed = settings.object_boxes
    for i in range(begin, end):
        node = np.int64(nodes[i])
        x = np.int64(-1)
        if items[node] == 1:
            x = np.int64(order[first[node]])
            if (x == own_a) | (x == own_b):
                continue
            if coplanar and never_hit(x, shaft.a, shaft.b, polygons, settings.size):
                continue
        else:
            boxed = True
        nodes[n], flags[n], objects[n] = node, flags[i], x
        n += 1
    return n, boxed


@kernel_part
def _largest_first(tree, begin, end, work):  # type: ignore[no-untyped-def]
    """Sort a list by the surface area of each box's part inside the shaft's extent box, largest first."""
    n = end - begin
    extent, boxes, lists = work.shaft.extent, tree.boxes, work.lists
    keys, by, spare = work.keys, work.by, work.spare
    for i in range(n):
        node = lists.nodes[begin + i]
        x = min(boxes[node, 3], extent[3]) - max(boxes[node, 0], extent[0])
        y = min(boxes[node, 4], extent[4]) - max(boxes[node, 1], extent[1])
        z = min(boxes[node, 5], extent[5]) - max(boxes[node, 2], extent[2])
        keys[i] = -(x * y + y * z + z * x)
        by[i] = i
    merge_sort(keys, by, spare, n)
    _permute(lists.nodes, begin, by, spare, n)
    _permute(lists.objects, begin, by, spare, n)
    _permute(lists.flags, begin, by, spare, n)


@inner_kernel
def _permute(values, begin, by, spare, n):  # type: ignore[no-untyped-def]
    for i in range(n):
        spare[i] = values[begin + by[i]]
    for i in range(n):
        values[begin + i] = spare[i]


@kernel  # separate from its callers, so that it is compiled in parallel with them
def shaft_list(step, group, parent, leaf, work):  # type: ignore[no-untyped-def]
    """Form the shaft between the emitter and a group; return its candidates, stored after those of `parent`.

    parent : candidates of the enclosing group, from which those of this shaft are selected
    leaf   : True if rays are cast through this shaft; False if only nested shafts start from it
    """
    tree, source, groups, settings = step.tree, step.source, step.groups, step.settings
    lists, shaft, latest, counts = work.lists, work.shaft, work.latest, work.counts
    share = ENDS if settings.tolerance else 0.0
    for k in range(6):
        # Each segment has two points at the fraction `share` of its length from either end. The shaft's boxes
        # contain them.
        emitter, receiver = source.box[k], groups.boxes[group, k]
        shaft.a[k] = emitter + share * (receiver - emitter)
        shaft.b[k] = receiver + share * (emitter - receiver)
    latest[NUMBER] += 1
    number = latest[NUMBER]
    strategy = settings.strategy
    if ray_count(source, groups, group) < settings.keep_closed_below:
        strategy = _KEEP_CLOSED
    form_shaft(shaft, settings.slack, settings.min_cut)
    nodes = len(tree.skip)
    longest = settings.longest if strategy == _ALWAYS_OPEN else nodes
    opening = Opening(strategy, settings.ratio, settings.open_enclosing)
    size, tests = gather(tree, shaft, opening, lists, parent.begin, parent.end, number, longest)
    if size < 0:  # too many to test one by one, so keep boxes closed
        opening = Opening(_RATIO_OPEN, settings.ratio, settings.open_enclosing)
        size, more = gather(tree, shaft, opening, lists, parent.begin, parent.end, number, nodes)
        tests += more
    end, boxed = objects_of(step, settings.coplanar, groups.polygon[group], parent.end, size, work)
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
