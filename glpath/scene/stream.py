"""Streams of triangles that are never in memory all at once: each chunk is read again whenever it is needed.

Only the number of triangles and the box of each chunk are known in advance. Chunks outside a view are therefore not
read at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError, UsageError

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stream:
    """Triangles in chunks. A stream is equal only to itself.

    chunk  : function from a chunk's number to its corners (F, 3, 3) float64 in world space, counter-clockwise seen
             from the front; it returns the same corners on every call
    counts : (N,) int64, number of triangles of each chunk
    lower, upper : (N, 3) float64, corners of the boxes around the chunks, world space
    digest : SHA-256 (hex) of all triangles
    name   : name in error messages
    """

    chunk: Callable[[int], Float64]
    counts: NDArray[np.int64]
    lower: Float64
    upper: Float64
    digest: str
    name: str

    def triangles(self, number: int) -> Float64:
        """Return the (F, 3, 3) float64 corners of a chunk in world space.

        Raises SceneError if their number has changed.
        """
        found = self.chunk(number)
        if len(found) != self.counts[number]:
            raise SceneError(
                f"{self.name}: chunk {number} had {self.counts[number]:,} triangles when the scene was made, and "
                f"now has {len(found):,}.",
                "A stream is asked for its chunks many times, and must give the same ones each time.",
            )
        return found

    def __iter__(self) -> Iterator[Float64]:
        """Yield the triangles of each chunk."""
        return map(self.triangles, range(len(self.counts)))

    @property
    def count(self) -> int:
        """Number of triangles."""
        return int(self.counts.sum())

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """Lower corner (3,) and upper corner (3,) of the box around all triangles."""
        return self.lower.min(axis=0), self.upper.max(axis=0)


def triangles_in_budget(counts: NDArray[np.int64], budget: int, each: int, reading: int) -> int:
    """Return the maximum number of triangles in a part of a stream that is prepared for rays at once.

    counts  : (N,) number of triangles of each chunk
    budget  : MiB for the whole part
    each    : bytes per triangle of the part
    reading : additional bytes per triangle of the chunk that is being read

    Raises UsageError if the budget is too small for the largest chunk.
    """
    largest = int(counts.max())
    needed = (each + reading) * largest
    if needed > budget << 20:
        raise UsageError(
            f"geometry_budget: {budget} MiB, but {-(-needed // (1 << 20))} are needed for a chunk of "
            f"{largest:,} triangles and its BVH.",
            "Give it more, or stream smaller chunks.",
        )
    return ((budget << 20) - reading * largest) // each
