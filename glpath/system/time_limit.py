"""Time limit of a command or call. All long work before the first path set checks it.

    with limited(2.0):
        ...
        check_time("building the BVH")

Functions that several kinds of work call, such as parsers of numbers, do not name the work. They call
`check_time()`, which checks the time if a caller is inside `named_work("reading room.obj")`.

Work that is required for a result calls `check_time` between its parts. Such work gets one second more than the
limit. Work that only improves a result runs in `part_of_time`, and calls `time_is_up` if it can be cut short.

Cost:     a check takes 0.2 microseconds.
Poor at:  single calls of a driver or library that take longer than a second, because nothing can end them.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path

from glpath.errors import TimeLimitError, UsageError, argument

#: Time after the limit for work that is required for a result, seconds.
GRACE = 1.0
#: Fraction of the remaining time that `part_of_time` grants.
PART = 0.5
# Maximum difference between the age of this process and its processor time, seconds. If the difference is larger,
# a shell waited before it became this program by exec, because exec keeps the start time of the process.
_MAX_IDLE = 2.0


@dataclass
class _Limit:
    """Active time limit.

    seconds : limit given by the user, seconds
    began   : start of the limit, by `time.perf_counter`
    ends    : end of the limit, by `time.perf_counter`
    grace   : time after the end for required work, seconds
    resumes : True if the caller has the result of an earlier run
    """

    seconds: float
    began: float
    ends: float
    grace: float
    resumes: bool = False


# A context variable, because renders in different threads have different limits. A new thread has none.
_limit: ContextVar[_Limit | None] = ContextVar("time_limit", default=None)
# Work of the innermost `named_work`, such as "reading room.obj", for checks that do not name their work.
_work: ContextVar[str | None] = ContextVar("work", default=None)
# `time.perf_counter` at the start of the process, when its command begins; None outside `command_clock`.
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


def in_command() -> bool:
    """Return True if this process runs a glpath command, that is, inside `command_clock`."""
    return _command_began is not None


def _process_age() -> float:
    """Return the seconds since this process started, at most its processor time plus `_MAX_IDLE`.

    Returns 0 if the system does not report the start of the process.
    """
    try:
        fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
        age: float = time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0
    return min(max(0.0, age), time.process_time() + _MAX_IDLE)


def check_time_limit(seconds: object) -> None:
    """Raise UsageError unless a time limit is None or a finite number of seconds above 0."""
    with suppress(OverflowError):  # an integer may be too large
        is_number = isinstance(seconds, Real) and not isinstance(seconds, bool)
        if seconds is None or (is_number and 0 < float(seconds) < math.inf):  # type: ignore[arg-type]
            return
    raise UsageError(
        f"{argument('time_limit', seconds)}: must be a finite number of seconds above 0.", "None is no limit."
    )


@contextmanager
def limited(seconds: float | None, *, anew: bool = False, resumes: bool = False) -> Iterator[None]:
    """Context with a time limit, counted from the entry; inside `command_clock`, from the start of the process.

    Inside another limit, the limit of the outermost call applies. `lift_limit` and `count_earlier` then change it
    only until this context ends, because the outer call still needs it.

    seconds : time limit in seconds; None: no limit, but the time is still counted, see `counted_from`
    anew    : True for one of many frames: the limit applies even inside another limit or `command_clock`, and time
              counts from the entry
    resumes : True if the caller has the result of an earlier run, see `without_limit_if_resumed`

    Raises UsageError unless `seconds` is None or a finite number above 0.
    """
    check_time_limit(seconds)
    outer = _limit.get()
    if outer is not None and not anew and (seconds is None or outer.seconds < math.inf):
        with _set(replace(outer)):
            yield
        return
    seconds = math.inf if seconds is None else float(seconds)
    now = time.perf_counter()
    began = now if anew or _command_began is None else _command_began
    with _set(_Limit(seconds, began, began + seconds, GRACE, resumes)):
        yield


@contextmanager
def part_of_time(*, required: bool = False) -> Iterator[None]:
    """Context that limits its work to the fraction `PART` of the time left.

    required : False for work that may be left out. When its fraction is used up, `check_time` raises
               TimeLimitError, which the caller catches. True for work that may be cut short, but not left out
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
    """Context without a limit, for work that turns finished computations into a result."""
    with _set(None):
        yield


@contextmanager
def without_limit_if_resumed() -> Iterator[None]:
    """Context without a limit if the caller has the result of an earlier run.

    Otherwise the limit could end this work with an error, and the caller could not return that result.
    """
    limit = _limit.get()
    with without_limit() if limit is not None and limit.resumes else nullcontext():
        yield


def mark_resumed() -> None:
    """Record that the caller has the result of an earlier run, see `without_limit_if_resumed`."""
    limit = _limit.get()
    if limit is not None:
        limit.resumes = True


def lift_limit() -> None:
    """Remove the limit of the innermost `limited`, because none applies to work on a result, such as writing."""
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
    """Shorten the limit of the innermost `limited` by the seconds of an earlier run that this run resumes."""
    limit = _limit.get()
    if limit is not None:
        limit.ends -= seconds


def counted_from() -> float:
    """Return the time from which the active limit counts, by `time.perf_counter`; without a limit, the present."""
    limit = _limit.get()
    return time.perf_counter() if limit is None else limit.began


def seconds_left() -> float:
    """Return the seconds until the limit, negative after it; infinity without a limit."""
    limit = _limit.get()
    return math.inf if limit is None else limit.ends - time.perf_counter()


def seconds_to_error(doing: str | None = None) -> float:
    """Return the seconds after which `check_time(doing)` raises TimeLimitError; infinity if it never will."""
    limit = _limit.get()
    if limit is None or (doing or _work.get()) is None:
        return math.inf
    return limit.ends + limit.grace - time.perf_counter()


def time_is_up() -> bool:
    """Return True if the limit is over."""
    return seconds_left() <= 0


@contextmanager
def named_work(doing: str) -> Iterator[None]:
    """Context that names its work in the messages of checks; checks the time at its start and at its end."""
    token = _work.set(doing)
    try:
        check_time()
        yield
        check_time()
    finally:
        _work.reset(token)


@contextmanager
def preparing(what: str = "the scene") -> Iterator[None]:
    """Context for work before the first result, without a limit if the caller has the result of an earlier run.

    what : what is prepared, for messages
    """
    with without_limit_if_resumed(), named_work(f"preparing {what}"):
        yield


def has_limit() -> bool:
    """Return True if a limit is active."""
    return seconds_left() < math.inf


def overdue(doing: str | None = None, later: float = 0.0) -> Callable[[], TimeLimitError | None]:
    """Return a function that another thread can call. It returns the error of `check_time`, or None before that.

    later : seconds by which the error comes later than that of `check_time`
    """
    limit, work = _limit.get(), doing or _work.get()
    return lambda: None if limit is None or work is None else _error(limit, work, later=later)


def check_time(doing: str | None = None, estimate: float = 0.0) -> None:
    """Raise TimeLimitError if the limit and its grace are over, or will be when the next call returns.

    doing    : current work for the message, such as "building the BVH"; None: the work of the enclosing
               `named_work`. Without `doing` and outside of `named_work`, the time is not checked
    estimate : seconds that the next call will take at least, if nothing can end it
    """
    limit, doing = _limit.get(), doing or _work.get()
    if limit is not None and doing is not None and (error := _error(limit, doing, estimate)) is not None:
        raise error


def _error(limit: _Limit, doing: str, estimate: float = 0.0, later: float = 0.0) -> TimeLimitError | None:
    left = limit.ends + limit.grace + later - time.perf_counter()
    if left > estimate:
        return None
    over = f"over while {doing}, before there was a result"
    if left > 0:
        over = f"{doing} would take about {estimate:.2g} s, more than is left"
    return TimeLimitError(f"{argument('time_limit', limit.seconds)}: {over}.", "Give it more time.")
