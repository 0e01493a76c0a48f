"""Bias of the gather integrator: difference of its image from one of unbiased paths, on average and in blocks.

The gather and unbiased paths trace the same few path sets of a smaller image. Both use the same first directions
and light samples, so the difference of a set has little noise. Sums of the differences are stored with the film
(`FilmMetadata.statistics["bias_probe"]`).

Poor at:  bias in a few pixels, such as a dark corner: a block's side is an eighth of the image's side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.film.noise import FLOOR

Float64 = NDArray[np.float64]

#: Key of the measured sums in `FilmMetadata.statistics`.
BIAS_PROBE = "bias_probe"
#: Key of the same sums if the gather's bias was too large, so that "path" rendered the film instead.
REJECTED_GATHER = "rejected_gather"
#: Key of a text that explains why the bias could not be measured.
BIAS_OBSTACLE = "bias_obstacle"
#: Number of blocks along each side of the image.
BLOCKS = 8
#: Limit of the bias of the image's mean, as a fraction of that mean; above it, `auto` does not render with a
#: gather.
MAX_MEAN = 0.01
#: Limit of the bias of blocks, as a fraction of their light; above it, `auto` does not render with a gather.
MAX_BLOCKS = 0.03
#: Before the last path set, the check decides only if the bias is this many standard errors from its limit (95 %
#: confidence).
SURE = 1.645
#: After the last path set, a bias counts as small if it is this many standard errors below its limit.
FINAL = 1.0
# Difference of a block, in standard errors, that noise alone may explain. Only the excess counts for `worst_block`.
_BLOCK_NOISE = 3.5
# A block's difference is relative to its light, but at least to this fraction of the image's mean light.
_DARK_BLOCK = 0.02


@dataclass(frozen=True)
class Bias:
    """Bias of an image, as fractions of its light.

    mean         : relative error of the image's mean; above 0 the image is too bright
    mean_error   : standard error of `mean`
    blocks       : root mean square of the blocks' relative errors, as in `compare.relative_mse`, after subtracting
                   noise
    blocks_error : root mean square that noise alone would cause
    worst_block  : largest relative error of a block, after subtracting 3.5 standard errors
    """

    mean: float
    mean_error: float
    blocks: float
    blocks_error: float
    worst_block: float

    def is_small(self, errors: float = FINAL) -> bool:
        """Return True if the bias, plus `errors` standard errors, is below 1 % in the mean and 3 % in blocks."""
        spread = errors * self.blocks_error**2 * np.sqrt(2.0) / BLOCKS
        return bool(
            abs(self.mean) + errors * self.mean_error < MAX_MEAN
            and np.sqrt(self.blocks**2 + spread) < MAX_BLOCKS
            and self.worst_block < MAX_BLOCKS
            and self.blocks_error < MAX_BLOCKS
        )

    def is_large(self, errors: float = SURE) -> bool:
        """Return True if the bias, minus `errors` standard errors, is above its limit in the mean or in blocks."""
        return bool(
            abs(self.mean) - errors * self.mean_error > MAX_MEAN
            or self.blocks > MAX_BLOCKS + errors * self.blocks_error / BLOCKS
            or self.worst_block > MAX_BLOCKS
        )

    def __str__(self) -> str:
        blocks = max(self.blocks, self.blocks_error)
        word = "up to " if self.blocks < self.blocks_error else ""
        worst = f", {_percent(self.worst_block)} % in the worst" if self.worst_block > MAX_BLOCKS else ""
        sign = "+" if self.mean >= 0 else ""
        return (
            f"{sign}{_percent(self.mean)} % of the light, plus or minus {_percent(self.mean_error, 1)}; "
            f"in blocks {word}{_percent(blocks)} %{worst}"
        )


def _percent(share: float, digits: int = 2) -> str:
    """Return a fraction in percent, rounded to some digits and without an exponent."""
    return f"{float(f'{100 * share:.{digits}g}'):g}"


def block_means(picture: NDArray[np.floating[Any]]) -> Float64:
    """Return the (BLOCKS, BLOCKS) means of blocks of equal size, over all channels of an image (H, W, 3)."""
    height, width = picture.shape[:2]
    sums = np.pad(picture.mean(axis=2, dtype=np.float64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    rows = np.linspace(0.0, height, BLOCKS + 1)
    columns = np.linspace(0.0, width, BLOCKS + 1)
    at_columns = np.stack([np.interp(columns, np.arange(width + 1), row) for row in sums])
    at = np.stack([np.interp(rows, np.arange(height + 1), column) for column in at_columns.T], axis=1)
    of_blocks = np.diff(np.diff(at, axis=0), axis=1)
    return np.asarray(of_blocks / (np.diff(rows)[:, None] * np.diff(columns)))


def summed(biased: Sequence[Float64], unbiased: Sequence[Float64]) -> dict[str, Any]:
    """Return the sums, over path sets, of block means and their differences, in the form of a bias probe.

    biased, unbiased : (BLOCKS, BLOCKS) block means of each path set, in the same order

    The last entry of each list is for the whole image.
    """
    light = _with_the_whole(unbiased)
    difference = _with_the_whole(biased) - light
    sums = {"light": light, "difference": difference, "square": difference**2}
    return {"sets": len(light)} | {
        name: [float(f"{one:.9g}") for one in each.sum(axis=0)] for name, each in sums.items()
    }


def _with_the_whole(sets: Sequence[Float64]) -> Float64:
    """Return (N, BLOCKS² + 1): for each of N path sets, its block means and then the mean of all blocks."""
    return np.stack([np.append(means, means.mean()) for means in sets])


def check_probe(found: object) -> None:
    """Raise ValueError if the value cannot be a result of `summed`."""
    if not isinstance(found, Mapping) or {*found} != {"sets", "light", "difference", "square"}:
        raise ValueError("its bias probe does not consist of sets, light, difference and square")
    lists = (found["light"], found["difference"], found["square"])
    if not all(isinstance(one, list) and len(one) == BLOCKS**2 + 1 for one in lists):
        raise ValueError(f"its bias probe is not in {BLOCKS**2 + 1} blocks")
    if not (isinstance(found["sets"], int) and found["sets"] > 0):
        raise ValueError("its bias probe has no path sets")


def bias_of(probe: Mapping[str, Any]) -> Bias | None:
    """Return the bias measured by a probe, or None if it has fewer than two path sets.

    probe : result of `summed`
    """
    count = int(probe["sets"])
    if count < 2:
        return None
    light, difference = np.array(probe["light"]) / count, np.array(probe["difference"]) / count
    variance = np.maximum(np.array(probe["square"]) / count - difference**2, 0.0) / (count - 1)
    whole = max(float(light[-1]), 1e-12)
    weight = 1.0 / (light[:-1] ** 2 + FLOOR)
    by_noise = float(np.mean(variance[:-1] * weight))
    square = float(np.mean(difference[:-1] ** 2 * weight)) - by_noise
    excess = np.abs(difference[:-1]) - _BLOCK_NOISE * np.sqrt(variance[:-1])
    return Bias(
        mean=float(difference[-1]) / whole,
        mean_error=float(np.sqrt(variance[-1])) / whole,
        blocks=float(np.sqrt(max(square, 0.0))),
        blocks_error=float(np.sqrt(by_noise)),
        worst_block=max(0.0, float((excess / np.maximum(light[:-1], _DARK_BLOCK * whole)).max())),
    )
