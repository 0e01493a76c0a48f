"""xatlas' atlases, whose end does not wait for ever.

An atlas has threads, and ends them when it is deleted: it wakes them without their mutex. A thread that has found
nothing to do and is not asleep yet then sleeps for ever, and the process with it (xatlas 0.0.11, seen once in some
thousand lightmaps). So an atlas is not let go before its threads sleep.

Poor at:  other systems than Linux, where it waits for a fixed time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_TASKS = Path("/proc/self/task")
_PAUSE, _PATIENCE = 0.0005, 0.25  # seconds


@contextmanager
def atlas_of(xatlas: Any) -> Iterator[Any]:
    """An atlas to fill and to read; it is not used after the block."""
    before = _threads()
    made = xatlas.Atlas()
    try:
        yield made
    finally:
        until_asleep(_threads() - before)


def until_asleep(threads: set[str]) -> None:
    """Wait until none of these threads of the process, by their numbers, runs: a quarter of a second at most."""
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
    except OSError:  # it has ended
        return False
    return state != "S"
