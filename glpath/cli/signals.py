"""Handling of signals that end a command (SIGINT, SIGTERM, SIGHUP, ...), so that its results are saved first.

The first signal ends the computation by a KeyboardInterrupt. Further signals wait until the command has saved its
result and ended. If a result exists already (`hold`), the first signal waits as well. The third waiting signal ends
the command without saving. A signal that was ignored when the process started stays ignored, such as SIGHUP under
nohup.

Python drops exceptions that are raised in some functions, such as finalizers. A dropped KeyboardInterrupt is raised
again after `_AGAIN_S`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

from glpath.system.report_pipe import write_report
from glpath.system.signals import RECORDS, REPEATED, TERMINATING, SignalRecord

T = TypeVar("T")

#: Exit code of a command that Ctrl-C has ended.
INTERRUPTED = 130
#: Exit code of a command that a scheduler has ended and can resume (EX_TEMPFAIL of sysexits.h).
RESUME_LATER = 75

_PATIENCE = 3
# Time until a dropped KeyboardInterrupt is raised again, seconds.
_AGAIN_S = 0.05


class _Signals(SignalRecord):
    """State of signal handling during one command."""

    def __init__(self) -> None:
        self.resumable = False
        self._waiting = 0
        self.unraisablehook = sys.unraisablehook  # hook to restore after the command

    def __call__(self, number: int, frame: FrameType | None) -> None:
        again = self.first is not None
        self.record(number)
        if not self.held:
            self.held = True
            raise KeyboardInterrupt
        if again and number in REPEATED:
            return
        self._waiting += 1
        left = _PATIENCE - self._waiting
        if left <= 0:
            raise KeyboardInterrupt
        text = f"glpath: saving what there is; to give that up, interrupt {'once' if left == 1 else 'twice'} more\n"
        with contextlib.suppress(OSError):
            write_report(2, text.encode())  # print is not safe in a signal handler

    def on_dropped(self, dropped: sys.UnraisableHookArgs) -> None:
        """Handle an exception that Python drops: raise a KeyboardInterrupt again later, and report any other."""
        in_main = threading.current_thread() is threading.main_thread()
        if self.first is None or not in_main or not issubclass(dropped.exc_type, KeyboardInterrupt):
            self.unraisablehook(dropped)
            return
        self.held = False
        signal.signal(signal.SIGALRM, self.raise_again)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)

    def raise_again(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt, unless the command has ended or made a result since the drop."""
        if not self.held and self in RECORDS:
            self.held = True
            raise KeyboardInterrupt


# State of the command in the main thread; a process has one set of handlers.
_current = _Signals()


def asks_to_resume(words: Iterable[str]) -> bool:
    """Return True if a command line has --checkpoint or --resume, so that a scheduler may start it again.

    Only the words are needed, because loading the command's modules takes longer than some schedulers wait.
    """
    return any(word.partition("=")[0] in ("--checkpoint", "--resume") for word in words)


def resume_later_while_loading() -> None:
    """Let a scheduler's signal end the process with `RESUME_LATER`, until `signals_wait_for_results` is called."""
    for number in TERMINATING:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _end_while_loading)


def _end_while_loading(number: int, frame: FrameType | None) -> None:
    with contextlib.suppress(OSError):
        write_report(2, b"glpath: ended by a signal before anything was done; start it again\n")
    os._exit(RESUME_LATER)


@contextmanager
def signals_wait_for_results(resumable: bool = False) -> Iterator[None]:
    """Context of a command, in which signals wait while a result is saved. No effect outside the main thread.

    The first signal raises KeyboardInterrupt, unless `hold` or `result_of` has reported a result. Further signals
    wait until `release` is called or the block ends.

    resumable : True if the exit code after a scheduler's signal is `RESUME_LATER`, as after `resume_later`
    """
    global _current
    _current = _Signals()
    _current.resumable = resumable
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Signals ignored at the start stay ignored: SIGINT in background jobs of a shell, SIGHUP under nohup.
    before = {number: signal.getsignal(number) for number in TERMINATING}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}
    for number, handler in before.items():
        if handler is _end_while_loading:
            before[number] = signal.SIG_DFL  # after the block, nothing is left to resume
    if callable(on_interrupt := signal.getsignal(signal.SIGINT)):
        before[signal.SIGINT] = on_interrupt
    for number in before:
        signal.signal(number, _current)
    if hasattr(signal, "setitimer"):
        sys.unraisablehook = _current.on_dropped
    RECORDS.append(_current)
    try:
        yield
    finally:
        RECORDS.pop()
        sys.unraisablehook = _current.unraisablehook
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def hold() -> None:
    """Let signals wait from here on, because there is a result to save."""
    _current.held = True


def release() -> None:
    """Let signals end the command again, because the result is saved; a waiting signal ends it now."""
    _current.held = False
    if _current.first is not None:
        raise KeyboardInterrupt


def interrupted(number: int = signal.SIGINT) -> None:
    """Record a signal that other code handled by returning a partial result, and let further signals wait."""
    _current.record(number)
    _current.held = True


def arrived() -> bool:
    """Return True if a signal came since the command began."""
    return _current.first is not None


def by_scheduler() -> bool:
    """Return True if the first signal was one with which schedulers end processes (`TERMINATING`), not Ctrl-C."""
    return _current.first in TERMINATING


def resume_later() -> None:
    """Set the exit code to `RESUME_LATER` if a scheduler ends the command after this call."""
    _current.resumable = True


def exit_code() -> int:
    """Return the exit code of a command that a signal has ended."""
    return RESUME_LATER if _current.resumable and by_scheduler() else INTERRUPTED


def forget() -> None:
    """Forget the signal that came, because all work is done and saved."""
    _current.first = None


def result_of(compute: Callable[[], T]) -> T:
    """Return the result of `compute`. Once the result exists, signals wait until the command has saved it."""
    results: list[T] = []
    try:
        results.append(compute())
        hold()
    except KeyboardInterrupt:
        if not results:
            raise
    return results[0]
