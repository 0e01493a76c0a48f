"""Visibility between the samples of an emitter and the points of receivers, by shafts [SC].

    visibility = Visibility(Blockers.of_scene(scene))
    visibility.visible(points_a, points_b)                  # (A, B) bool, between two sets of points
    visibility.step(emitter, receivers)                     # one emitter against all receivers, with statistics

A shaft is built between the emitter and a clump of receiver points; segments between the two are tested against its
candidate list alone, and where that is empty no segment is tested at all. All options lead to exactly the same answer,
that of testing every segment against every polygon; they differ in what it costs. `Options` tells by how much.

Cost:     see `glpath bench shaft`; shafts are shared between threads.
Poor at:  few rays per shaft: a shaft costs as much as some ten rays.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError
from glpath.hierarchy import Float64, Hierarchy, Int32, build_hierarchy
from glpath.kernels import kernel
from glpath.radiosity.blockers import ENDS, Blockers, hits, never_hit
from glpath.radiosity.clusters import cluster
from glpath.radiosity.points import Groups, group_points
from glpath.radiosity.shaft import (
    Strategy,
    Tree,
    empty_shaft,
    empty_stack,
    encloses,
    form_shaft,
    gather,
    overlaps,
)

StrategyName = Literal["no shaft", "keep closed", "always open", "overlap open", "ratio open"]
STRATEGIES: dict[StrategyName, int] = {
    "no shaft": -1,
    "keep closed": Strategy.KEEP_CLOSED,
    "always open": Strategy.ALWAYS_OPEN,
    "overlap open": Strategy.OVERLAP_OPEN,
    "ratio open": Strategy.RATIO_OPEN,
}
OrderName = Literal["found", "largest first", "last blocker first"]
ORDERS: dict[OrderName, int] = {"found": 0, "largest first": 1, "last blocker first": 2}
_LARGEST_FIRST, _LAST_BLOCKER_FIRST = 1, 2


@dataclass(frozen=True)
class Options:
    """How candidates are found; none of it changes what is visible. The defaults are the quickest of the office scenes.

    strategy          : what becomes of boxes that are not outside a shaft, see `Strategy`; "no shaft" is the baseline, a
                        ray caster through the hierarchy
    ratio             : of "ratio open", 0 to 1: the share of children above which a box stays closed
    open_enclosing    : open boxes that enclose a reference box, as every ray would hit them
    emitter_list      : start at what the emitter does not lie in, found once per step
    behind_emitter    : leave out what lies behind a one-sided emitter, once per step
    solids            : leave out polygons of closed surfaces that face away from the emitter. Only where no emitter
                        sample lies inside of another solid: back faces do not block then
    coplanar          : leave out polygons whose plane has the emitter and the receiver on one side
    mailbox           : "ratio open" marks the children that are outside below a box that stays closed
    tolerance         : shafts begin and end where segments can be blocked, not at the surfaces, so that neighbours of
                        the receiver stay out
    coherency         : test the last ray's blocker first, and build the shaft when it misses
    object_boxes      : test a polygon's box before the polygon, as the paper does
    clump             : most points of a receiver that share a shaft; 0 for all of them
    group             : most points of several receivers that share a shaft, for whose parts further shafts are made; 0
                        for none
    nested            : a clump's shaft starts from the candidate list of its receiver's or group's
    order             : of the candidate list: as found, the largest first, or the last blocker moved to the front
    least_cut         : planes sorted by the volume they cut off the extent box, those below this share of it left out;
                        None for all planes unsorted
    no_shaft_below    : number of rays below which no shaft is built
    keep_closed_below : number of rays below which the strategy is "keep closed"
    """

    strategy: StrategyName = "ratio open"
    ratio: float = 0.4
    open_enclosing: bool = True
    emitter_list: bool = True
    behind_emitter: bool = True
    solids: bool = False
    coplanar: bool = True
    mailbox: bool = True
    tolerance: bool = True
    coherency: bool = True
    object_boxes: bool = False
    clump: int = 16
    group: int = 512
    nested: bool = True
    order: OrderName = "found"
    least_cut: float | None = None
    no_shaft_below: int = 0
    keep_closed_below: int = 0

    def __post_init__(self) -> None:
        for name, allowed in (("strategy", STRATEGIES), ("order", ORDERS)):
            if getattr(self, name) not in allowed:
                raise UsageError(f"Options.{name} is {getattr(self, name)!r}; allowed are {', '.join(allowed)}.")
        for name in ("clump", "group", "no_shaft_below", "keep_closed_below"):
            if getattr(self, name) < 0:
                raise UsageError(f"Options.{name} is {getattr(self, name)}; allowed are whole numbers from 0.")
        if not 0 <= self.ratio <= 1:
            raise UsageError(f"Options.ratio is {self.ratio}; allowed are 0 to 1.")


#: The paper's own: one shaft per receiver, every object with a box, nothing of what it leaves to the future.
PAPER = Options(
    solids=False, coplanar=False, object_boxes=True, clump=0, group=0, nested=False, tolerance=True, mailbox=True
)


@dataclass(frozen=True)
class Emitter:
    """Points that light comes from.

    points  : (S, 3) float64
    normal  : (3,) of a one-sided emitter, which lights only what lies before it; None for light to all sides
    polygon : the blocker that the points lie on, which does not block them; -1 for none
    box     : (6,) lower and upper corner, around the points; None for the smallest
    """

    points: Float64
    normal: Float64 | None = None
    polygon: int = -1
    box: Float64 | None = None


@dataclass(frozen=True)
class Receivers:
    """Points that light comes to, receiver after receiver.

    points   : (P, 3) float64
    receiver : (P,) int32, the receiver of each point, in ascending order
    normals  : (P, 3) of one-sided receivers, which are lit from their front only; None for all sides
    polygons : (P,) int32, the blocker that each point lies on, which does not block it; -1 for none; None: none at all
    """

    points: Float64
    receiver: Int32
    normals: Float64 | None = None
    polygons: Int32 | None = None


@dataclass
class Statistics:
    """What a step did. Rays are segments that are cast because both ends face each other.

    shafts       : formed
    empty_shafts : without any candidate, so that all their rays are free
    shaft_tests  : of boxes against shafts
    candidates   : on the lists of shafts that rays were cast through
    lists        : how many lists that were
    rays         : all of them
    blocked      : of the rays
    cached       : rays that the last blocker stopped, with one test each
    free         : rays through shafts without candidates, without any test
    box_tests    : of rays against boxes
    object_tests : of rays against polygons, those of cached rays included
    """

    shafts: int = 0
    empty_shafts: int = 0
    shaft_tests: int = 0
    candidates: int = 0
    lists: int = 0
    rays: int = 0
    blocked: int = 0
    cached: int = 0
    free: int = 0
    box_tests: int = 0
    object_tests: int = 0

    @property
    def tests(self) -> int:
        """Of rays, against boxes and polygons."""
        return self.box_tests + self.object_tests

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


_SHAFTS, _EMPTY, _SHAFT_TESTS, _CANDIDATES, _LISTS = 0, 1, 2, 3, 4
_RAYS, _BLOCKED, _CACHED, _FREE, _BOX_TESTS, _OBJECT_TESTS = 5, 6, 7, 8, 9, 10


@dataclass
class Visibility:
    """Who sees whom among some blockers.

    Parameters
    ----------
    blockers  : the polygons that can stand between
    options   : how they are looked for
    hierarchy : "areas", by `build_hierarchy`, or "clusters", by Goldsmith and Salmon as in the paper
    threads   : that share the work; None for one per core
    """

    blockers: Blockers
    options: Options = field(default_factory=Options)
    hierarchy: Literal["areas", "clusters"] = "areas"
    threads: int | None = None

    @cached_property
    def tree(self) -> Hierarchy:
        """Of the blockers' boxes, every leaf one polygon."""
        boxes = self.blockers.boxes()
        return cluster(*boxes) if self.hierarchy == "clusters" else build_hierarchy(*boxes, leaf_size=1)

    @cached_property
    def _kernel_tree(self) -> _SearchTree:
        return _SearchTree.of(self.tree)

    @cached_property
    def _polygons(self):  # type: ignore[no-untyped-def]
        return self.blockers.polygons(self.options.solids)

    def visible(self, points_a: ArrayLike, points_b: ArrayLike) -> NDArray[np.bool_]:
        """(A, B) bool: whether nothing stands between each point of one set and each of the other.

        points_a, points_b : (A, 3) and (B, 3). Blockers within a share of 1e-5 of the segment from its ends don't
        count, so that points may lie on surfaces. `Options.solids` takes points_a for the emitter.
        """
        a, b = np.array(points_a, np.float64), np.array(points_b, np.float64)
        receivers = Receivers(b, np.zeros(len(b), np.int32))
        return np.ascontiguousarray(self.step(Emitter(a), receivers)[0].T)

    def groups(self, receivers: Receivers) -> Groups:
        """The clumps of points that share shafts. The same for every emitter, so worth keeping between steps."""
        o = self.options
        return group_points(
            receivers.points, receivers.receiver, receivers.normals, receivers.polygons, o.clump, o.group, o.nested
        )

    def emitter_list(self, emitter: Emitter) -> tuple[Int32, NDArray[np.int8]]:
        """Nodes that can block light of an emitter, and what is known of each and the emitter's box [SC, Enhancements].

        Returns (n,) int32 nodes and (n,) int8: 1 the box overlaps the emitter's, 0 it does not, -1 unknown.
        """
        tree, o = self._kernel_tree, self.options
        box, plane = _emitter_box(emitter), self._emitter_plane(emitter)
        leaf = int(tree.leaf_of[emitter.polygon]) if emitter.polygon >= 0 else -1
        behind = o.behind_emitter and emitter.normal is not None
        # A shaft that begins before the emitter's surface can miss what overlaps the emitter's box.
        return _emitter_list(tree, box, plane, leaf, o.emitter_list, behind, -1 if o.tolerance else 1)

    def step(
        self, emitter: Emitter, receivers: Receivers, groups: Groups | None = None
    ) -> tuple[NDArray[np.bool_], Statistics]:
        """(P, S) bool: which samples of the emitter each receiver point sees, and what that took.

        False where the two don't face each other. groups: of `Visibility.groups`, made where it isn't given.
        """
        o = self.options
        self.blockers.check_points(emitter.points, "Emitter.points")
        self.blockers.check_points(receivers.points, "Receivers.points")
        count = len(receivers.points)
        visible = np.zeros((count, len(emitter.points)), np.bool_)
        if not visible.size:
            return visible, Statistics()
        if groups is None:
            groups = self.groups(receivers)
        tree = self._kernel_tree
        roots, flags = self.emitter_list(emitter)
        one_sided = receivers.normals is not None
        normals = np.zeros((1, 3)) if receivers.normals is None else _unit(receivers.normals)
        own = receivers.polygons if receivers.polygons is not None else np.full(count, -1, np.int32)
        settings = _Settings(
            STRATEGIES[o.strategy], float(o.ratio), o.open_enclosing, o.coplanar, o.mailbox, o.tolerance, o.coherency,
            o.object_boxes, ORDERS[o.order], -1.0 if o.least_cut is None else float(o.least_cut),
            o.no_shaft_below, o.keep_closed_below, self.blockers.slack, self.blockers.size,
        )  # fmt: skip
        lit = _Lit(
            np.ascontiguousarray(receivers.points), np.ascontiguousarray(normals), one_sided,
            np.ascontiguousarray(own, np.int32),
        )  # fmt: skip
        source = _Source(
            np.ascontiguousarray(emitter.points), _emitter_box(emitter), self._emitter_plane(emitter),
            emitter.normal is not None, emitter.polygon,
        )  # fmt: skip

        def some(part: slice) -> NDArray[np.int64]:
            counts = np.zeros(len(fields(Statistics)), np.int64)
            mark = np.zeros(len(tree.skip) if o.mailbox and o.strategy == "ratio open" else 0, np.int64)
            _step(
                tree, self._polygons, source, lit, groups, part.start, part.stop, roots, flags, settings, mark,
                visible, counts,
            )  # fmt: skip
            return counts

        threads = self.threads or len(os.sched_getaffinity(0))
        parts = groups.parts(1 if threads == 1 else 8 * threads)
        if threads == 1 or len(parts) == 1:
            counts = sum(map(some, parts))
        else:
            with ThreadPoolExecutor(threads) as pool:
                counts = sum(pool.map(some, parts))
        return visible, Statistics(*(int(c) for c in np.atleast_1d(counts)))

    def _emitter_plane(self, emitter: Emitter) -> Float64:
        """(4,): the height before the emitter, of the farthest back of its points."""
        if emitter.normal is None:
            return np.zeros(4)
        normal = _unit(np.asarray(emitter.normal, np.float64))
        return np.array([*normal, -np.min(emitter.points @ normal)])


def _emitter_box(emitter: Emitter) -> Float64:
    if emitter.box is not None:
        return np.ascontiguousarray(emitter.box, np.float64).reshape(6)
    return np.concatenate([emitter.points.min(axis=0), emitter.points.max(axis=0)])


def _unit(vectors: Float64) -> Float64:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


class _SearchTree(NamedTuple):
    """`Tree`, with the way up."""

    boxes: Float64
    skip: Int32
    first: Int32
    count: Int32
    order: Int32
    parent: Int32
    leaf_of: Int32

    @classmethod
    def of(cls, hierarchy: Hierarchy) -> _SearchTree:
        tree = Tree.of(hierarchy)
        return cls(*tree, *_upwards(tree))


class _Settings(NamedTuple):
    strategy: int
    ratio: float
    open_enclosing: bool
    coplanar: bool
    mailbox: bool
    tolerance: bool
    coherency: bool
    object_boxes: bool
    order: int
    least_cut: float
    no_shaft_below: int
    keep_closed_below: int
    slack: float
    size: float


class _Source(NamedTuple):
    """The emitter."""

    points: Float64
    box: Float64
    plane: Float64
    one_sided: bool
    polygon: int


class _Lit(NamedTuple):
    """The receivers."""

    points: Float64
    normals: Float64
    one_sided: bool
    own: Int32


@kernel
def _upwards(tree):  # type: ignore[no-untyped-def]
    parent = np.full(len(tree.skip), -1, np.int32)
    leaf_of = np.full(len(tree.order), -1, np.int32)
    for node in range(len(tree.skip)):
        child = node + 1
        while child < tree.skip[node]:
            parent[child] = node
            child = tree.skip[child]
        for i in range(tree.first[node], tree.first[node] + tree.count[node]):
            leaf_of[tree.order[i]] = node
    return parent, leaf_of


@kernel
def _highest(box, plane):  # type: ignore[no-untyped-def]
    """The largest height of a box's points over a plane (4,)."""
    height = plane[3]
    for k in range(3):
        height += plane[k] * (box[k + 3] if plane[k] > 0 else box[k])
    return height


@kernel
def _emitter_list(tree, box, plane, leaf, wanted, behind, touching):  # type: ignore[no-untyped-def]
    """See `Visibility.emitter_list`.

    leaf     : of the emitter's polygon, left out; -1 where it has none
    touching : the flag of what overlaps the emitter's box
    """
    size = len(tree.skip)
    found = np.empty(size, np.int32)
    flags = np.empty(size, np.int8)
    n = 0
    if not size:
        return found, flags
    if not wanted and not behind:
        found[0], flags[0] = 0, -1
        return found[:1], flags[:1]
    pending = np.empty(size, np.int32)
    # Walk up from the emitter; the siblings on the way are looked at. An emitter that is none of the objects, or that
    # has a larger box than its polygon, starts at the root.
    below = leaf
    node = tree.parent[leaf] if leaf >= 0 and wanted and encloses(tree.boxes[leaf], box) else -1
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
            if item == leaf or (behind and _highest(tree.boxes[item], plane) < 0):
                continue
            opened = tree.count[item] == 0 and encloses(tree.boxes[item], box)
            # Without the list's other use, behind alone prunes from the root: down to what is not all behind.
            if opened and wanted or (behind and tree.count[item] == 0 and _lowest(tree.boxes[item], plane) < 0):
                child = item + 1
                while child < tree.skip[item]:
                    pending[waiting] = child
                    waiting += 1
                    child = tree.skip[child]
            else:
                touches = overlaps(tree.boxes[item], box)
                found[n] = item
                flags[n] = -1 if encloses(tree.boxes[item], box) else (touching if touches else 0)
                n += 1
        if node < 0:
            break
        below, node = node, tree.parent[node]
    return found[:n].copy(), flags[:n].copy()


@kernel
def _lowest(box, plane):  # type: ignore[no-untyped-def]
    height = plane[3]
    for k in range(3):
        height += plane[k] * (box[k] if plane[k] > 0 else box[k + 3])
    return height


@kernel
def _box_hit(box, ax, ay, az, ix, iy, iz):  # type: ignore[no-untyped-def]
    """Whether a segment meets a box between its `ENDS`. i: inverse of the way from a to b, finite.

    Of two boxes, one in the other, it never hits the inner and misses the outer, as every step here keeps the order.
    """
    near, far = ENDS, 1 - ENDS
    t0, t1 = (box[0] - ax) * ix, (box[3] - ax) * ix
    near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    t0, t1 = (box[1] - ay) * iy, (box[4] - ay) * iy
    near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    t0, t1 = (box[2] - az) * iz, (box[5] - az) * iz
    near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
    return near <= far


@kernel
def _inverse(d):  # type: ignore[no-untyped-def]
    """1 / d, or so: never infinite, so that 0 times it is no NaN."""
    return 1 / d if abs(d) > 1e-300 else (1e300 if d >= 0 else -1e300)


@kernel
def _blocker(  # type: ignore[no-untyped-def]
    ax,
    ay,
    az,
    bx,
    by,
    bz,
    own_a,
    own_b,
    nodes,
    objects,
    begin,
    end,
    tree,
    polygons,
    boxed,
    mark,
    number,
    object_boxes,
):
    """The first polygon found between a and b in a list, -1 for none; its place there, and tests of boxes and objects.

    boxed : the list holds boxes, or those of objects are tested
    """
    ix = iy = iz = 0.0
    if boxed:
        ix, iy, iz = _inverse(bx - ax), _inverse(by - ay), _inverse(bz - az)
    box_tests, object_tests = 0, 0
    forms, bounds, flags = polygons.forms, polygons.bounds, polygons.flags
    for i in range(begin, end):
        x = objects[i]
        if x >= 0:
            if x == own_a or x == own_b:
                continue
            if object_boxes:
                box_tests += 1
                if not _box_hit(tree.boxes[nodes[i]], ax, ay, az, ix, iy, iz):
                    continue
            object_tests += 1
            if hits(x, ax, ay, az, bx, by, bz, forms, bounds, flags):
                return x, i, box_tests, object_tests
            continue
        node = nodes[i]
        last = tree.skip[node]
        while node < last:
            if len(mark) and mark[node] == number:
                node = tree.skip[node]
                continue
            leaf = tree.count[node] > 0
            if not leaf or object_boxes:
                box_tests += 1
                if not _box_hit(tree.boxes[node], ax, ay, az, ix, iy, iz):
                    node = tree.skip[node]
                    continue
            if leaf:
                for k in range(tree.first[node], tree.first[node] + tree.count[node]):
                    x = tree.order[k]
                    if x != own_a and x != own_b:
                        object_tests += 1
                        if hits(x, ax, ay, az, bx, by, bz, forms, bounds, flags):
                            return x, i, box_tests, object_tests
            node += 1
    return -1, -1, box_tests, object_tests


@kernel
def _faces(ax, ay, az, na, one_sided_a, bx, by, bz, nb, one_sided_b):  # type: ignore[no-untyped-def]
    dx, dy, dz = bx - ax, by - ay, bz - az
    if one_sided_a and not dx * na[0] + dy * na[1] + dz * na[2] > 0:
        return False
    return not one_sided_b or dx * nb[0] + dy * nb[1] + dz * nb[2] < 0


@kernel
def _objects_of(  # type: ignore[no-untyped-def]
    tree, polygons, a, b, coplanar, object_boxes, size, own_a, own_b, nodes, flags, begin, end, objects
):
    """Look at the candidates that are single polygons: leave out those that can't block, note which they are.

    Returns the new end, and whether boxes are left.
    """
    n = begin
    boxed = object_boxes
    for i in range(begin, end):
        node = nodes[i]
        x = -1
        if tree.count[node] == 1:
            x = tree.order[tree.first[node]]
            if x == own_a or x == own_b:
                continue
            if coplanar and never_hit(x, a, b, polygons.forms, polygons.flags, polygons.length, size):
                continue
        else:
            boxed = True
        nodes[n], flags[n], objects[n] = node, flags[i], x
        n += 1
    return n, boxed


@kernel
def _largest_first(tree, extent, nodes, flags, objects, begin, end):  # type: ignore[no-untyped-def]
    """Sort a list by the surface of the part of each box that lies in the extent box."""
    n = end - begin
    keys = np.empty(n)
    for i in range(n):
        box = tree.boxes[nodes[begin + i]]
        x = min(box[3], extent[3]) - max(box[0], extent[0])
        y = min(box[4], extent[4]) - max(box[1], extent[1])
        z = min(box[5], extent[5]) - max(box[2], extent[2])
        keys[i] = -(x * y + y * z + z * x)
    by = np.argsort(keys, kind="mergesort")
    old_nodes, old_flags, old_objects = nodes[begin:end].copy(), flags[begin:end].copy(), objects[begin:end].copy()
    for i in range(n):
        nodes[begin + i], flags[begin + i], objects[begin + i] = (
            old_nodes[by[i]],
            old_flags[by[i]],
            old_objects[by[i]],
        )


@kernel
def _build(  # type: ignore[no-untyped-def]
    tree, polygons, source, box, own, rays, settings, nodes, flags, objects, begin, end, planes, near, extent, a, b,
    mark, number, stack, counts,
):  # fmt: skip
    """Form the shaft between the emitter and a box of points, and append its candidates after `end` of the lists.

    begin, end : the parent's candidates, which can be the emitter list
    Returns where the candidates end, and whether there are boxes among them.
    """
    share = ENDS if settings.tolerance else 0.0
    for k in range(6):
        # The points a share along the segments, from all of one box to all of the other.
        a[k] = source.box[k] + share * (box[k] - source.box[k])
        b[k] = box[k] + share * (source.box[k] - box[k])
    strategy = settings.strategy
    if rays < settings.keep_closed_below:
        strategy = 0
    n = form_shaft(a, b, settings.slack, settings.least_cut, planes, near, extent)
    counts[_SHAFTS] += 1
    size, tests = gather(
        tree, nodes, flags, begin, end, a, b, extent, planes, near, n, strategy, settings.ratio,
        settings.open_enclosing, mark, number, stack, nodes, flags, end,
    )  # fmt: skip
    counts[_SHAFT_TESTS] += tests
    size, boxed = _objects_of(
        tree, polygons, a, b, settings.coplanar, settings.object_boxes, settings.size, source.polygon, own, nodes,
        flags, end, size, objects,
    )  # fmt: skip
    if size == end:
        counts[_EMPTY] += 1
    return size, boxed


@kernel
def _step(  # type: ignore[no-untyped-def]
    tree, polygons, source, lit, groups, first, last, roots, root_flags, settings, mark, visible, counts
):
    """The groups from `first` to `last`, which is no group's child. Fills `visible`, adds to `counts`."""
    size = len(tree.skip)
    room = (groups.levels + 2) * size + 1
    nodes = np.empty(room, np.int32)
    flags = np.empty(room, np.int8)
    objects = np.empty(room, np.int32)
    nodes[: len(roots)] = roots
    flags[: len(roots)] = root_flags
    a, b = np.empty(6), np.empty(6)
    top, rooted = _objects_of(  # without a shaft these are all the candidates there are
        tree, polygons, a, b, False, settings.object_boxes, settings.size, source.polygon, -1, nodes, flags, 0,
        len(roots), objects,
    )  # fmt: skip
    planes, near, extent = empty_shaft()
    stack = empty_stack(size)
    # Of the groups around the current one: where they end, and their lists. The emitter list is that of all.
    ends = np.empty(groups.levels + 2, np.int64)
    list_begin = np.zeros(groups.levels + 2, np.int64)
    list_end = np.zeros(groups.levels + 2, np.int64)
    boxed = np.zeros(groups.levels + 2, np.bool_)
    numbers = np.full(groups.levels + 2, -1, np.int64)  # of the shafts, which marks in the hierarchy speak of
    ends[0], list_end[0], boxed[0] = last, top, rooted
    level = 0
    number = 0
    blocker = -1
    samples = len(source.points)
    tiny = -1e-12 * settings.size

    group = first
    while group < last:
        while group >= ends[level]:
            level -= 1
        begin, end = groups.begin[group], groups.end[group]
        box = groups.boxes[group]
        own = groups.polygon[group]
        rays = (end - begin) * samples
        # Facing tests first: of all at once where they are on one plane.
        away = source.one_sided and _highest(box, source.plane) < tiny
        if not away and lit.one_sided:
            height = 0.0
            for j in range(3):
                n = groups.normal[group, j]
                height += n * ((source.box[j + 3] if n > 0 else source.box[j]) - (box[j] if n > 0 else box[j + 3]))
            away = height < tiny
        if away:
            group = groups.skip[group]
            continue
        shaft = settings.strategy >= 0 and rays >= settings.no_shaft_below
        leaf = groups.skip[group] == group + 1
        from_begin, from_end, is_boxed = list_begin[level], list_end[level], boxed[level]
        if not leaf and shaft:
            number += 1
            to_end, is_boxed = _build(
                tree, polygons, source, box, own, rays, settings, nodes, flags, objects, from_begin, from_end,
                planes, near, extent, a, b, mark, number, stack, counts,
            )  # fmt: skip
            level += 1
            ends[level], list_begin[level], list_end[level] = groups.skip[group], from_end, to_end
            boxed[level], numbers[level] = is_boxed, number
            if to_end > from_end:
                group += 1
                continue
            # Nothing is in the way of any of its parts.
            from_begin, from_end, shaft = from_end, to_end, False
        elif not leaf:
            group += 1
            continue
        built = not shaft
        of_list = numbers[level]
        for i in range(begin, end):
            p = groups.order[i]
            bx, by, bz = lit.points[p, 0], lit.points[p, 1], lit.points[p, 2]
            nb = lit.normals[p if lit.one_sided else 0]
            own_b = lit.own[p]
            for s in range(samples):
                ax, ay, az = source.points[s, 0], source.points[s, 1], source.points[s, 2]
                if not _faces(ax, ay, az, source.plane, source.one_sided, bx, by, bz, nb, lit.one_sided):
                    continue
                counts[_RAYS] += 1
                if built and from_begin == from_end:
                    counts[_FREE] += 1
                    visible[p, s] = True
                    continue
                if settings.coherency and blocker >= 0 and blocker != own_b:
                    counts[_OBJECT_TESTS] += 1
                    if hits(blocker, ax, ay, az, bx, by, bz, polygons.forms, polygons.bounds, polygons.flags):
                        counts[_CACHED] += 1
                        counts[_BLOCKED] += 1
                        continue
                if not built:
                    built = True
                    number += 1
                    of_list = number
                    to_end, is_boxed = _build(
                        tree, polygons, source, box, own, rays, settings, nodes, flags, objects, from_begin, from_end,
                        planes, near, extent, a, b, mark, number, stack, counts,
                    )  # fmt: skip
                    from_begin, from_end = from_end, to_end
                    if from_begin == from_end:
                        counts[_FREE] += 1
                        visible[p, s] = True
                        continue
                    if settings.order == _LARGEST_FIRST:
                        _largest_first(tree, extent, nodes, flags, objects, from_begin, from_end)
                    counts[_LISTS] += 1
                    counts[_CANDIDATES] += from_end - from_begin
                found, at, box_tests, object_tests = _blocker(
                    ax, ay, az, bx, by, bz, source.polygon, own_b, nodes, objects, from_begin, from_end, tree,
                    polygons, is_boxed, mark, of_list, settings.object_boxes,
                )  # fmt: skip
                counts[_BOX_TESTS] += box_tests
                counts[_OBJECT_TESTS] += object_tests
                if found < 0:
                    visible[p, s] = True
                    continue
                counts[_BLOCKED] += 1
                blocker = found
                if settings.order == _LAST_BLOCKER_FIRST and at > from_begin:
                    node, flag, x = nodes[at], flags[at], objects[at]
                    for k in range(at, from_begin, -1):
                        nodes[k], flags[k], objects[k] = nodes[k - 1], flags[k - 1], objects[k - 1]
                    nodes[from_begin], flags[from_begin], objects[from_begin] = node, flag, x
        group = groups.skip[group]
