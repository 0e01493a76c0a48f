"""Limits on the time and memory of reading a file, for any file format.

    with reading_file("room.obj"):
        content = read_bytes(path)
        ...

A damaged or malicious file can be small and still keep a parser busy for hours, or make it fill the memory. While
the outermost `reading_file` of a thread is active, a second thread samples the processor time of the reading thread
and the memory of the process. If one is above its limit, the second thread raises an exception in the reading
thread, as CPython allows between two bytecodes, and `reading_file` turns it into a GlpathError. If the
user gave a time limit, it ends reading in the same manner, and processor time has no limit. With the environment
variable GLPATH_TRUST_FILES=1, there are no limits but that.

Poor at:  single calls of a library that do not return, because nothing can end them; growth of memory by other
          threads, which counts for the reading thread.
"""

from __future__ import annotations

import contextvars
import ctypes
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path

from glpath.errors import GlpathError, ImageError, SceneError
from glpath.system.time_limit import has_limit, named_work, overdue, without_limit, without_limit_if_resumed

# Delay of the end by another thread after `check_time`, which names the work more exactly, seconds.
_LATER = 0.25
#: Processor time for reading: seconds, and seconds per byte of the files.
SECONDS = 5.0
_SECONDS_PER_BYTE = 1e-5  # the slowest readers, of TOML and XML, take 2.5 us
# The same for each byte of unfolded data, such as the pixels of a JPEG, which unfolds at 100 MB/s.
_SECONDS_PER_UNFOLDED_BYTE = 3e-8
#: Growth of memory during reading: bytes, and bytes per byte of the files.
MEMORY = 2**30
_MEMORY_PER_BYTE = 512  # a cloud of points takes the most, 220
# Time between two samples, and between two exceptions if the first had no effect, seconds.
_SAMPLE_S = 0.05
_AGAIN_S = 1.0
# Iterations of a loop after which an exception is raised for sure.
_ITERATIONS = 1000
_IF_RIGHT = "If it is right, set GLPATH_TRUST_FILES=1, which lifts such limits."
_PAGE = os.sysconf("SC_PAGESIZE") if hasattr(os, "sysconf") else 4096


class _Interrupted(BaseException):
    """Exception that ends reading. It is no Exception, because parsers may catch those."""


class _Bounds:
    """Limits of the reading thread, and the thread that enforces them.

    name      : file name for the error, whose class is `error_class`
    processor : limit of the thread's processor time in seconds; infinity: none
    memory    : limit of the process's memory in bytes
    bytes     : size of the files that were opened
    error     : error with which reading ended; None before
    own_data  : True for data that the caller made or holds in memory
    """

    def __init__(self, name: str, error_class: type[GlpathError], *, timed: bool, own_data: bool) -> None:
        self.name = name
        self.bytes = 0
        self._error_class = error_class
        self.error: GlpathError | None = None
        self._files: set[tuple[int, int]] = set()
        self._thread = threading.get_ident()
        self._overdue = overdue(f"reading {name}", later=_LATER)
        self._clock = _clock_of_this_thread()
        self.own_data = own_data
        trusted = own_data or os.environ.get("GLPATH_TRUST_FILES", "") == "1"
        self.processor = math.inf if trusted or timed else self._processor_time() + SECONDS
        self.memory = math.inf if trusted else _memory() + MEMORY
        self._paused = 0
        self._ended = False
        self._wake = threading.Lock()
        self._wake.acquire()
        self._watch = threading.Thread(target=self._sample, name="glpath reading", daemon=True)

    def begin(self) -> None:
        """Begin the samples."""
        self._watch.start()

    def _processor_time(self) -> float:
        return 0.0 if self._clock is None else time.clock_gettime(self._clock)

    def add_file(self, file: tuple[int, int], size: int) -> None:
        if file not in self._files:
            self._files.add(file)
            self.add_bytes(size)

    def add_bytes(self, size: int) -> None:
        self.bytes += size
        self.processor += _SECONDS_PER_BYTE * size
        self.memory += _MEMORY_PER_BYTE * size

    @contextmanager
    def pause(self) -> Iterator[None]:
        before = self._processor_time(), _memory()
        self._paused += 1
        try:
            yield
        finally:
            self.processor += self._processor_time() - before[0]
            self.memory += max(0, _memory() - before[1])
            self._paused -= 1

    def end(self) -> None:
        """End the samples. After it no exception is raised in the reading thread.

        An exception may be raised within this call, which the caller then repeats. So it uses only operations that
        an exception cannot interrupt halfway. It does not cancel an exception, because CPython 3.11 would then look
        for exceptions in every loop until the process ends, which takes time.
        """
        self._ended = True
        with suppress(RuntimeError):  # released by the interrupted call
            self._wake.release()
        if self._watch.is_alive():  # False if an interrupt came before it started
            self._watch.join()
        if self.error is not None:
            for _ in range(_ITERATIONS):  # a loop raises the exception, if it has not been raised yet
                pass

    def _sample(self) -> None:
        wait = _SAMPLE_S
        while not self._ended:
            self._wake.acquire(timeout=wait)
            error = None if self._ended or self._paused else self._exceeded()
            if error is not None:
                self.error = self.error or error
                wait = _AGAIN_S
                _interrupt(self._thread)

    def _exceeded(self) -> GlpathError | None:
        if (error := self._overdue()) is not None:
            return error
        size = f"{self.bytes:,} bytes"
        if self._processor_time() > self.processor:
            return self._error_class(
                f"{self.name}: reading {size} takes more than {SECONDS + _SECONDS_PER_BYTE * self.bytes:.3g} s of "
                "processor time, far more than files of this size need.",
                f"Check the file in another program. {_IF_RIGHT}",
            )
        if _memory() > self.memory:
            return self._error_class(
                f"{self.name}: memory grew by more than {(MEMORY + _MEMORY_PER_BYTE * self.bytes) / 1e9:.3g} GB "
                f"while {size} were read, far more than files of this size need.",
                f"Check the file in another program. {_IF_RIGHT} Memory that other threads take counts, too.",
            )
        return None


# A context variable, because a thread has its own bounds.
_bounds: ContextVar[_Bounds | None] = ContextVar("bounds", default=None)


@contextmanager
def reading_file(name: str, *, own_data: bool = False) -> Iterator[None]:
    """Context for reading a file and the files that it names; inside another one, it only names its work.

    name     : file name for errors
    own_data : True for data that the caller made or holds in memory; only a time limit then applies. Files that the
               data name have bounds of their own

    Raises SceneError if reading takes too much processor time or memory for the size of the files, and
    TimeLimitError.
    """
    with named_work(f"reading {name}"), _bounded(name, SceneError, timed=has_limit(), own_data=own_data):
        yield


@contextmanager
def reading_scene(name: str, *, own_data: bool = False) -> Iterator[None]:
    """Context for loading a scene as `reading_file`, without a time limit if the caller has an earlier result."""
    timed = has_limit()
    bounds = _bounded(name, SceneError, timed=timed, own_data=own_data)
    with without_limit_if_resumed(), named_work(f"reading {name}"), bounds:
        yield


@contextmanager
def reading_result(name: str) -> Iterator[None]:
    """Context for reading an image, film or solution. As these may be earlier results, no time limit applies.

    Raises ImageError if reading takes too much processor time or memory for the size of the file.
    """
    outer = _bounds.get()
    with without_limit() if outer is None else nullcontext(), _bounded(name, ImageError, timed=False):
        yield


@contextmanager
def _bounded(name: str, error_class: type[GlpathError], *, timed: bool, own_data: bool = False) -> Iterator[None]:
    """Context with bounds, unless it is inside another one.

    timed : True if the user gave a time limit, which replaces the limit of processor time
    """
    outer = _bounds.get()
    if outer is not None and (own_data or not outer.own_data):
        yield
        return
    before = contextvars.copy_context()
    bounds = _Bounds(name, error_class, timed=timed, own_data=own_data)
    _bounds.set(bounds)
    try:
        try:
            bounds.begin()
            yield
        finally:
            bounds.end()
    except BaseException as error:
        bounds.end()  # an exception may have come within the call above
        # Parsers may turn any exception into one of their own.
        if bounds.error is None or not isinstance(error, Exception | _Interrupted):
            raise
        _restore(before)
        raise bounds.error from None
    finally:
        _bounds.set(outer)


@contextmanager
def without_bounds() -> Iterator[None]:
    """Context of work during reading that does not depend on the file, such as compiling a kernel."""
    bounds = _bounds.get()
    if bounds is None:
        yield
        return
    with bounds.pause():
        yield


def count_file(descriptor: int) -> None:
    """Raise the limits of the active reading by the size of an open file. A second time it counts as nothing."""
    if (bounds := _bounds.get()) is not None:
        status = os.fstat(descriptor)
        bounds.add_file((status.st_dev, status.st_ino), status.st_size)


def count_bytes(size: int) -> None:
    """Raise the limits of the active reading by the number of bytes of a pipe."""
    if (bounds := _bounds.get()) is not None:
        bounds.add_bytes(size)


def allow_unfolded(size: int) -> None:
    """Raise the limits by unfolded data whose size in bytes another check has allowed, such as a picture."""
    if (bounds := _bounds.get()) is not None:
        bounds.memory += size
        bounds.processor += _SECONDS_PER_UNFOLDED_BYTE * size


def _restore(before: contextvars.Context) -> None:
    """Give context variables their earlier values, because an interrupted `with` may not have done so."""
    for variable, value in before.items():
        if variable.get() is not value:
            variable.set(value)


def _clock_of_this_thread() -> int | None:
    """Return the processor clock of this thread for `time.clock_gettime`; None if the system has none."""
    get: Callable[[int], int] | None = getattr(time, "pthread_getcpuclockid", None)
    return None if get is None else get(threading.get_ident())


def _memory() -> int:
    """Return the resident memory of this process in bytes; 0 if the system does not report it."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE
    except (OSError, ValueError, IndexError):
        return 0


def _interrupt(thread: int) -> None:
    """Raise `_Interrupted` in a thread at its next bytecode that may end a loop or call a function."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(_Interrupted))
