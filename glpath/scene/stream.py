"""Triangles that are never in memory all at once: they come chunk by chunk, as often as they are asked for.

What is known of them without asking is little: how many there are in each chunk, and the boxes around them, so that
chunks which a view cannot see are not asked for at all.
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
    """Triangles in chunks. Equal only to itself.

    chunk  : of a chunk's number, its corners (F, 3, 3) float64 in world space, counter-clockwise seen from the
             front; the same ones whenever it is asked
    counts : (N,) int64, triangles of each chunk
    lower, upper : (N, 3) float64, corners of the boxes around the chunks, world space
    digest : SHA-256 (hex) of all triangles
    name   : how errors call it
    """

    chunk: Callable[[int], Float64]
    counts: NDArray[np.int64]
    lower: Float64
    upper: Float64
    digest: str
    name: str

    def triangles(self, number: int) -> Float64:
        """(F, 3, 3) float64 corners of a chunk, world space. Raises SceneError where they are not as at first."""
        found = self.chunk(number)
        if len(found) != self.counts[number]:
            raise SceneError(
                f"{self.name}: chunk {number} had {self.counts[number]:,} triangles when the scene was made, and "
                f"now has {len(found):,}.",
                "A stream is asked for its chunks many times, and must give the same ones each time.",
            )
        return found

    def __iter__(self) -> Iterator[Float64]:
        """The triangles of chunk after chunk."""
        return map(self.triangles, range(len(self.counts)))

    @property
    def count(self) -> int:
        """How many triangles there are."""
        return int(self.counts.sum())

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(3,) lower and (3,) upper corner of the box around all triangles."""
        return self.lower.min(axis=0), self.upper.max(axis=0)


def triangles_in_budget(counts: NDArray[np.int64], budget: int, each: int, reading: int) -> int:
    """How many triangles a part of the chunks of streams may have that is made ready for rays.

    counts  : (N,) of the chunks
    budget  : MiB, for all of the part
    each    : bytes of one of its triangles; reading: and more of each of the chunk that is read

    Raises UsageError for a budget without room for the largest chunk.
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
