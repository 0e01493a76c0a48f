"""How benches and figures time.

Times on a shared machine drift by more than what is to be told apart. So the contestants take turns within one run,
and the median of their times counts.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping


def seconds_of(work: Callable[[], object], finish: Callable[[], object] = lambda: None) -> float:
    """Wall time of one call. `finish` (a context's, which draws later than it is told to) runs on both sides."""
    finish()
    start = time.perf_counter()
    work()
    finish()
    return time.perf_counter() - start


def in_turns(
    contestants: Mapping[str, Callable[[], float]], rounds: int, *, min_rounds: int = 1, enough_s: float = math.inf
) -> dict[str, float]:
    """Median of what each contestant returns, seconds of one run, when they take turns, `rounds` times.

    min_rounds, enough_s : from `min_rounds` on, no further one starts when all so far took so long
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    started = time.perf_counter()
    for done in range(rounds):
        if done >= min_rounds and time.perf_counter() - started >= enough_s:
            break
        for name, contestant in contestants.items():
            times[name].append(contestant())
    return {name: statistics.median(each) for name, each in times.items()}
