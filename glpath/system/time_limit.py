"""The time limit of a command or a call, which all long work before the first path set asks.

    with limited(2.0):
        ...
        check_time("building the BVH")

Work without which there is no result calls `check_time` between its parts. It has a second more than the limit.
Work that only makes a result better stands in `part_of_time`, and asks `time_is_up` where it may be cut short.

Cost:     a check takes 0.2 microseconds.
Poor at:  single calls of a driver or of a library that take longer than a second: nothing can end them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

from glpath.errors import TimeLimitError, UsageError
from glpath.system.machine import posix_module

_os = posix_module("posix")

#: Seconds after the limit for work without which there is no result.
GRACE = 1.0
#: Share of the time left that a part of the work may take.
PART = 0.5


@dataclass
class _Limit:
    """A time limit that runs.

    seconds : the limit as it was given
    began   : since when it counts, by `time.perf_counter`
    ends    : when it is over
    grace   : seconds after that for work that must be done
    """

    seconds: float
    began: float
    ends: float
    grace: float


# A thread begins without a limit: each render asks for the limit of its own call.
_limit: ContextVar[_Limit | None] = ContextVar("time_limit", default=None)
# When the process's command began, by `time.perf_counter`; None if it is not the process's only one.
_command_began: float | None = None


@contextmanager
def command_clock() -> Iterator[None]:
    """Context of this process's command, whose time limit counts from the start of the process."""
    global _command_began
    _command_began = time.perf_counter() - _process_age()
    try:
        yield
    finally:
        _command_began = None


def _process_age() -> float:
    """Seconds since this process started; 0 if the system does not tell."""
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        assert _os is not None, "there is a /proc"
        age: float = time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / _os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError, AssertionError):
        return 0.0
    return max(0.0, age)


def check_time_limit(seconds: object) -> None:
    """Raise UsageError unless a time limit is None or a finite number of seconds above 0."""
    with suppress(OverflowError):  # an integer may be too large
        is_number = isinstance(seconds, Real) and not isinstance(seconds, bool)
        if seconds is None or (is_number and 0 < float(seconds) < math.inf):  # type: ignore[arg-type]
            return
    raise UsageError(f"time_limit={seconds!r}: must be a finite number of seconds above 0.", "None is no limit.")


@contextmanager
def limited(seconds: float | None, *, anew: bool = False) -> Iterator[None]:
    """Context with a time limit, which counts from here, or from the start of the process's command.

    Within another limit nothing changes: the outermost call's limit holds.

    seconds : None for no limit; the time counts all the same, see `counted_from`
    anew    : count from here, also within another limit and in a command: one frame of many

    Raises UsageError as `check_time_limit`.
    """
    check_time_limit(seconds)
    outer = _limit.get()
    if outer is not None and not anew and (seconds is None or outer.seconds < math.inf):
        yield
        return
    seconds = math.inf if seconds is None else float(seconds)
    now = time.perf_counter()
    began = now if anew or _command_began is None else _command_began
    with _set(_Limit(seconds, began, began + seconds, GRACE)):
        yield


@contextmanager
def part_of_time(*, required: bool = False) -> Iterator[None]:
    """Context of work that has `PART` of the time left as its limit.

    required : False for work that may be left out: `check_time` within raises TimeLimitError, which the caller
               catches, when its part is over; True for work that may be cut short, but not left out
    """
    limit = _limit.get()
    if limit is None or limit.ends == math.inf:
        yield
        return
    later = (1 - PART) * max(0.0, limit.ends - time.perf_counter())
    with _set(_Limit(limit.seconds, limit.began, limit.ends - later, limit.grace + later if required else 0.0)):
        yield


@contextmanager
def without_limit() -> Iterator[None]:
    """Context of work that makes a result of what is computed already, and has no limit."""
    with _set(None):
        yield


def lift_limit() -> None:
    """End the limit: the result is there, and what follows, such as denoising and writing, does not count."""
    limit = _limit.get()
    if limit is not None:
        limit.ends = math.inf


@contextmanager
def _set(limit: _Limit | None) -> Iterator[None]:
    token = _limit.set(limit)
    try:
        yield
    finally:
        _limit.reset(token)


def count_earlier(seconds: float) -> None:
    """Count seconds of an earlier run, whose result this one resumes."""
    limit = _limit.get()
    if limit is not None:
        limit.ends -= seconds


def counted_from() -> float:
    """Return since when the time of the outermost call counts, by `time.perf_counter`; now outside of any call."""
    limit = _limit.get()
    return time.perf_counter() if limit is None else limit.began


def seconds_left() -> float:
    """Return the seconds until the limit, negative after it; infinity without a limit."""
    limit = _limit.get()
    return math.inf if limit is None else limit.ends - time.perf_counter()


def time_is_up() -> bool:
    """Return True if the limit is over."""
    return seconds_left() <= 0


def check_time(doing: str) -> None:
    """Raise TimeLimitError if the limit and its grace are over.

    doing : what is being done, for the message: "building the BVH"
    """
    limit = _limit.get()
    if limit is None or time.perf_counter() < limit.ends + limit.grace:
        return
    raise TimeLimitError(
        f"time_limit={limit.seconds:g}: over while {doing}, before there was a result.",
        "Give it more time.",
    )
