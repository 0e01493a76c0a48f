"""Ctrl-C during a render: the path sets that are done are kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from glpath.film import Film


class RenderInterrupted(KeyboardInterrupt):
    """Ctrl-C came during a render. `film` holds all whole path sets done until then."""

    def __init__(self, film: Film) -> None:
        super().__init__(f"interrupted after {film.path_sets} path sets")
        self.film = film


class Flag:
    """Truth that a signal handler can set."""

    def __init__(self) -> None:
        self.set = False
        self._break_in: Callable[[], object] | None = None
        self._whole = False

    def __bool__(self) -> bool:
        return self.set

    @contextmanager
    def whole(self) -> Iterator[None]:
        """A block that no second signal breaks into; it breaks in after it."""
        self._whole = True
        try:
            yield
        finally:
            self._whole = False
        if self._break_in is not None:
            self._break_in()

    def signalled(self, break_in: Callable[[], object]) -> None:
        """A signal has come; of the second one on, `break_in` is called."""
        if self.set and self._whole:
            self._break_in = break_in
        elif self.set:
            break_in()
        self.set = True


@contextmanager
def interrupt_as_flag() -> Iterator[Flag]:
    """Ctrl-C sets a flag instead of breaking into the middle of a path set; a second one breaks in.

    The same holds for SIGTERM where somebody handles it in Python, as the command line does; a shell starts
    background jobs with SIGINT ignored, so neither stands for the other. Only the main thread gets signals,
    elsewhere this does nothing.
    """
    flag = Flag()
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    if threading.current_thread() is not threading.main_thread():
        before = {}

    def stop(number: int, frame: FrameType | None) -> None:
        flag.signalled(lambda: handled[signal.Signals(number)](number, frame))

    handled = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handled:
        signal.signal(number, stop)
    try:
        yield flag
    finally:
        for number, handler in handled.items():
            signal.signal(number, handler)
