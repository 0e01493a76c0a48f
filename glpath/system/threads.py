"""Threads for work that releases Python's lock, such as kernels."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from glpath.system.heartbeat import heartbeat
from glpath.system.machine import core_count
from glpath.system.time_limit import check_time, overdue, seconds_to_error

#: Flag (1,) that ends work early: a kernel that finds it set returns at once, with meaningless results.
Stop = NDArray[np.int64]

# Interval between checks of the time after a wait that ended too early, seconds.
_EARLY_S = 0.005


class StoppedError(Exception):
    """Raised by work in Python when it finds its flag set."""


@contextmanager
def worker_threads(*stops: Stop, doing: str | None = None, timed: bool = True) -> Iterator[ThreadPoolExecutor]:
    """Context with a pool of one thread per core, whose work ends early with an exception or the time limit.

    Without flags, an exception such as KeyboardInterrupt would leave the block only when running work is done.

    stops : flags of the work. They are set when an exception leaves the block, and when the time limit and its
            grace are over; results are then meaningless. At the end of the block they are 0 again
    doing : as for `check_time`, which is called at the start of the block, and at its end if the time was over
    timed : False if only an exception ends the work, and no time limit

    Raises TimeLimitError.
    """

    def set_all() -> None:
        for stop in stops:
            stop[0] = 1

    def set_in_time() -> None:
        while is_over() is None:  # a system may end a wait too early
            if timer is None or timer.finished.wait(_EARLY_S):
                return
        set_all()

    if timed:
        check_time(doing)
    left = seconds_to_error(doing) if timed else math.inf
    is_over = overdue(doing)
    timer = threading.Timer(max(left, 0.0), set_in_time) if left < threading.TIMEOUT_MAX else None
    try:
        with ThreadPoolExecutor(core_count()) as pool:
            try:
                if timer is not None:
                    timer.daemon = True
                    timer.start()
                yield pool
            except StoppedError:
                check_time(doing)
                raise
            except BaseException:
                set_all()
                pool.shutdown(wait=False, cancel_futures=True)
                raise
            finally:
                if timer is not None:
                    timer.cancel()
                    if timer.ident is not None:  # an exception may come before it starts
                        timer.join()
        if any(stop[0] for stop in stops):
            check_time(doing)
    finally:
        for stop in stops:
            stop[0] = 0


def in_threads(count: int, size: int, work: Callable[[int, int], object], *stops: Stop) -> None:
    """Call `work(begin, end)` for ranges of up to `size` that cover 0 to `count`, in one thread per core.

    stops : as for `worker_threads`

    Raises TimeLimitError inside `named_work`.
    """
    begins = range(0, count, size)
    if len(begins) < 2 and not stops:
        for begin in begins:
            work(begin, count)
        return
    with worker_threads(*stops) as pool:
        for _ in pool.map(lambda begin: work(begin, min(begin + size, count)), begins):
            heartbeat.beat()
            check_time()
