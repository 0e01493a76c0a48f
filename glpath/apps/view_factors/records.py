"""Records of the view factor kernels: convex polygons, a BVH, and the working memory of a thread."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.accel.nodes import Bvh
from glpath.apps.view_factors.convex import ROOM
from glpath.apps.view_factors.exchange import RULE_2, RULE_4, RULE_6, RULE_8
from glpath.apps.view_factors.hidden import BLOCKS, PARTS, SOBOL
from glpath.radiosity.shafts.shaft import FormedShaft

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]

#: Maximum number of successive halvings of a pair's polygons.
DEEPEST = 14
#: Maximum number of occluders considered between two polygons. If there are more, a polygon is halved, down to
#: `DEEPEST`; there, further occluders are ignored.
MAX_CLIPPED = 256


class Polygons(NamedTuple):
    """Convex polygons, either facets or occluders.

    corners : (N, CORNERS, 3) float64, counter-clockwise from the front
    sides   : (N,) int64, number of corners
    planes  : (N, 4) float64, unit normal on the front side and distance
    edges   : (N, CORNERS, 4) float64, plane through each edge and the polygon's normal; the plane's normal points
              inward
    boxes   : (N, 6) float64, lower and upper corner
    areas   : (N,) float64
    """

    corners: Float64
    sides: Int64
    planes: Float64
    edges: Float64
    boxes: Float64
    areas: Float64

    def select(self, which: NDArray[Any]) -> Polygons:
        """Return the polygons `which`, in that order."""
        return Polygons(*(np.ascontiguousarray(part[which]) for part in self))


class Tree(NamedTuple):
    """BVH over the facets, which are numbered in its order, with one facet a leaf.

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
    """Working memory of one thread; the functions that use an array describe it.

    stop   : (1,) shared by all threads; a value other than 0 ends them within some points of a pair, because rows
             may take minutes
    done   : (1,) number of rows that this thread has finished since it was set to 0
    counts : (C,) counts of this thread, see `rows.COUNT_NAMES`
    lost   : (1,) number of times that a polygon was cut into too many pieces
    """

    eps: float
    stop: Int64
    done: Int64
    counts: Int64
    lost: Int64
    a: Float64
    b: Float64
    spare: Float64
    box: Float64
    centre_a: Float64
    centre_b: Float64
    points_a: Float64
    points_b: Float64
    halves: Float64
    rule_2: Float64
    rule_4: Float64
    rule_6: Float64
    rule_8: Float64
    pairs: Int64
    pending: Int64
    lists: Int32
    shaft: FormedShaft
    hull: Float64
    at_a: Float64
    at_b: Float64
    clipped: Float64
    clipped_count: Int64
    clipped_planes: Float64
    pyramid: Float64
    made: Int64
    parting: Int64
    fronts: Float64
    parts: Float64
    part_corners: Int64
    following: Int64
    fan: Float64
    blocks: Float64
    sobol: Int64

    @classmethod
    def of(cls, eps: float, occluders: int, depth: int, stop: Int64, done: Int64, counts: Int64) -> Work:
        points = len(RULE_8) * ROOM
        return cls(
            eps=eps,
            stop=stop,
            done=done,
            counts=counts,
            lost=np.zeros(1, np.int64),
            a=np.empty((DEEPEST + 2, ROOM, 3)),
            b=np.empty((DEEPEST + 2, ROOM, 3)),
            spare=np.empty((ROOM, 3)),
            box=np.empty((8, 3)),
            centre_a=np.empty(3),
            centre_b=np.empty(3),
            points_a=np.empty((4, points)),
            points_b=np.empty((4, points)),
            halves=np.empty((64, 3)),
            rule_2=RULE_2,
            rule_4=RULE_4,
            rule_6=RULE_6,
            rule_8=RULE_8,
            pairs=np.empty((DEEPEST + 2, 5), np.int64),
            pending=np.empty((2 * depth + 4, 3), np.int64),
            lists=np.empty((depth + DEEPEST + 4) * occluders, np.int32),
            shaft=FormedShaft.between(np.empty(6), np.empty(6)),
            hull=np.empty((4 * ROOM, 4)),
            at_a=np.empty(ROOM),
            at_b=np.empty(ROOM),
            clipped=np.empty((MAX_CLIPPED, ROOM, 3)),
            clipped_count=np.empty(MAX_CLIPPED, np.int64),
            clipped_planes=np.empty((MAX_CLIPPED, 4)),
            pyramid=np.empty((MAX_CLIPPED, ROOM, 4)),
            made=np.empty(MAX_CLIPPED, np.int64),
            parting=np.empty(MAX_CLIPPED, np.int64),
            fronts=np.empty(MAX_CLIPPED),
            parts=np.empty((PARTS + 2, 2 * ROOM, 3)),
            part_corners=np.empty(PARTS + 2, np.int64),
            following=np.empty(PARTS + 2, np.int64),
            fan=np.empty(ROOM),
            blocks=np.empty((BLOCKS, 2)),
            sobol=SOBOL,
        )
