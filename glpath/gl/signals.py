"""Delay of Ctrl-C while a function runs that it must not interrupt.

Python handles signals at the start of a function. So a signal can interrupt an `__exit__` written in Python before
its first line, and the resource is never released. C libraries that call Python may crash if a signal interrupts
the callback. Here handlers wait for the end of such a function. They act in the main thread, the only one that gets
signals.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any

from glpath.system.signals import ENDING


class SignalsWait:
    """Delay of signals between `begin` and `end`, if they arrive while a function with the code `code` runs."""

    def __init__(self, code: CodeType) -> None:
        self._code = code
        self._before: dict[signal.Signals, Callable[[int, FrameType | None], Any]] = {}
        self._came: list[int] = []

    def begin(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        for number in ENDING:
            handler = signal.getsignal(number)
            if callable(handler):
                self._before[number] = handler
                signal.signal(number, self._handle)

    def end(self) -> None:
        """Restore the earlier handlers, and raise the delayed signals. May be called in any thread."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()
        came, self._came[:] = self._came[:], []
        for each in came:
            signal.raise_signal(each)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        within = frame
        while within is not None:
            if within.f_code is self._code:
                self._came.append(number)
                return
            within = within.f_back
        self._before[signal.Signals(number)](number, frame)
