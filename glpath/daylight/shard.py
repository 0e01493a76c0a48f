"""Range of sensors that belongs to a shard of a computation."""

from __future__ import annotations

from dataclasses import dataclass

from glpath.errors import UsageError
from glpath.system.arguments import short_repr


@dataclass(frozen=True)
class Shard:
    """Consecutive sensors of a computation.

    first : index of the first sensor
    total : number of sensors of the whole computation
    work  : SHA-256 (hex) of all inputs of the computation: scene, all sensors, directions, settings
    """

    first: int
    total: int
    work: str


def shard_range(shard: object, sensors: int) -> tuple[int, int]:
    """Return the first sensor of shard (k, n), k from 1, and one past its last. Raises UsageError."""
    match shard:
        case (int(k), int(n)) if 1 <= k <= n:
            pass
        case _:
            k = n = 0
    if n == 0:
        raise UsageError(
            f"shard: {short_repr(shard)} where (k, n) with k from 1 to n is needed", "(1, 4) is the first of four."
        )
    if n > sensors:
        raise UsageError(f"shard: {n} shards of {sensors} sensors", "Give each shard a sensor at least.")
    return sensors * (k - 1) // n, sensors * k // n
