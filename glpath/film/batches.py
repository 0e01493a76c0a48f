"""Assign path sets to batches by the path sets' indices alone, so that any ranges can be merged.

A film sums each batch separately, because its error is estimated from differences between batches. Differences
between pixels do not suffice: paths of a set may share directions or sequence points, so errors of adjacent pixels
are correlated.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError

# Path set i belongs to batch (i // BLOCK) % BATCHES. A block of 8 keeps consecutive points of a Sobol sequence
# together, because they stratify each other. With 8 batches, the estimated standard error is itself accurate to
# about a quarter.
BLOCK = 8
BATCHES = 8
# Largest path set index accepted from a file. It is beyond any possible render, and small enough that counts do not
# overflow.
_LAST_PATH_SET = 1 << 48


def batch_of(path_set: int) -> int:
    """Return the batch in which a path set is summed."""
    return path_set // BLOCK % BATCHES


def blocks(start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split path sets start..stop (half-open) into ranges that each lie in one block, as `Film.add` requires."""
    while start < stop:
        end = min(stop, (start // BLOCK + 1) * BLOCK)
        yield start, end
        start = end


def united(ours: tuple[tuple[int, int], ...], theirs: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
    """Return the sorted union of two lists of ranges, adjacent ones joined. Raises UsageError if any overlap."""
    found: list[tuple[int, int]] = []
    for start, stop in sorted(ours + theirs):
        if found and start < found[-1][1]:
            raise UsageError(
                f"film: path sets {start} to {min(stop, found[-1][1]) - 1} would be in it twice.",
                "Give every part path sets of its own.",
            )
        if found and start == found[-1][1]:
            found[-1] = (found[-1][0], stop)
        else:
            found.append((start, stop))
    return tuple(found)


def disjoint(ranges: NDArray[np.int64]) -> bool:
    """Return True if ranges (R, 2) are valid for a film: none empty, in order, none adjacent."""
    starts, stops = ranges.T
    in_order = bool((starts < stops).all() and (stops[:-1] < starts[1:]).all())
    return in_order and (not len(ranges) or (starts[0] >= 0 and stops[-1] <= _LAST_PATH_SET))


def counts_of(ranges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (BATCHES,) number of path sets in each batch, for ranges (R, 2)."""
    cycles, rest = np.divmod(ranges, BLOCK * BATCHES)
    below = cycles[..., None] * BLOCK + np.clip(rest[..., None] - BLOCK * np.arange(BATCHES), 0, BLOCK)
    counts: NDArray[np.int64] = (below[:, 1] - below[:, 0]).sum(axis=0)
    return counts
