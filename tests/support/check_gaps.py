"""Processor time between checks of the time limit, and a large mesh for its measurement."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from glpath.system import time_limit


@contextmanager
def check_gaps(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """Yield a list, to which the processor seconds between successive checks in the block are appended.

    The first gap begins with the block, and the last ends with it. Garbage is collected before, because a
    collection in a worker with many tests takes longer than any gap.
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
        gc.collect()
        gc.disable()
        try:
            before = time.process_time()
            yield gaps
            time_limit.check_time("ending the block")
        finally:
            gc.enable()


def grid(side: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices (V, 3) and the faces (F, 3) of a wavy square."""
    x, z = (each.ravel() for each in np.meshgrid(*2 * [np.linspace(-2.0, 2.0, side + 1)]))
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    above = corner + side + 1
    faces = np.concatenate(
        [np.stack([corner, above, corner + 1], axis=1), np.stack([corner + 1, above, above + 1], axis=1)]
    )
    return np.stack([x, 0.2 * np.sin(3 * x) * np.cos(2 * z), z], axis=1), faces
