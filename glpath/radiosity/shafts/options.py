"""How candidates are found, and what was counted while they were: the plain data of `Visibility` [SC]."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

from glpath.errors import UsageError
from glpath.radiosity.shafts.shaft import Strategy

StrategyName = Literal["no shaft", "keep closed", "always open", "overlap open", "ratio open"]


STRATEGIES: dict[StrategyName, int] = {
    "no shaft": -1,
    "keep closed": Strategy.KEEP_CLOSED,
    "always open": Strategy.ALWAYS_OPEN,
    "overlap open": Strategy.OVERLAP_OPEN,
    "ratio open": Strategy.RATIO_OPEN,
}


OrderName = Literal["found", "largest first", "last occluder first"]


ORDERS: dict[OrderName, int] = {"found": 0, "largest first": 1, "last occluder first": 2}


LARGEST_FIRST, LAST_OCCLUDER_FIRST = 1, 2


@dataclass(frozen=True)
class Options:
    """How candidates are found; none of it changes what is visible. The defaults are quick for the office scenes.

    strategy          : what becomes of boxes that are not outside a shaft, see `Strategy`; "no shaft" is the
                        baseline, a ray caster through the BVH
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
    coherency         : test the last ray's occluder first, and build the shaft when it misses
    together          : test all rays of a clump against one candidate after the other; False: one ray after the
                        other, each until it is blocked, as in the paper
    object_boxes      : test a polygon's box before the polygon, as in the paper; of rays that are tested one by one
    clump             : most points of a receiver that share a shaft; 0 for all of them
    group             : most points of several receivers that share a shaft, for whose parts further shafts are
                        made; 0 for none
    nested            : a clump's shaft starts from the candidate list of its receiver's or group's
    order             : of the candidate list: as found, the largest first, or the last occluder moved to the front
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
    least_cut: float | None = 0.02
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
    least_cut=None,
    longest=0,
)


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
    cached       : rays that the last occluder stopped, with one test each
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


# Where each stands in the counts of the kernels.
SHAFTS, EMPTY, SHAFT_TESTS, CANDIDATES, LISTS = 0, 1, 2, 3, 4
RAYS, BLOCKED, CACHED, FREE, BOX_TESTS, OBJECT_TESTS = 5, 6, 7, 8, 9, 10
