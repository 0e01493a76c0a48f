"""Heartbeat of a process: finished pieces of work are reported here, so that a watchdog notices when they stop."""

from __future__ import annotations

from collections.abc import Callable


class Heartbeat:
    """Source of beats: one for each submitted draw, finished path set or solver step.

    listener : function called at each beat, or None
    """

    def __init__(self) -> None:
        self.listener: Callable[[], object] | None = None

    def beat(self) -> None:
        if self.listener is not None:
            self.listener()


#: Heartbeat of this process, which has one context and one render at a time.
heartbeat = Heartbeat()
