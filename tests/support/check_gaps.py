"""Processor time between checks of the time limit."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from glpath.system import time_limit


@contextmanager
def check_gaps(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """Yield a list, to which the processor seconds between successive checks in the block are appended.

    The first gap begins with the block, and the last ends with it.
    """
    gaps: list[float] = []
    before = time.process_time()

    def perf_counter() -> float:
        """Record the gap before this check; each check of a limit reads the clock once."""
        nonlocal before
        now = time.process_time()
        gaps.append(now - before)
        before = now
        return time.perf_counter()

    with monkeypatch.context() as patch, time_limit.limited(1e6):
        patch.setattr(time_limit, "time", SimpleNamespace(perf_counter=perf_counter))
        before = time.process_time()
        yield gaps
        time_limit.check_time("ending the block")
