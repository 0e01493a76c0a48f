"""When a render ends: after its path sets, or before that by time or by noise.

A render that was ended by a rule has the bits of one of as many path sets. By noise it ends at a count that follows
from the scene, the seed and the device alone, never from how fast they were rendered.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from glpath.film.batches import BLOCK
from glpath.film.noise import MIN_BATCHES

if TYPE_CHECKING:
    from glpath.film.film import Film

#: A Sobol sequence of 30 bits ends at 2**30.
MAX_SPP, MAX_FIRST_PATH_SET = 2**29 - 256, 2**29

#: The share of renders whose error is below the bound that noise is asked for.
CONFIDENCE = 0.95

#: Path sets before noise is looked at.
FIRST_LOOK = MIN_BATCHES * BLOCK


def looks_at_noise(path_sets: int) -> bool:
    """Whether a film of so many path sets, at the end of a block, is one whose noise is looked at.

    Every block at first, then about whenever the film has grown by an eighth. Each look costs time, and is a
    further chance to end by luck.
    """
    whole = path_sets // BLOCK
    return whole >= MIN_BATCHES and whole % (1 << max(0, whole.bit_length() - 4)) == 0


def stopped_by_noise(film: Film, noise: float) -> tuple[bool, float | None]:
    """Whether the noise is low enough, and the bound, where this is a count to look at."""
    if not looks_at_noise(film.path_sets):
        return False, None
    bound = film.error_bound(CONFIDENCE)
    return bound is not None and bound <= noise, bound
