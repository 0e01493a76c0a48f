"""Heartbeat of a process: finished pieces of work are reported here, so that a watchdog notices when they stop."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Heartbeat:
    """Source of beats: one for each submitted draw, finished path set or solver step.

    listener : function called with False at each beat, and with True when beats pause; or None
    """

    def __init__(self) -> None:
        self.listener: Callable[[bool], object] | None = None

    def beat(self) -> None:
        if self.listener is not None:
            self.listener(False)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Context of work that may take long without a beat, such as writing to a slow disk."""
        if self.listener is not None:
            self.listener(True)
        try:
            yield
        finally:
            self.beat()


#: Heartbeat of this process, which has one context and one render at a time.
heartbeat = Heartbeat()
