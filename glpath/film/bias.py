"""How far a picture with a bias, a gather's, is from the light that unbiased paths find: in the mean and by block.

A few path sets of unbiased paths, of a smaller picture, are kept as the means of its blocks, beside the film and
not in it (`FilmMetadata.statistics["unbiased"]`): they add up when films merge.

Poor at:  bias in a few pixels, a dark corner say: blocks are an eighth of the picture along a side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.film.noise import FLOOR, standard_error

Float64 = NDArray[np.float64]

#: Under which name `FilmMetadata.statistics` has what unbiased paths find.
UNBIASED = "unbiased"
#: Blocks along each side of the picture.
BLOCKS = 8


@dataclass(frozen=True)
class Bias:
    """The bias of a picture, as shares of its light.

    mean         : of the whole picture: above 0 it is too bright
    mean_error   : its standard error
    blocks       : the root of the mean square over blocks, relative as in `compare.relative_mse`, without what
                   noise explains: 0 where that explains all
    blocks_error : what it would be by noise alone
    """

    mean: float
    mean_error: float
    blocks: float
    blocks_error: float


def block_means(picture: NDArray[np.floating[Any]], across: float = 1.0) -> Float64:
    """(BLOCKS, BLOCKS), the mean of the channels of a picture (H, W, 3) in blocks of one size.

    across : the blocks cover this share of its width, about the middle
    """
    height, width = picture.shape[:2]
    sums = np.pad(picture.mean(axis=2, dtype=np.float64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    rows = np.linspace(0.0, height, BLOCKS + 1)
    columns = 0.5 * width * (1.0 + across * np.linspace(-1.0, 1.0, BLOCKS + 1))
    at_columns = np.stack([np.interp(columns, np.arange(width + 1), row) for row in sums])
    at = np.stack([np.interp(rows, np.arange(height + 1), column) for column in at_columns.T], axis=1)
    of_blocks = np.diff(np.diff(at, axis=0), axis=1)
    return np.asarray(of_blocks / (np.diff(rows)[:, None] * np.diff(columns)))


def summed(sets: Sequence[Float64], across: float) -> dict[str, Any]:
    """The block means of path sets as `statistics["unbiased"]`: sums add up where films merge.

    The last of each list is of the whole picture.
    """
    each = _with_the_whole(sets)
    return {
        "sets": len(sets),
        "across_sum": across * len(sets),
        "sum": [float(f"{one:.9g}") for one in each.sum(axis=0)],
        "square": [float(f"{one:.9g}") for one in (each**2).sum(axis=0)],
    }


def _with_the_whole(sets: Sequence[Float64]) -> Float64:
    """(N, BLOCKS² + 1) of N means of blocks, and of all of them last."""
    return np.stack([np.append(means, means.mean()) for means in sets])


def check_unbiased(found: object) -> None:
    """Raise ValueError for what `summed` has not made."""
    if not isinstance(found, Mapping) or {*found} != {"sets", "across_sum", "sum", "square"}:
        raise ValueError("its unbiased paths are not described by sets, across_sum, sum and square")
    counts, lists = (found["sets"], found["across_sum"]), (found["sum"], found["square"])
    if not all(isinstance(one, list) and len(one) == BLOCKS**2 + 1 for one in lists):
        raise ValueError(f"its unbiased paths are not in {BLOCKS**2 + 1} blocks")
    if not all(isinstance(one, int | float) and one > 0 for one in counts):
        raise ValueError("its unbiased paths are no path sets")


def bias_of(radiance_sums: Float64, batch_counts: NDArray[np.int64], unbiased: Mapping[str, Any]) -> Bias | None:
    """The bias of a film (B, H, W, 3) of so many path sets in each batch; None where too few sets show no error.

    unbiased : what `summed` has made
    """
    count, used = int(unbiased["sets"]), np.flatnonzero(batch_counts)
    if count < 2 or len(used) < 2:
        return None
    across = unbiased["across_sum"] / count
    light = np.array(unbiased["sum"]) / count
    spread = np.maximum(np.array(unbiased["square"]) / count - light**2, 0.0) / (count - 1)
    whole = _with_the_whole([block_means(radiance_sums[batch], across) for batch in used])
    found = whole.sum(axis=0) / batch_counts[used].sum()
    variance = spread + standard_error(whole, batch_counts[used]) ** 2
    difference = found - light
    weight = 1.0 / (light[:-1] ** 2 + FLOOR)
    by_noise = float(np.mean(variance[:-1] * weight))
    square = float(np.mean(difference[:-1] ** 2 * weight)) - by_noise
    middle = max(float(light[-1]), 1e-12)
    return Bias(
        mean=float(difference[-1]) / middle,
        mean_error=float(np.sqrt(variance[-1])) / middle,
        blocks=float(np.sqrt(max(square, 0.0))),
        blocks_error=float(np.sqrt(by_noise)),
    )
