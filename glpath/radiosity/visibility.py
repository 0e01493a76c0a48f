"""Visibility between the samples of an emitter and the points of receivers, by shafts [SC].

    visibility = Visibility(Blockers.of_scene(scene))
    visibility.visible(points_a, points_b)                  # (A, B) bool, between two sets of points
    visibility.step(emitter, receivers)                     # one emitter against all receivers, with statistics

A shaft is built between the emitter and a clump of receiver points; segments between the two are tested against its
candidate list alone, and where that is empty no segment is tested at all. All options lead to exactly the same
answer, that of testing every segment against every polygon; `glpath.bench.shaft.option_rows` measures what they
cost.

Cost:     groups of receivers are shared between threads; measured by `glpath.bench.shaft`.
Poor at:  few rays per shaft; a volume full of tiny polygons, where every shaft has a long list.
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
from glpath.kernels import inner_kernel, kernel
from glpath.radiosity.blockers import ENDS, PARALLELOGRAM, SLIVER, SOLID, Blockers, crosses, height, hits, never_hit
from glpath.radiosity.clusters import cluster
from glpath.radiosity.points import SEVERAL, Groups, group_points
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
_KEEP_CLOSED, _ALWAYS_OPEN, _RATIO_OPEN = (
    int(s) for s in (Strategy.KEEP_CLOSED, Strategy.ALWAYS_OPEN, Strategy.RATIO_OPEN)
)


@dataclass(frozen=True)
class Options:
    """How candidates are found; none of it changes what is visible. The defaults are quick for the office scenes.

    strategy          : what becomes of boxes that are not outside a shaft, see `Strategy`; "no shaft" is the
                        baseline, a ray caster through the hierarchy
    ratio             : of "ratio open", 0 to 1: the share of children above which a box stays closed
    open_enclosing    : open boxes that enclose a reference box, as every ray would hit them
    emitter_list      : start at what the emitter does not lie in, found once per step
    behind_emitter    : leave out what lies behind a one-sided emitter, once per step
    solids            : leave out polygons of closed surfaces that face away from the emitter. Only where no emitter
                        sample lies inside of another solid: back faces do not block then
    coplanar          : leave out polygons whose plane has the emitter and the receiver on one side
    mailbox           : "ratio open" marks the children that are outside below a box that stays closed
    tolerance         : shafts begin and end where segments can be blocked, not at the surfaces, so that neighbours
                        of the receiver stay out
    coherency         : test the last ray's blocker first, and build the shaft when it misses
    together          : test all rays of a clump against one candidate after the other; False: one ray after the
                        other, each until it is blocked, as in the paper
    object_boxes      : test a polygon's box before the polygon, as in the paper; of rays that are tested one by one
    clump             : most points of a receiver that share a shaft; 0 for all of them
    group             : most points of several receivers that share a shaft, for whose parts further shafts are
                        made; 0 for none
    nested            : a clump's shaft starts from the candidate list of its receiver's or group's
    order             : of the candidate list: as found, the largest first, or the last blocker moved to the front
    least_cut         : planes sorted by the volume they cut off the extent box, those below this share of it left
                        out; None for all planes unsorted
    longest           : number of candidates beyond which "always open" gives way to "ratio open"; 0: no limit
    no_shaft_below    : number of rays below which no shaft is built
    keep_closed_below : number of rays below which the strategy is "keep closed"
    """

    strategy: StrategyName = "always open"
    ratio: float = 0.4
    open_enclosing: bool = True
    emitter_list: bool = True
    behind_emitter: bool = True
    solids: bool = False
    coplanar: bool = True
    mailbox: bool = True
    tolerance: bool = True
    coherency: bool = True
    together: bool = True
    object_boxes: bool = False
    clump: int = 32
    group: int = 512
    nested: bool = True
    order: OrderName = "found"
    least_cut: float | None = None
    longest: int = 1500
    no_shaft_below: int = 0
    keep_closed_below: int = 0

    def __post_init__(self) -> None:
        for name, allowed in (("strategy", STRATEGIES), ("order", ORDERS)):
            if getattr(self, name) not in allowed:
                raise UsageError(f"Options.{name} is {getattr(self, name)!r}; allowed are {', '.join(allowed)}.")
        for name in ("clump", "group", "longest", "no_shaft_below", "keep_closed_below"):
            if getattr(self, name) < 0:
                raise UsageError(f"Options.{name} is {getattr(self, name)}; allowed are whole numbers from 0.")
        if not 0 <= self.ratio <= 1:
            raise UsageError(f"Options.ratio is {self.ratio}; allowed are 0 to 1.")


#: The paper's own: one shaft per receiver, one ray after the other, nothing of what it leaves to the future.
PAPER = Options(
    strategy="ratio open",
    together=False,
    object_boxes=True,
    coplanar=False,
    tolerance=False,
    clump=0,
    group=0,
    nested=False,
    longest=0,
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

    @classmethod
    def on(cls, blockers: Blockers, polygon: int, side: int = 4, whole: bool = False) -> Emitter:
        """The front of a polygon, with side x side samples in the middles of cells; a triangle has half of them.

        whole : shafts are made for all of the polygon, as in the paper, and not only for where the samples lie
        """
        middles = (np.arange(side) + 0.5) / side
        points = _on_polygons(blockers, np.array([polygon]), middles, middles)[0]
        a, b, c = blockers.corners[polygon]
        outline = np.stack([a, b, c, b + c - a] if blockers.parallelogram[polygon] else [a, b, c])
        box = np.concatenate([outline.min(axis=0), outline.max(axis=0)])
        return cls(points, blockers.normals[polygon], polygon, box if whole else None)


@dataclass(frozen=True)
class Receivers:
    """Points that light comes to, receiver after receiver.

    points   : (P, 3) float64
    receiver : (P,) int32, the receiver of each point, in ascending order
    normals  : (P, 3) of one-sided receivers, which are lit from their front only; None for all sides
    polygons : (P,) int32, the blocker that each point lies on, which does not block it; -1 for none; None: none at
               all
    """

    points: Float64
    receiver: Int32
    normals: Float64 | None = None
    polygons: Int32 | None = None

    @classmethod
    def on(cls, blockers: Blockers, spacing: float) -> Receivers:
        """The front of every polygon, with the vertices of a grid at most `spacing` apart, corners included."""
        edges = np.linalg.norm(blockers.corners[:, 1:] - blockers.corners[:, :1], axis=2)
        cells = np.maximum(np.ceil(edges / spacing - 1e-9), 1).astype(int)
        kinds, kind = np.unique(np.column_stack([cells, blockers.parallelogram]), axis=0, return_inverse=True)
        points, number = [], []
        for i, (n, m, _) in enumerate(kinds):
            which = np.flatnonzero(kind.ravel() == i)
            grid = _on_polygons(blockers, which, np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1))
            points.append(grid.reshape(-1, 3))
            number.append(np.repeat(which, grid.shape[1]))
        numbers = np.concatenate([np.zeros(0, int), *number])
        order = np.argsort(numbers, kind="stable")
        numbers = numbers[order].astype(np.int32)
        return cls(np.concatenate([np.zeros((0, 3)), *points])[order], numbers, blockers.normals[numbers], numbers)


def _on_polygons(blockers: Blockers, which: NDArray[np.int64], u: Float64, v: Float64) -> Float64:
    """(n, points, 3): the points u, v of n polygons of one kind, triangles or parallelograms."""
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    if not blockers.parallelogram[which[0]]:
        uv = uv[uv.sum(axis=1) <= 1 + 1e-12]
    corner = blockers.corners[which, :1]
    edges = blockers.corners[which, 1:] - corner
    return np.asarray(corner + np.einsum("pk,nkj->npj", uv, edges))


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

    def prepare(self, receivers: Receivers) -> Prepared:
        """Receivers in clumps that share shafts. The same for every emitter, so worth keeping between steps."""
        self.blockers.check_points(receivers.points, "Receivers.points")
        o = self.options
        groups = group_points(
            receivers.points, receivers.receiver, receivers.normals, receivers.polygons, o.clump, o.group, o.nested
        )
        return Prepared(groups, _lit(receivers, groups.order))

    def emitter_list(self, emitter: Emitter) -> tuple[Int32, NDArray[np.int8]]:
        """Nodes that can block light of an emitter, and what is known of their boxes [SC, Enhancements].

        Returns (n,) int32 nodes and (n,) int8: 1 the box overlaps the emitter's, 0 it does not, -1 unknown.
        """
        tree, o = self._kernel_tree, self.options
        box, plane = _emitter_box(emitter), _emitter_plane(emitter)
        leaf = int(tree.leaf_of[emitter.polygon]) if emitter.polygon >= 0 else -1
        behind = o.behind_emitter and emitter.normal is not None
        # A shaft that begins before the emitter's surface can miss what overlaps the emitter's box.
        nodes, known = _emitter_list(tree, box, plane, leaf, o.emitter_list, behind, -1 if o.tolerance else 1)
        return nodes, known

    def step(self, emitter: Emitter, receivers: Receivers | Prepared) -> tuple[NDArray[np.bool_], Statistics]:
        """(P, S) bool: which samples of the emitter each receiver point sees, and what that took.

        False where the two don't face each other. receivers: of `prepare`, where there is more than one step.
        """
        o = self.options
        self.blockers.check_points(emitter.points, "Emitter.points")
        count = len(receivers.groups.order) if isinstance(receivers, Prepared) else len(receivers.points)
        visible = np.zeros((count, len(emitter.points)), np.bool_)
        if not visible.size:
            return visible, Statistics()
        groups, lit = receivers if isinstance(receivers, Prepared) else self.prepare(receivers)
        tree = self._kernel_tree
        roots, flags = self.emitter_list(emitter)
        settings = _Settings(
            STRATEGIES[o.strategy], float(o.ratio), o.open_enclosing, o.coplanar, o.tolerance, o.coherency,
            o.together, o.object_boxes, ORDERS[o.order], -1.0 if o.least_cut is None else float(o.least_cut),
            o.longest or len(tree.skip), o.no_shaft_below, o.keep_closed_below,
            self.blockers.slack, self.blockers.size,
        )  # fmt: skip
        source = _source(emitter)

        def some(part: slice) -> NDArray[np.int64]:
            counts = np.zeros(len(fields(Statistics)), np.int64)
            mark = np.zeros(
                len(tree.skip) if o.mailbox and o.strategy in ("ratio open", "always open") else 0, np.int64
            )
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


def visible(
    blockers: Blockers, points_a: ArrayLike, points_b: ArrayLike, options: Options | None = None
) -> NDArray[np.bool_]:
    """(A, B) bool: `Visibility.visible`, for once. For more than that make a `Visibility`, which keeps its tree."""
    return Visibility(blockers, options or Options()).visible(points_a, points_b)


def facing(emitter: Emitter, receivers: Receivers) -> NDArray[np.bool_]:
    """(P, S) bool: which receiver points and emitter samples lie before each other."""
    order = np.arange(len(receivers.points))
    faces = np.zeros((len(order), len(emitter.points)), np.bool_)
    _facing(_source(emitter), _lit(receivers, order), order, faces)
    return faces


def _source(emitter: Emitter) -> _Source:
    points = np.ascontiguousarray(emitter.points, np.float64)
    return _Source(
        points, _emitter_box(emitter), _emitter_plane(emitter), emitter.normal is not None, emitter.polygon
    )


def _lit(receivers: Receivers, order: NDArray[np.int64]) -> _Lit:
    points = np.asarray(receivers.points, np.float64)[order]
    one_sided = receivers.normals is not None
    normals = np.zeros((0, 3)) if receivers.normals is None else _unit(receivers.normals)[order]
    heights = (normals * points).sum(axis=1) if one_sided else np.zeros(0)
    own = np.full(len(order), -1, np.int32) if receivers.polygons is None else receivers.polygons[order]
    x, y, z = np.ascontiguousarray(points.T)
    return _Lit(x, y, z, normals, heights, one_sided, np.ascontiguousarray(own, np.int64))


def _emitter_plane(emitter: Emitter) -> Float64:
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
    items: Int32
    order: Int32
    parent: Int32
    leaf_of: Int32

    @classmethod
    def of(cls, hierarchy: Hierarchy) -> _SearchTree:
        tree = Tree.of(hierarchy)
        return cls(*tree, *_upwards(tree))


class _Settings(NamedTuple):
    """`Options` for the kernels."""

    strategy: int
    ratio: float
    open_enclosing: bool
    coplanar: bool
    tolerance: bool
    coherency: bool
    together: bool
    object_boxes: bool
    order: int
    least_cut: float
    longest: int
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
    """The receivers' points in the order of the groups: x, y, z, normals, normal . point and their polygons."""

    x: Float64
    y: Float64
    z: Float64
    normals: Float64
    heights: Float64
    one_sided: bool
    own: NDArray[np.int64]


class Prepared(NamedTuple):
    """Receivers as `Visibility.step` needs them."""

    groups: Groups
    lit: _Lit


class _Work(NamedTuple):
    """Room that a thread works in.

    nodes, flags, objects : lists of candidates one behind the other, those of the groups around before a group's
                            own: nodes of the tree, what is known of each (see `place_box`), the polygon of a leaf
                            or -1
    planes .. extent      : the latest shaft
    a, b                  : its reference boxes
    stack                 : of `gather`
    mark                  : (M,) nodes that are outside a shaft, by its number; empty where they aren't marked
    latest                : (2,) the latest shaft's number, and the latest blocker or -1
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


_NUMBER, _BLOCKER = 0, 1


class _List(NamedTuple):
    """Candidates in `_Work`: their range, whether boxes are tested, and the number of the shaft (-1: of none)."""

    begin: int
    end: int
    boxed: bool
    number: int


@kernel
def _upwards(tree):  # type: ignore[no-untyped-def]
    parent = np.full(len(tree.skip), -1, np.int32)
    leaf_of = np.full(len(tree.order), -1, np.int32)
    for node in range(len(tree.skip)):
        child = node + 1
        while child < tree.skip[node]:
            parent[child] = node
            child = tree.skip[child]
        for i in range(tree.first[node], tree.first[node] + tree.items[node]):
            leaf_of[tree.order[i]] = node
    return parent, leaf_of


@inner_kernel
def _highest(boxes, i, plane):  # type: ignore[no-untyped-def]
    """The largest height of boxes[i] over a plane (4,)."""
    most = plane[3]
    for k in range(3):
        most += plane[k] * boxes[i, k + 3 if plane[k] > 0 else k]
    return most


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
    pending = np.empty(size, np.int32)
    # Walk up from the emitter; the siblings on the way are looked at. An emitter that is none of the objects, or
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
            if item == leaf or (behind and _highest(tree.boxes, item, plane) < 0):
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
    return found[:n].copy(), flags[:n].copy()


@inner_kernel
def _box_hit(boxes, i, ax, ay, az, ix, iy, iz):  # type: ignore[no-untyped-def]
    """Whether a segment meets boxes[i] between its `ENDS`. ix, iy, iz: inverse of the way from a to b, finite.

    Of two boxes, one in the other, it never hits the inner and misses the outer, as every step here keeps the
    order.
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
    """1 / d, or so: never infinite, so that 0 times it is no NaN."""
    return 1 / d if abs(d) > 1e-300 else (1e300 if d >= 0 else -1e300)


@inner_kernel
def _blocker(ax, ay, az, bx, by, bz, own_a, own_b, found, tree, polygons, object_boxes, work):  # type: ignore[no-untyped-def]
    """The first polygon of a list between a and b, or -1; its place there; tests of boxes and of objects."""
    ix = iy = iz = 0.0
    if found.boxed:
        ix, iy, iz = _inverse(bx - ax), _inverse(by - ay), _inverse(bz - az)
    box_tests, object_tests = 0, 0
    forms, bounds, flags = polygons.forms, polygons.bounds, polygons.flags
    boxes, skip, items, first, order = tree.boxes, tree.skip, tree.items, tree.first, tree.order
    nodes, objects, mark, number = work.nodes, work.objects, work.mark, found.number
    for i in range(found.begin, found.end):
        x = np.int64(objects[i])  # one type everywhere, so that functions are compiled once
        if x >= 0:
            if (x == own_a) | (x == own_b):
                continue
            if object_boxes:
                box_tests += 1
                if not _box_hit(boxes, nodes[i], ax, ay, az, ix, iy, iz):
                    continue
            object_tests += 1
            if hits(x, ax, ay, az, bx, by, bz, forms, bounds, flags):
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
                        if hits(x, ax, ay, az, bx, by, bz, forms, bounds, flags):
                            return x, i, box_tests, object_tests
            node += 1
    return -1, -1, box_tests, object_tests


@inner_kernel
def _objects_of(tree, polygons, coplanar, object_boxes, size, own_a, own_b, begin, end, work):  # type: ignore[no-untyped-def]
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


@kernel
def _largest_first(tree, begin, end, work):  # type: ignore[no-untyped-def]
    """Sort a list by the surface of the part of each box that lies in the shaft's extent box."""
    n = end - begin
    keys = np.empty(n)
    extent = work.extent
    for i in range(n):
        box = tree.boxes[work.nodes[begin + i]]
        x = min(box[3], extent[3]) - max(box[0], extent[0])
        y = min(box[4], extent[4]) - max(box[1], extent[1])
        z = min(box[5], extent[5]) - max(box[2], extent[2])
        keys[i] = -(x * y + y * z + z * x)
    by = np.argsort(keys, kind="mergesort")
    nodes, flags, objects = (
        work.nodes[begin:end].copy(),
        work.flags[begin:end].copy(),
        work.objects[begin:end].copy(),
    )
    for i in range(n):
        work.nodes[begin + i] = nodes[by[i]]
        work.flags[begin + i] = flags[by[i]]
        work.objects[begin + i] = objects[by[i]]


@kernel
def _shaft_list(tree, polygons, source, groups, group, parent, settings, leaf, work, counts):  # type: ignore[no-untyped-def]
    """Form the shaft between the emitter and a group; the `_List` of its candidates, behind the parent's."""
    share = ENDS if settings.tolerance else 0.0
    for k in range(6):
        # The points that lie this share along the segments from all of one box to all of the other.
        emitter, receiver = source.box[k], groups.boxes[group, k]
        work.a[k] = emitter + share * (receiver - emitter)
        work.b[k] = receiver + share * (emitter - receiver)
    work.latest[_NUMBER] += 1
    number = work.latest[_NUMBER]
    strategy = settings.strategy
    if _rays(source, groups, group) < settings.keep_closed_below:
        strategy = _KEEP_CLOSED
    n = form_shaft(
        work.a, work.b, settings.slack, settings.least_cut, work.planes, work.near, work.extent
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
    end, boxed = _objects_of(
        tree, polygons, settings.coplanar, settings.object_boxes, settings.size, source.polygon,
        groups.polygon[group], parent.end, size, work,
    )  # fmt: skip
    if leaf and settings.order == _LARGEST_FIRST:
        _largest_first(tree, parent.end, end, work)
    counts[_SHAFTS] += 1
    counts[_SHAFT_TESTS] += tests
    if end == parent.end:
        counts[_EMPTY] += 1
    elif leaf:
        counts[_LISTS] += 1
        counts[_CANDIDATES] += end - parent.end
    return _List(parent.end, end, boxed, number)


@inner_kernel
def _rays(source, groups, group):  # type: ignore[no-untyped-def]
    return (groups.end[group] - groups.begin[group]) * len(source.points)


@inner_kernel
def _before_emitter(lit, k, source):  # type: ignore[no-untyped-def]
    """Receiver point k lies where the emitter shines."""
    p = source.plane
    return not source.one_sided or p[0] * lit.x[k] + p[1] * lit.y[k] + p[2] * lit.z[k] + p[3] > 0


@inner_kernel
def _before_receiver(lit, k, source, s):  # type: ignore[no-untyped-def]
    """Sample s lies before receiver point k."""
    if not lit.one_sided:
        return True
    n, a = lit.normals, source.points
    return n[k, 0] * a[s, 0] + n[k, 1] * a[s, 1] + n[k, 2] * a[s, 2] > lit.heights[k]


@kernel
def _cast_one_by_one(  # type: ignore[no-untyped-def]
    tree, polygons, source, lit, groups, group, found, built, settings, work, counts, visible
):
    """The rays of a group as in the paper: the last blocker, then the shaft's list until something is hit.

    found, built : the candidates, if the shaft is built; else the parent's, from which it will be
    """
    samples = len(source.points)
    for k in range(groups.begin[group], groups.end[group]):
        if not _before_emitter(lit, k, source):
            continue
        p = groups.order[k]
        bx, by, bz, own_b = lit.x[k], lit.y[k], lit.z[k], lit.own[k]
        for s in range(samples):
            ax, ay, az = source.points[s, 0], source.points[s, 1], source.points[s, 2]
            if not _before_receiver(lit, k, source, s):
                continue
            counts[_RAYS] += 1
            if not built or found.begin < found.end:
                last = work.latest[_BLOCKER]
                if settings.coherency and last >= 0 and last != own_b:
                    counts[_OBJECT_TESTS] += 1
                    if hits(last, ax, ay, az, bx, by, bz, polygons.forms, polygons.bounds, polygons.flags):
                        counts[_CACHED] += 1
                        counts[_BLOCKED] += 1
                        continue
                if not built:
                    built = True
                    found = _shaft_list(
                        tree, polygons, source, groups, group, found, settings, True, work, counts
                    )  # fmt: skip
            if found.begin == found.end:
                counts[_FREE] += 1
                visible[p, s] = True
                continue
            x, at, box_tests, object_tests = _blocker(
                ax, ay, az, bx, by, bz, source.polygon, own_b, found, tree, polygons, settings.object_boxes, work
            )
            counts[_BOX_TESTS] += box_tests
            counts[_OBJECT_TESTS] += object_tests
            if x < 0:
                visible[p, s] = True
                continue
            counts[_BLOCKED] += 1
            work.latest[_BLOCKER] = x
            if settings.order == _LAST_BLOCKER_FIRST:
                _to_front(at, found.begin, work)


@inner_kernel
def _to_front(at, begin, work):  # type: ignore[no-untyped-def]
    node, flag, x = work.nodes[at], work.flags[at], work.objects[at]
    for k in range(at, begin, -1):
        work.nodes[k], work.flags[k], work.objects[k] = work.nodes[k - 1], work.flags[k - 1], work.objects[k - 1]
    work.nodes[begin], work.flags[begin], work.objects[begin] = node, flag, x


@kernel
def _cast_together(  # type: ignore[no-untyped-def]
    tree, polygons, source, lit, groups, group, found, built, settings, work, counts, visible
):
    """All rays of a group against one candidate after the other, so that the processor tests several at once."""
    samples, begin = len(source.points), groups.begin[group]
    count = groups.end[group] - begin
    own = groups.polygon[group]
    clear = np.empty((samples, count), np.uint8)
    at_a, at_b = np.empty((3, samples)), np.empty((3, count))
    left = _start(source, lit, groups.normal, group, begin, count, clear)
    if left == 0:
        return
    rays = left
    counts[_RAYS] += rays
    last = work.latest[_BLOCKER]
    if settings.coherency and last >= 0 and last != own and not (built and found.begin == found.end):
        counts[_OBJECT_TESTS] += left
        left = _block(last, polygons, source, lit, begin, count, own, clear, at_a, at_b, left)
        counts[_CACHED] += rays - left
    if left and not built:
        found = _shaft_list(tree, polygons, source, groups, group, found, settings, True, work, counts)
    if found.begin == found.end:
        counts[_FREE] += left
    boxes = False
    most = 0
    for i in range(found.begin, found.end):
        if left == 0:
            break
        x = np.int64(work.objects[i])
        if x < 0:
            boxes = True
        elif x != own:
            counts[_OBJECT_TESTS] += left
            before = left
            left = _block(x, polygons, source, lit, begin, count, own, clear, at_a, at_b, left)
            if before - left > most:
                most = before - left
                work.latest[_BLOCKER] = x
    if left and boxes:
        for k in range(count):
            for s in range(samples):
                if clear[s, k]:
                    x, _, box_tests, object_tests = _blocker(
                        source.points[s, 0], source.points[s, 1], source.points[s, 2], lit.x[begin + k],
                        lit.y[begin + k], lit.z[begin + k], source.polygon, lit.own[begin + k], found, tree,
                        polygons, False, work,
                    )  # fmt: skip
                    counts[_BOX_TESTS] += box_tests
                    counts[_OBJECT_TESTS] += object_tests
                    if x >= 0:
                        clear[s, k] = 0
                        left -= 1
    counts[_BLOCKED] += rays - left
    if left:  # it was all False before
        order = groups.order
        for k in range(count):
            p = order[begin + k]
            for s in range(samples):
                visible[p, s] = clear[s, k]


@kernel
def _start(source, lit, common, group, begin, count, clear):  # type: ignore[no-untyped-def]
    """Which rays are cast: 1 in `clear` where both ends face each other. Returns how many."""
    samples = len(source.points)
    n, a, heights = lit.normals, source.points, lit.heights
    before = np.empty(count, np.uint8)
    left = 0
    for k in range(count):
        before[k] = _before_emitter(lit, begin + k, source)
        left += before[k]
    if left == 0:
        return 0
    flat = lit.one_sided and (common[group, 0] != 0 or common[group, 1] != 0 or common[group, 2] != 0)
    left = 0
    for s in range(samples):
        if not lit.one_sided:
            for k in range(count):
                clear[s, k] = before[k]
        elif flat:  # as `_before_receiver`, with one normal
            reach = n[begin, 0] * a[s, 0] + n[begin, 1] * a[s, 1] + n[begin, 2] * a[s, 2]
            for k in range(count):
                clear[s, k] = before[k] & (reach > heights[begin + k])
        else:
            for k in range(count):
                clear[s, k] = before[k] and _before_receiver(lit, begin + k, source, s)
        for k in range(count):
            left += clear[s, k]
    return left


@inner_kernel
def _block(x, polygons, source, lit, begin, count, own, clear, at_a, at_b, left):  # type: ignore[no-untyped-def]
    """Take the rays that polygon x blocks out of `clear`; return how many are left of them."""
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
    # Nothing to do where no segment can cross the plane, or only from the back of a solid.
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
                b = begin + k
                if clear[s, k] and own_b[b] != x and hits(
                    x, a[s, 0], a[s, 1], a[s, 2], bx[b], by[b], bz[b], forms, polygons.bounds, polygons.flags
                ):  # fmt: skip
                    clear[s, k] = 0
    elif flag & PARALLELOGRAM:
        _cross_all(at_a, at_b, True, flag & SOLID != 0, samples, count, clear)
    else:
        _cross_all(at_a, at_b, False, flag & SOLID != 0, samples, count, clear)
    left = 0
    for s in range(samples):
        for k in range(count):
            left += clear[s, k]
    return left


@inner_kernel
def _cross_all(at_a, at_b, parallelogram, solid, samples, count, clear):  # type: ignore[no-untyped-def]
    """As `hits`, for all segments at once. at_a, at_b: (3, n), the polygon's three forms at both ends."""
    for s in range(samples):
        ha, ua, va = at_a[0, s], at_a[1, s], at_a[2, s]
        if ha > 0:
            for k in range(count):
                clear[s, k] &= not crosses(ha, ua, va, at_b[0, k], at_b[1, k], at_b[2, k], parallelogram)
        elif not solid:
            for k in range(count):
                clear[s, k] &= not crosses(-ha, ua, va, -at_b[0, k], at_b[1, k], at_b[2, k], parallelogram)


@inner_kernel
def _turned_away(source, groups, group):  # type: ignore[no-untyped-def]
    """How far the emitter reaches before points in a box that all have this normal; 0 where they haven't one."""
    most = 0.0
    for k in range(3):
        n = groups.normal[group, k]
        i, j = (k + 3, k) if n > 0 else (k, k + 3)
        most += n * (source.box[i] - groups.boxes[group, j])
    return most


@kernel
def _step(tree, polygons, source, lit, groups, first, last, roots, root_flags, settings, mark, visible, counts):  # type: ignore[no-untyped-def]
    """The groups from `first` to `last`, which is no group's child. Fills `visible`, adds to `counts`."""
    size = len(tree.skip)
    room = (groups.levels + 2) * size + 1
    planes, near, extent = empty_shaft()
    work = _Work(
        np.empty(room, np.int32), np.empty(room, np.int8), np.empty(room, np.int32), planes, near, extent,
        np.empty(6), np.empty(6), empty_stack(size), mark, np.array([0, -1]),
    )  # fmt: skip
    work.nodes[: len(roots)] = roots
    work.flags[: len(roots)] = root_flags
    top, boxed = _objects_of(
        tree, polygons, False, settings.object_boxes, settings.size, source.polygon, -1, 0, len(roots), work
    )
    found = _List(0, top, boxed, -1)
    # The groups around the current one: where each ends, and its list. The emitter list is that of them all.
    ends = np.empty(groups.levels + 2, np.int64)
    lists = [found]
    ends[0] = last
    tiny = -1e-12 * settings.size

    group = first
    while group < last:
        while group >= ends[len(lists) - 1]:
            lists.pop()
        # Facing tests first, of all of them at once.
        if (source.one_sided and _highest(groups.boxes, group, source.plane) < tiny) or (
            lit.one_sided and _turned_away(source, groups, group) < tiny
        ):
            group = groups.skip[group]
            continue
        found = lists[-1]
        built = settings.strategy < 0 or _rays(source, groups, group) < settings.no_shaft_below
        if groups.skip[group] > group + 1:
            if not built:
                found = _shaft_list(tree, polygons, source, groups, group, found, settings, False, work, counts)
            if found.begin < found.end:
                ends[len(lists)] = groups.skip[group]
                lists.append(found)
                group += 1
                continue
            built = True  # nothing is in the way of any of its parts
        if settings.together:
            _cast_together(
                tree, polygons, source, lit, groups, group, found, built, settings, work, counts, visible
            )  # fmt: skip
        else:
            _cast_one_by_one(
                tree, polygons, source, lit, groups, group, found, built, settings, work, counts, visible
            )  # fmt: skip
        group = groups.skip[group]


@kernel
def _facing(source, lit, order, faces):  # type: ignore[no-untyped-def]
    for k in range(len(order)):
        for s in range(len(source.points)):
            faces[order[k], s] = _before_emitter(lit, k, source) and _before_receiver(lit, k, source, s)
