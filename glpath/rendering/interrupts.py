"""Handling of Ctrl-C during a render, which keeps the finished path sets."""

from __future__ import annotations

import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType

from glpath.errors import kept_in
from glpath.film.film import Film
from glpath.system.signals import ENDING, RECORDS, REPEATED

# Maximum time, in seconds, for the current path set to end after a terminating signal, such as SIGTERM. The sender
# kills the process soon after: containers after ten seconds, Slurm after thirty.
_GRACE = 4.0
# Call that resumes a film, for the message of `RenderInterrupted`. `render_frames` takes no film.
_RESUME = "the same call with film=film (for a frame of render_frames: render)"


class RenderInterrupted(KeyboardInterrupt):
    """Exception for Ctrl-C during a render; `film` holds all complete path sets.

    number : number of the signal that ended the render; SIGINT also for a KeyboardInterrupt
    """

    number: int = signal.SIGINT

    def __init__(self, film: Film, number: int = signal.SIGINT) -> None:
        kept = kept_in("RenderInterrupted", "film", _RESUME) if film.path_sets else ""
        super().__init__(f"interrupted after {film.path_sets} path sets{kept}")
        self.film = film
        self.number = number


class Flag:
    """Boolean flag that a signal handler sets.

    signal : number of the first signal that arrived
    """

    def __init__(self) -> None:
        self.set = False
        self.signal: int = signal.SIGINT
        # True: a signal came; False: the block has ended. A handler may interrupt `put`, but not a lock.
        self._events: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._late = False
        self._waiting: list[Callable[[], object]] = []  # calls that wait for the end of `whole`
        self._whole = False

    def __bool__(self) -> bool:
        return self.set

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Context that no signal interrupts; handlers and the interruption by a second signal follow after it."""
        self._whole = True
        try:
            yield
        finally:
            self._whole = False
            with ExitStack() as calls:  # calls all, even if one raises
                while self._waiting:
                    calls.callback(self._waiting.pop())

    def call(self, handler: Callable[[], object]) -> None:
        """Call the handler of a signal, after the block of `whole` if that runs."""
        if self._whole:
            self._waiting.append(handler)
        else:
            handler()

    def limit_path_set(self) -> None:
        """Start the thread that interrupts a slow path set; a signal handler cannot start one safely."""
        threading.Thread(target=self._hurry_up, daemon=True).start()

    def close(self) -> None:
        """End the thread that interrupts slow path sets."""
        self._events.put(False)

    def _hurry_up(self) -> None:
        """Send the signal again, to interrupt a path set that did not end in time."""
        if not self._events.get():
            return
        try:
            self._events.get(timeout=_GRACE)
        except queue.Empty:
            self._late = True
            os.kill(os.getpid(), self.signal)

    def signalled(self, number: int, break_in: Callable[[], object]) -> None:
        """Record a signal. From the second one on, call `break_in`, unless the system itself repeats the signal.

        Another signal may interrupt any call below, so the fields are set before the first call.
        """
        if not self.set:
            self.set, self.signal = True, number
            if number != signal.SIGINT:
                self._events.put(True)
        elif number in REPEATED and not self._late:
            return
        else:
            self.call(break_in)


def _is_of_asyncio(handler: object) -> bool:
    """Return True for the handler of Ctrl-C that `asyncio.run` installs, which only cancels the task."""
    return getattr(getattr(handler, "func", None), "__module__", "") == "asyncio.runners"


@contextmanager
def interrupt_as_flag() -> Iterator[Flag]:
    """Context in which Ctrl-C sets a flag instead of interrupting a path set; a second Ctrl-C interrupts.

    The same applies to each signal of `TERMINATING` if the command line has installed its handler, and to Ctrl-C
    within `asyncio.run`. A handler that another program has installed is called as usual, but never while path sets
    are added to a film. Each signal has
    its own handler, because a shell starts background jobs with SIGINT ignored. In other threads than the main
    thread, which get no signals, it has no effect.
    After a signal, a command's further signals wait, because the command then cleans up and saves its result.
    """
    flag = Flag()
    before = {number: signal.getsignal(number) for number in ENDING}
    if threading.current_thread() is not threading.main_thread():
        before = {}

    def stop(number: int, frame: FrameType | None) -> None:
        for command in RECORDS:
            command.record(number)
        flag.signalled(number, lambda: handled[signal.Signals(number)](number, frame))

    def pass_on(number: int, frame: FrameType | None) -> None:
        flag.call(lambda: others[signal.Signals(number)](number, frame))

    handlers = {number: handler for number, handler in before.items() if callable(handler)}
    handled = {
        number: handler
        for number, handler in handlers.items()
        if RECORDS or handler is signal.default_int_handler or _is_of_asyncio(handler)
    }
    others = {number: handler for number, handler in handlers.items() if number not in handled}
    for command in RECORDS if handled else ():
        # A signal that came after the last check of an earlier flag ends this computation.
        if command.first is not None:
            flag.set, flag.signal = True, command.first
    if handled.keys() - {signal.SIGINT}:
        flag.limit_path_set()
    for number in handlers:
        signal.signal(number, stop if number in handled else pass_on)
    try:
        yield flag
    finally:
        flag.close()
        for command in RECORDS if flag else ():
            command.held = True
        for number, handler in handlers.items():
            if signal.getsignal(number) in (stop, pass_on):  # otherwise a handler has installed another one
                signal.signal(number, handler)
