"""When a render ends: after its path sets, or before that by time or by noise.

A render that was ended by a rule has the bits of one of as many path sets. By noise it ends at a count that follows
from the scene, the seed and the device alone, never from how fast they were rendered.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from glpath.film.batches import BLOCK
from glpath.film.choices import CLEAN, NOISE
from glpath.film.noise import MIN_BATCHES

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.rendering.run_options import RunOptions

#: The share of renders whose error is below the bound that noise is asked for.
CONFIDENCE = 0.95

#: Path sets before noise is looked at.
FIRST_LOOK = MIN_BATCHES * BLOCK

#: Blocks of path sets before a denoised picture is looked at. Fewer make no two halves; and of few sets a denoiser
#: makes blotches that both halves may have alike.
_BLOCKS_OF_CLEAN = 2


def looked_at(options: RunOptions, path_sets: int) -> bool:
    """Whether a rule looks at a film of so many path sets: at the end of a block.

    Every block at first, then about whenever the film has grown by an eighth, or by a half where each look denoises
    it. Each look costs time, and is a further chance to end by luck.
    """
    whole = path_sets // BLOCK
    by_noise = options.noise is not None and whole >= MIN_BATCHES and _is_round(whole, 4)
    by_clean = options.clean is not None and whole >= _BLOCKS_OF_CLEAN and _is_round(whole, 2)
    return by_noise or by_clean


def _is_round(number: int, bits: int) -> bool:
    """Whether it is a number of so many bits, and zeros after these."""
    return number % (1 << max(0, number.bit_length() - bits)) == 0


def first_look(options: RunOptions) -> int:
    """Path sets that a film has at the first look of a rule."""
    return FIRST_LOOK if options.clean is None else _BLOCKS_OF_CLEAN * BLOCK


def ended_by(film: Film, options: RunOptions) -> tuple[str, float | None]:
    """The rule by which a film is good enough, "" for none; and the error that was compared, where it was."""
    if not looked_at(options, film.path_sets):
        return "", None
    if options.noise is not None:
        bound = film.error_bound(CONFIDENCE)
        return (NOISE if bound is not None and bound <= options.noise else ""), bound
    assert options.clean is not None, "something looks at the film"
    noise = film.denoised_noise()
    return (CLEAN if noise is not None and noise <= options.clean else ""), noise
