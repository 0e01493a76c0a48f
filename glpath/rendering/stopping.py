"""When a render ends: after its path sets, or before that by time or by noise.

A render that was ended by a rule has the bits of one of as many path sets. By noise it ends at a count that follows
from the scene, the seed and the device alone, never from how fast they were rendered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from glpath.errors import UsageError
from glpath.film.batches import BLOCK
from glpath.film.film import Film
from glpath.film.noise import MIN_BATCHES

#: The share of renders whose error is below the bound that noise is asked for.
CONFIDENCE = 0.95

#: Path sets before noise is looked at.
FIRST_LOOK = MIN_BATCHES * BLOCK


@dataclass(frozen=True)
class StopRules:
    """What ends a render before its last path set, whichever comes first.

    time_limit : seconds of rendering, with those of the film that it goes on with; looked at between path sets, of
                 which there is at least one
    noise      : `Film.error_bound` of the image, at 95 % confidence
    """

    time_limit: float | None = None
    noise: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("time_limit", self.time_limit), ("noise", self.noise)):
            if value is not None and not (isinstance(value, int | float) and 0 < value < math.inf):
                raise UsageError(f"{name}: {value!r} where a number above 0 is needed")

    def __bool__(self) -> bool:
        return self.time_limit is not None or self.noise is not None


def looks_at_noise(path_sets: int) -> bool:
    """Whether a film of so many path sets, at the end of a block, is one whose noise is looked at.

    Every block at first, then about every eighth of the way: each look costs time, and each is a chance more to end
    by luck.
    """
    whole = path_sets // BLOCK
    return whole >= MIN_BATCHES and whole % (1 << max(0, whole.bit_length() - 4)) == 0


def stopped_by_noise(film: Film, rules: StopRules) -> tuple[bool, float | None]:
    """Whether the noise is low enough, and the bound, where this is a count to look at."""
    if rules.noise is None or not looks_at_noise(film.path_sets):
        return False, None
    bound = film.error_bound(CONFIDENCE)
    return bound is not None and bound <= rules.noise, bound
