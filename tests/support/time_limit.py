"""A time limit that readers cannot take for an error of the file that they read."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def time_limit(seconds: int) -> Iterator[None]:
    """Fail the test if the block runs longer.

    The exception of `pytest.fail` is no subclass of Exception. A TimeoutError would be an OSError, which readers
    turn into the GlpathError that a test may expect.
    """

    def stop(*_: object) -> None:
        pytest.fail(f"the block did not end within {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
