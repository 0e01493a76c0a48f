"""Which of the sensors of a computation a shard has."""

from __future__ import annotations

from dataclasses import dataclass

from glpath.errors import UsageError


@dataclass(frozen=True)
class Shard:
    """A range of sensors, from the first on.

    first : number of its first sensor
    total : sensors of the whole computation
    work  : SHA-256 (hex) of all that its numbers follow from: scene, all sensors, directions, settings
    """

    first: int
    total: int
    work: str


def shard_range(shard: object, sensors: int) -> tuple[int, int]:
    """The first sensor of shard (k, n), from 1, and the one after its last. Raises UsageError."""
    match shard:
        case (int(k), int(n)) if 1 <= k <= n:
            pass
        case _:
            k = n = 0
    if n == 0:
        raise UsageError(
            f"shard: {shard!r} where (k, n) with k from 1 to n is needed", "(1, 4) is the first of four."
        )
    if n > sensors:
        raise UsageError(f"shard: {n} shards of {sensors} sensors", "Give each shard a sensor at least.")
    return sensors * (k - 1) // n, sensors * k // n
