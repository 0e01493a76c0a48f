"""How candidates are found, and what was counted while they were: the plain data of `Visibility` [SC]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import Any, Literal

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
class ShaftOptions:
    """How candidates are found, and when it pays; what is visible is the same. The defaults are quick for rooms.

    `python -m benchmarks bench shaft-options` measures what each is worth.

    strategy          : what becomes of boxes that are not outside a shaft. "always open": the shortest lists, for
                        many rays a shaft; "keep closed": the cheapest shafts, for few; "overlap open" and "ratio
                        open" lie between, the paper's choice; "no shaft": a ray caster through the BVH, where
                        nearly every shaft would have candidates, as in a heap of scattered triangles
    ratio             : of "ratio open", 0 to 1: the share of children above which a box stays closed; the larger,
                        the fewer stay closed
    open_enclosing    : open boxes that enclose a reference box, as every ray would hit them: pays where objects
                        stand within others' boxes
    emitter_list      : start at what the emitter does not lie in, found once per step: pays with many receivers
    behind_emitter    : leave out what lies behind a one-sided emitter, once per step: pays for lamps on walls
    solids            : leave out polygons of closed surfaces that face away from the emitter: half of them. Only
                        where no emitter sample lies inside of another solid: back faces do not block then
    coplanar          : leave out polygons whose plane has the emitter and the receiver on one side: pays in rooms
    mailbox           : "ratio open" marks the children that are outside below a box that stays closed: pays where a
                        shaft has many rays
    tolerance         : shafts begin and end where segments can be blocked, not at the surfaces, so that neighbours
                        of the receiver stay out: pays on finely divided surfaces
    coherency         : test the last ray's occluder first, and build the shaft when it misses: pays in deep shadow
    together          : test all rays of a clump against one candidate after the other, for vector units; False: one
                        ray after the other, each until it is blocked, as in the paper
    object_boxes      : test a polygon's box before the polygon, as in the paper: pays for polygons with many
                        corners and rays that are tested one by one
    clump             : most points of a receiver that share a shaft; 0 for all of them. Small ones have short
                        lists, large ones few shafts
    group             : most points of several receivers that share a shaft, for whose parts further shafts are
                        made; 0 for none. Pays where receivers are small and many
    nested            : a clump's shaft starts from the candidate list of its receiver's or group's: pays with
                        either
    order             : of the candidate list: as found; the "largest first", or the "last occluder first", which
                        pay where most rays are blocked and tested one by one
    min_cut         : planes sorted by the volume they cut off the extent box, those below this share of it left
                        out; None for all planes unsorted, which pays for very few boxes
    longest           : number of candidates beyond which "always open" becomes "ratio open"; 0: no limit. Pays
                        in scenes of many thousands of polygons
    no_shaft_below    : number of rays below which no shaft is built: pays with few receiver points
    keep_closed_below : number of rays below which the strategy is "keep closed", likewise
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
    min_cut: float | None = 0.02
    longest: int = 1500
    no_shaft_below: int = 0
    keep_closed_below: int = 0

    def __post_init__(self) -> None:
        for name, allowed in (("strategy", STRATEGIES), ("order", ORDERS)):
            if getattr(self, name) not in allowed:
                raise UsageError(
                    f"ShaftOptions.{name} is {getattr(self, name)!r}; allowed are {', '.join(allowed)}."
                )
        for name in ("clump", "group", "longest", "no_shaft_below", "keep_closed_below"):
            if getattr(self, name) < 0:
                raise UsageError(f"ShaftOptions.{name} is {getattr(self, name)}; allowed are whole numbers from 0.")
        if not 0 <= self.ratio <= 1:
            raise UsageError(f"ShaftOptions.ratio is {self.ratio}; allowed are 0 to 1.")

    @classmethod
    def of_words(cls, words: Sequence[str]) -> ShaftOptions:
        """From NAME=VALUE, as typed: "strategy=ratio open", "clump=8", "nested=no"; "paper" first: the paper's own.

        Raises UsageError for a name or a value that there is not.
        """
        made = cls()
        for number, word in enumerate(words):
            if word == "paper" and number == 0:
                made = PAPER
                continue
            name, found, value = word.partition("=")
            if not found or name not in _KINDS:
                near = get_close_matches(name, _KINDS, 1)
                remedy = f"Is {near[0]} meant? " if near else ""
                raise UsageError(
                    f"shaft option {word}: there is none of that name.",
                    f'{remedy}Write NAME=VALUE, with one of {", ".join(_KINDS)}; or "paper".',
                )
            made = replace(made, **{name: _value_of(name, value)})
        return made


_KINDS: Mapping[str, Any] = {f.name: f.type for f in fields(ShaftOptions)}
_TRUTHS = {"yes": True, "true": True, "no": False, "false": False}


def _value_of(name: str, word: str) -> Any:
    kind = _KINDS[name]
    if kind in ("StrategyName", "OrderName"):
        return word  # looked at by the options
    if kind == "bool":
        if word.lower() not in _TRUTHS:
            raise UsageError(f"shaft option {name}={word}: must be yes or no.")
        return _TRUTHS[word.lower()]
    if word == "none" and "None" in kind:
        return None
    try:
        return int(word) if kind == "int" else float(word)
    except ValueError as error:
        raise UsageError(f"shaft option {name}={word}: must be a {'whole ' * (kind == 'int')}number.") from error


#: The paper's own: one shaft per receiver, one ray after the other, nothing of what it leaves to the future.
PAPER = ShaftOptions(
    strategy="ratio open",
    together=False,
    object_boxes=True,
    coplanar=False,
    tolerance=False,
    clump=0,
    group=0,
    nested=False,
    min_cut=None,
    longest=0,
)


@dataclass
class Statistics:
    """Counts of a step. Rays are segments that are cast because both ends face each other.

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
STATISTICS = len(fields(Statistics))
