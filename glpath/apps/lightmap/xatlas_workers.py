"""Atlases of xatlas that are deleted without a deadlock.

The destructor of an atlas wakes its worker threads to end them, but does not lock their mutex. A thread that has
found no work and does not sleep yet misses the wake-up and sleeps for ever, so the destructor never returns. This
happened once in some thousand lightmaps with xatlas 0.0.11. An atlas is therefore deleted only when its threads
sleep.

Poor at:  systems other than Linux, which get a fixed waiting time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_TASKS = Path("/proc/self/task")
_PAUSE = 0.0005  # time between two looks at the threads, seconds
_PATIENCE = 0.25  # maximum time to wait for the threads, seconds


@contextmanager
def atlas_of(xatlas: Any) -> Iterator[Any]:
    """Context with a new atlas, which must not be used after the block."""
    before = _threads()
    made = xatlas.Atlas()
    try:
        yield made
    finally:
        until_asleep(_threads() - before)


def until_asleep(threads: set[str]) -> None:
    """Wait until all these threads of the process sleep, but at most for a quarter of a second.

    threads : identifiers of the threads
    """
    if not _TASKS.exists():
        time.sleep(20 * _PAUSE)
        return
    end = time.monotonic() + _PATIENCE
    while any(map(_runs, threads)) and time.monotonic() < end:
        time.sleep(_PAUSE)


def _threads() -> set[str]:
    return {path.name for path in _TASKS.iterdir()} if _TASKS.exists() else set()


def _runs(thread: str) -> bool:
    try:
        state = (_TASKS / thread / "stat").read_text().rpartition(")")[2].split()[0]
    except OSError:  # the thread has ended
        return False
    return state != "S"
