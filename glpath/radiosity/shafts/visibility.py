"""Visibility between the samples of an emitter and the points of receivers, by shafts [SC].

    visibility = Visibility(Occluders.of_scene(scene))
    visibility.visible(points_a, points_b)                  # (A, B) bool, between two sets of points
    visibility.step(emitter, receivers)                     # one emitter against all receivers, with statistics

A shaft is built between the emitter and a clump of receiver points. Segments between the two are tested against its
candidate list only, and if the list is empty, no segment is tested. All options give exactly the result of testing
every segment against every polygon. The bench "shaft-options" measures their cost.

Cost:     groups of receivers are distributed over threads; measured by the bench "shaft".
Poor at:  few rays per shaft; a volume full of tiny polygons, in which every shaft has a long list.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.accel.bvh import Int32, build_bvh
from glpath.accel.nodes import Bvh
from glpath.radiosity.shafts.casting import cast_groups
from glpath.radiosity.shafts.clusters import cluster
from glpath.radiosity.shafts.ends import Emitter, Lit, Receivers, lit_of, source_of
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.options import ORDERS, STRATEGIES, ShaftOptions, Statistics
from glpath.radiosity.shafts.points import Groups, group_points
from glpath.radiosity.shafts.search import SearchTree, Settings, Step, Work, find_emitter_list
from glpath.radiosity.shafts.shaft import CandidateLists
from glpath.system.machine import core_count
from glpath.system.threads import Stop
from glpath.system.time_limit import check_time


class Prepared(NamedTuple):
    """Receivers prepared for `Visibility.step`."""

    groups: Groups
    lit: Lit


@dataclass
class Visibility:
    """Visibility between points among occluders.

    Parameters
    ----------
    occluders  : polygons that may block segments
    options   : options of the search for occluders
    bvh : "areas" for the tree of `build_bvh`, or "clusters" for that of Goldsmith and Salmon as in the paper
    threads   : number of threads; None for one per core

    While its flag `stop` is set, see `worker_threads`, points see nothing.
    """

    occluders: Occluders
    options: ShaftOptions = field(default_factory=ShaftOptions)
    bvh: Literal["areas", "clusters"] = "areas"
    threads: int | None = None
    stop: Stop = field(default_factory=lambda: np.zeros(1, np.int64), init=False, repr=False)

    @cached_property
    def tree(self) -> Bvh:
        """BVH of the occluders' boxes, with one polygon in every leaf."""
        boxes = self.occluders.boxes()
        return cluster(*boxes) if self.bvh == "clusters" else build_bvh(*boxes, leaf_size=1)

    @cached_property
    def _search_tree(self) -> SearchTree:
        return SearchTree.of(self.tree)

    @property
    def _cores(self) -> int:
        return self.threads or core_count()

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self._cores)

    @cached_property
    def _polygons(self):  # type: ignore[no-untyped-def]
        return self.occluders.polygons(self.options.solids)

    def visible(self, points_a: ArrayLike, points_b: ArrayLike) -> NDArray[np.bool_]:
        """Return (A, B) bool, True if nothing occludes a point of one set from a point of the other.

        points_a, points_b : (A, 3) and (B, 3). Occluders within a fraction of 1e-5 of the segment's length from its
                             ends do not count, so that points may lie on surfaces. `ShaftOptions.solids` takes
                             points_a as the emitter
        """
        a, b = np.array(points_a, np.float64), np.array(points_b, np.float64)
        receivers = Receivers(b, np.zeros(len(b), np.int32))
        return np.ascontiguousarray(self.step(Emitter(a), receivers)[0].T)

    def prepare(self, receivers: Receivers) -> Prepared:
        """Group receivers into clumps that share shafts. Keep the result between steps; it fits all emitters."""
        self.occluders.check_points(receivers.points, "Receivers.points")
        o = self.options
        groups = group_points(
            receivers.points, receivers.receiver, receivers.normals, receivers.polygons, o.clump, o.group, o.nested
        )
        check_time()
        return Prepared(groups, lit_of(receivers, groups.order))

    def emitter_list(self, emitter: Emitter) -> tuple[Int32, NDArray[np.int8]]:
        """Return nodes that can block light of an emitter, and flags of their boxes [SC, Enhancements].

        Returns (n,) int32 nodes and (n,) int8 flags: 1 if the box overlaps the emitter's, 0 if not, -1 if unknown.
        """
        o = self.options
        behind = o.behind_emitter and emitter.normal is not None
        # With `tolerance`, a shaft begins in front of the emitter's surface, so a box that overlaps the emitter's
        # box may still be outside the shaft. Its flag is therefore -1, unknown.
        size = len(self.tree)
        lists = CandidateLists.empty(size, size)
        touching = -1 if o.tolerance else 1
        n = find_emitter_list(self._search_tree, source_of(emitter), o.emitter_list, behind, touching, lists)
        return lists.nodes[:n], lists.flags[:n]

    def step(self, emitter: Emitter, receivers: Receivers | Prepared) -> tuple[NDArray[np.bool_], Statistics]:
        """Return (P, S) bool, True if a receiver point sees a sample of the emitter, and statistics.

        Pairs that do not face each other are False. If there are several steps, pass receivers of `prepare`.
        """
        o = self.options
        self.occluders.check_points(emitter.points, "Emitter.points")
        count = len(receivers.groups.order) if isinstance(receivers, Prepared) else len(receivers.points)
        visible = np.zeros((count, len(emitter.points)), np.bool_)
        if not visible.size:
            return visible, Statistics()
        groups, lit = receivers if isinstance(receivers, Prepared) else self.prepare(receivers)
        tree = self._search_tree.tree
        roots, flags = self.emitter_list(emitter)
        settings = Settings(
            int(STRATEGIES[o.strategy]), float(o.ratio), o.open_enclosing, o.coplanar, o.tolerance, o.coherency,
            o.together, o.object_boxes, ORDERS[o.order], -1.0 if o.min_cut is None else float(o.min_cut),
            o.longest or len(tree.skip), o.no_shaft_below, o.keep_closed_below,
            self.occluders.slack, self.occluders.size,
        )  # fmt: skip
        step = Step(tree, self._polygons, source_of(emitter), lit, groups, settings, visible)

        def some(part: slice) -> NDArray[np.int64]:
            together = int((groups.end[part] - groups.begin[part]).max(initial=0)) if o.together else 0
            work = Work.of(step, together, o.mailbox and o.strategy in ("ratio open", "always open"), self.stop)
            cast_groups(step, part.start, part.stop, roots, flags, work)
            return work.counts

        # Each call holds Python's global lock for about 0.1 ms, so few calls are made: two per thread, enough to
        # balance the load.
        parts = groups.parts(1 if self._cores == 1 else 2 * self._cores)
        counts = sum(self._pool.map(some, parts) if len(parts) > 1 else map(some, parts))
        return visible, Statistics(*(int(c) for c in np.atleast_1d(counts)))


def visible(
    occluders: Occluders, points_a: ArrayLike, points_b: ArrayLike, options: ShaftOptions | None = None
) -> NDArray[np.bool_]:
    """Return the result (A, B) of `Visibility.visible`.

    For several calls, create a `Visibility`, which keeps its tree.
    """
    return Visibility(occluders, options or ShaftOptions()).visible(points_a, points_b)
