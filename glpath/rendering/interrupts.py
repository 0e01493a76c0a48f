"""Ctrl-C during a render: the path sets that are done are kept."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from glpath.errors import kept_in
from glpath.film.film import Film
from glpath.system.signals import ENDING, REPEATED

# Seconds that an unfinished path set has to end after SIGTERM or another signal of `TERMINATING`. Who sends them
# ends the process for good soon: containers after ten seconds, Slurm after thirty.
_GRACE = 4.0


class RenderInterrupted(KeyboardInterrupt):
    """Ctrl-C came during a render. `film` holds all whole path sets done until then.

    number : of the signal that ended it; SIGINT, Ctrl-C, also where that was raised as an exception
    """

    number: int = signal.SIGINT

    def __init__(self, film: Film, number: int = signal.SIGINT) -> None:
        kept = kept_in("RenderInterrupted", "film", "render(..., film=film)") if film.path_sets else ""
        super().__init__(f"interrupted after {film.path_sets} path sets{kept}")
        self.film = film
        self.number = number


class Flag:
    """Truth that a signal handler can set.

    signal : the first that came
    """

    def __init__(self) -> None:
        self.set = False
        self.signal: int = signal.SIGINT
        self._hurry = threading.Timer(_GRACE, self._hurry_up)
        self._hurry.daemon = True
        self._late = False
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

    def close(self) -> None:
        """Nothing is left to be hurried."""
        self._hurry.cancel()

    def _hurry_up(self) -> None:
        """Send the signal again, to break into the path set that is not done in time."""
        self._late = True
        os.kill(os.getpid(), self.signal)

    def signalled(self, number: int, break_in: Callable[[], object]) -> None:
        """Note a signal. From the second one on call `break_in`, except for a signal that the system repeats."""
        if self.set and number in REPEATED and not self._late:
            return
        if not self.set:
            self.signal = number
            if number != signal.SIGINT:
                self._hurry.start()
        if self.set and self._whole:
            self._break_in = break_in
        elif self.set:
            break_in()
        self.set = True


@contextmanager
def interrupt_as_flag() -> Iterator[Flag]:
    """Ctrl-C sets a flag instead of breaking into the middle of a path set; a second one breaks in.

    The same holds for each signal of `TERMINATING` that is handled in Python, as the command line does; a shell
    starts background jobs with SIGINT ignored, so none stands for another. Only the main thread gets signals,
    elsewhere this does nothing.
    """
    flag = Flag()
    before = {number: signal.getsignal(number) for number in ENDING}
    if threading.current_thread() is not threading.main_thread():
        before = {}

    def stop(number: int, frame: FrameType | None) -> None:
        flag.signalled(number, lambda: handled[signal.Signals(number)](number, frame))

    handled = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handled:
        signal.signal(number, stop)
    try:
        yield flag
    finally:
        flag.close()
        for number, handler in handled.items():
            signal.signal(number, handler)
