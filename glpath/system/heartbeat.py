"""A sign of life: finished pieces of work are reported here, and a watchdog hears when none is any more."""

from __future__ import annotations

from collections.abc import Callable


class Heartbeat:
    """Of a process: beats for a draw that was handed over, a path set, a step of a solver.

    listener : called at each; None without one
    """

    def __init__(self) -> None:
        self.listener: Callable[[], object] | None = None

    def beat(self) -> None:
        if self.listener is not None:
            self.listener()


#: Of this process, which has one context and one render at a time.
heartbeat = Heartbeat()
