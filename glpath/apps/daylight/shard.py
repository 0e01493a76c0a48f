"""Shard of a computation, which is a range of its sensors."""

from __future__ import annotations

from dataclasses import dataclass

from glpath.errors import UsageError
from glpath.system.arguments import short_repr


@dataclass(frozen=True)
class Shard:
    """Shard of a computation, which is a range of consecutive sensors.

    first : index of the first sensor
    total : number of sensors of the whole computation
    work  : SHA-256 (hex) of all inputs of the computation: scene, all sensors, directions, settings
    """

    first: int
    total: int
    work: str


def shard_range(shard: object, sensors: int) -> tuple[int, int]:
    """Return the half-open range (start, stop) of the sensors in a shard.

    shard   : (k, n) for shard k of n, with k from 1 to n
    sensors : number of sensors of the whole computation

    Raises UsageError for another `shard`, and for more shards than sensors.
    """
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
