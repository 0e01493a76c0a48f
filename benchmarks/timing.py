"""Timing of benches and figures.

On a shared machine, times drift by more than the differences to detect. So contestants take turns within one run,
and the median of their times counts.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping


def seconds_of(work: Callable[[], object], finish: Callable[[], object] = lambda: None) -> float:
    """Return the wall time of a call. `finish` runs before and after, to wait for a context's deferred drawing."""
    finish()
    start = time.perf_counter()
    work()
    finish()
    return time.perf_counter() - start


def in_turns(
    contestants: Mapping[str, Callable[[], float]], rounds: int, *, min_rounds: int = 1, enough_s: float = math.inf
) -> dict[str, float]:
    """Run the contestants in turns, `rounds` times; return the median of the seconds that each returns.

    min_rounds, enough_s : after `min_rounds` rounds, start no further one if they took this many seconds in total
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    started = time.perf_counter()
    for done in range(rounds):
        if done >= min_rounds and time.perf_counter() - started >= enough_s:
            break
        for name, contestant in contestants.items():
            times[name].append(contestant())
    return {name: statistics.median(each) for name, each in times.items()}
