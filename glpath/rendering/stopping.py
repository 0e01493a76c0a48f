"""Rules that end a render: its number of path sets, time, or noise.

A render ended by a rule is bit-identical to a render with that number of path sets. With a noise rule, the number
depends only on the scene, the seed and the device, not on speed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from glpath.film.batches import BLOCK
from glpath.film.choices import CLEAN, NOISE
from glpath.film.noise import MIN_BATCHES

if TYPE_CHECKING:
    from glpath.film.film import Film
    from glpath.rendering.run_options import RunOptions

#: Confidence of the noise rule: fraction of renders whose error is below the limit that ended them.
CONFIDENCE = 0.95

#: Number of path sets at the first check of a noise rule.
FIRST_LOOK = MIN_BATCHES * BLOCK

#: Number of blocks of path sets at the first check of a denoised image. Two halves need at least two blocks. With
#: few path sets, the denoiser leaves blotches that both halves may share, so the error would be underestimated.
_BLOCKS_OF_CLEAN = 2


def looked_at(options: RunOptions, path_sets: int) -> bool:
    """Return True if a rule checks a film with this number of path sets, which is at the end of a block.

    A film is checked after every block at first. Later checks follow when the film has grown by about an eighth, or
    by a half if a check denoises. Each check costs time, and is a chance that the estimated error is too low.
    """
    whole = path_sets // BLOCK
    by_noise = options.noise is not None and whole >= MIN_BATCHES and _is_round(whole, 4)
    by_clean = options.clean is not None and whole >= _BLOCKS_OF_CLEAN and _is_round(whole, 2)
    return by_noise or by_clean


def _is_round(number: int, bits: int) -> bool:
    """Return True if only the first `bits` bits of a number, from its highest one, are not zero."""
    return number % (1 << max(0, number.bit_length() - bits)) == 0


def first_look(options: RunOptions) -> int:
    """Return the number of path sets at the first check of a rule."""
    return FIRST_LOOK if options.clean is None else _BLOCKS_OF_CLEAN * BLOCK


def ended_by(film: Film, options: RunOptions) -> tuple[str, float | None]:
    """Return the rule whose limit a film meets, or "", and the error compared with the limit, or None."""
    if not looked_at(options, film.path_sets):
        return "", None
    if options.noise is not None:
        bound = film.error_bound(CONFIDENCE)
        return (NOISE if bound is not None and bound <= options.noise else ""), bound
    assert options.clean is not None, "something looks at the film"
    noise = film.denoised_noise()
    return (CLEAN if noise is not None and noise <= options.clean else ""), noise
