"""A clock of time limits that tests advance, so that no test waits or depends on the machine's speed."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest

from glpath.system import time_limit


class Clock:
    """The clock that time limits read. It advances only if a test says so.

    ahead  : seconds since its creation
    module : replacement of `time` for a module that measures its own work
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ahead = 0.0
        self.stopped = time.perf_counter()
        self.module = SimpleNamespace(perf_counter=lambda: self.stopped + self.ahead)
        monkeypatch.setattr(time_limit, "time", self.module)
        monkeypatch.setattr(time_limit, "_command_began", None)
