"""Which path sets a film holds, and in which of its batches: by their numbers alone.

Sums are kept apart in batches, since the paths of a set may share directions or points of a sequence: neighbouring
pixels err together. Which batch a set belongs to follows from its number, so that any ranges merge.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError

# Path set i belongs to batch (i // BLOCK) % BATCHES. A block of 8 keeps neighbouring points of a Sobol sequence
# together, which stratify each other; 8 batches give the standard error to about a quarter.
BLOCK = 8
BATCHES = 8
# The end of all path sets of a file, far beyond what can be rendered: counts of them do not overflow.
_LAST_PATH_SET = 1 << 48


def batch_of(path_set: int) -> int:
    """The batch that a path set is summed in."""
    return path_set // BLOCK % BATCHES


def blocks(start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Split the path sets start..stop (half-open) where the batch changes: the ranges that `Film.add` takes."""
    while start < stop:
        end = min(stop, (start // BLOCK + 1) * BLOCK)
        yield start, end
        start = end


def united(ours: tuple[tuple[int, int], ...], theirs: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
    """All ranges in order, those that touch made one. Raises UsageError where they overlap."""
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
    """Whether (R, 2) ranges are as a film has them: none empty, in order, none touching the next."""
    starts, stops = ranges.T
    in_order = bool((starts < stops).all() and (stops[:-1] < starts[1:]).all())
    return in_order and (not len(ranges) or (starts[0] >= 0 and stops[-1] <= _LAST_PATH_SET))


def counts_of(ranges: NDArray[np.int64]) -> NDArray[np.int64]:
    """(BATCHES,) how many path sets of (R, 2) ranges belong to each batch."""
    cycles, rest = np.divmod(ranges, BLOCK * BATCHES)
    below = cycles[..., None] * BLOCK + np.clip(rest[..., None] - BLOCK * np.arange(BATCHES), 0, BLOCK)
    counts: NDArray[np.int64] = (below[:, 1] - below[:, 0]).sum(axis=0)
    return counts
