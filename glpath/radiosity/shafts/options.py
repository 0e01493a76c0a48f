"""Options and statistics of shaft culling [SC], which finds the surfaces that may block a view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from glpath.errors import UsageError
from glpath.radiosity.shafts.shaft import Strategy
from glpath.system.arguments import checked, short_repr
from glpath.system.numerals import real, whole
from glpath.system.suggestions import similar_names

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

# Largest count that the kernels can compare with, as int64.
_MAX_COUNT = (1 << 63) - 1


@dataclass(frozen=True)
class ShaftOptions:
    """Options of the search for candidate occluders. They affect the time, not the result.

    The defaults are fast for rooms.

    `python -m benchmarks bench shaft-options` measures the gain of each option.

    strategy          : treatment of boxes that are not outside a shaft. "always open" gives the shortest lists, for
                        many rays a shaft. "keep closed" gives the cheapest shafts, for few rays. "overlap open" and
                        "ratio open", the paper's choice, lie between. "no shaft" casts rays through the BVH, for
                        scenes in which nearly every shaft has candidates, such as a heap of scattered triangles
    ratio             : for "ratio open", a box stays closed if more than this fraction of its children, 0 to 1, is
                        not outside the shaft; larger values close fewer boxes
    open_enclosing    : True to open boxes that enclose a reference box, because every ray would hit them; useful if
                        objects lie within the boxes of others
    emitter_list      : True to start the search at nodes that do not contain the emitter, found once per step;
                        useful with many receivers
    behind_emitter    : True to remove nodes behind a one-sided emitter, once per step; useful for lamps on walls
    solids            : True to remove polygons of closed surfaces that face away from the emitter, about half of
                        them. Valid only if no emitter sample lies inside another solid, because back faces do not
                        block then
    coplanar          : True to remove polygons whose plane has emitter and receiver on one side; useful in rooms
    mailbox           : True if rays skip those children of a closed box that are outside the shaft ("ratio open");
                        useful if a shaft has many rays
    tolerance         : True to begin and end shafts where segments can be blocked, not at the surfaces, which
                        excludes neighbours of the receiver; useful on finely divided surfaces
    coherency         : True to test the last ray's occluder first, and to build the shaft if it misses; useful in
                        deep shadow
    together          : True to test all rays of a clump against one candidate after the other, for vector units;
                        False to test one ray after the other until it is blocked, as in the paper
    object_boxes      : True to test a polygon's box before the polygon, as in the paper; useful for polygons with
                        many corners and rays that are tested one by one
    clump             : maximum number of points of a receiver that share a shaft; 0 for all. Small clumps have
                        short lists, large clumps need few shafts
    group             : maximum number of points of several receivers that share a shaft, whose parts get nested
                        shafts; 0 for no groups. Useful if receivers are small and many
    nested            : True if a clump's shaft starts from the candidate list of its receiver or group
    order             : order of the candidate list: "found", "largest first", or "last occluder first". The last
                        two are useful if most rays are blocked and tested one by one
    min_cut         : minimum volume that a plane cuts off the extent box, as a fraction of the box; smaller planes
                        are left out, others sorted. None for all planes unsorted, useful for very few boxes
    longest           : number of candidates above which "always open" becomes "ratio open"; 0 for no limit. Useful
                        in scenes of many thousands of polygons
    no_shaft_below    : number of rays below which no shaft is built; useful with few receiver points
    keep_closed_below : number of rays below which the strategy is "keep closed"; useful with few receiver points
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
                    f"ShaftOptions.{name} is {short_repr(getattr(self, name))}; allowed are {', '.join(allowed)}."
                )
        for name in ("clump", "group", "longest", "no_shaft_below", "keep_closed_below"):
            if not 0 <= getattr(self, name) <= _MAX_COUNT:
                raise UsageError(
                    f"ShaftOptions.{name} is {getattr(self, name)}; allowed are whole numbers from 0 to 2^63 - 1."
                )
        if not 0 <= self.ratio <= 1:
            raise UsageError(f"ShaftOptions.ratio is {self.ratio}; allowed are 0 to 1.")
        if self.min_cut is not None and not self.min_cut >= 0:
            raise UsageError(f"ShaftOptions.min_cut is {self.min_cut}; allowed are numbers from 0, and None.")

    @classmethod
    def of_words(cls, words: Sequence[str]) -> ShaftOptions:
        """Return the options that `words` define, each of the form NAME=VALUE, such as "clump=64".

        The other options have their defaults, or the values of `PAPER` if the first word is "paper". Raises
        UsageError for an unknown name or value.
        """
        made = cls()
        for number, word in enumerate(words):
            if word == "paper" and number == 0:
                made = PAPER
                continue
            name, found, value = word.partition("=")
            if not found or name not in _KINDS:
                near = similar_names(name, _KINDS, 1)
                remedy = f"Is {near[0]} meant? " if near else ""
                raise UsageError(
                    f"shaft option {word}: there is none of that name.",
                    f'{remedy}Write NAME=VALUE, with one of {", ".join(_KINDS)}; or "paper".',
                )
            made = replace(made, **{name: _value_of(name, value)})
        return made


# Values of a wrong type would reach the kernels, where a float instead of an int ends the process.
ShaftOptions.__init__ = checked(ShaftOptions.__init__)  # type: ignore[method-assign]

_KINDS: Mapping[str, Any] = {f.name: f.type for f in fields(ShaftOptions)}
_TRUTHS = {"yes": True, "true": True, "no": False, "false": False}


def _value_of(name: str, word: str) -> Any:
    kind = _KINDS[name]
    if kind in ("StrategyName", "OrderName"):
        return word  # checked when the options are created
    if kind == "bool":
        if word.lower() not in _TRUTHS:
            raise UsageError(f"shaft option {name}={word}: must be yes or no.")
        return _TRUTHS[word.lower()]
    if word == "none" and "None" in kind:
        return None
    try:
        return whole(word) if kind == "int" else real(word)
    except ValueError as error:
        raise UsageError(f"shaft option {name}={word}: must be a {'whole ' * (kind == 'int')}number.") from error


#: Options of the paper [SC]: one shaft per receiver, one ray after the other, and no extensions that the paper
#: leaves to future work.
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
    """Counts of one visibility step. A ray is a segment whose ends face each other.

    shafts       : shafts that were formed
    empty_shafts : shafts without candidates, so that all their rays are unoccluded
    shaft_tests  : tests of boxes against shafts
    candidates   : total length of the candidate lists of shafts through which rays were cast
    lists        : number of those candidate lists that are not empty
    rays         : all rays
    blocked      : blocked rays
    cached       : rays that the last occluder blocked, with one test each
    free         : rays through shafts without candidates, without any test
    box_tests    : tests of rays against boxes
    object_tests : tests of rays against polygons, including those of cached rays
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
        """Number of tests of rays against boxes and polygons."""
        return self.box_tests + self.object_tests

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


# Index of each statistic in the arrays of counts that the kernels fill.
SHAFTS, EMPTY, SHAFT_TESTS, CANDIDATES, LISTS = 0, 1, 2, 3, 4
RAYS, BLOCKED, CACHED, FREE, BOX_TESTS, OBJECT_TESTS = 5, 6, 7, 8, 9, 10
STATISTICS = len(fields(Statistics))
