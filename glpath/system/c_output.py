"""Filter for the output of C libraries to standard output and standard error.

OpenEXR prints lines before it raises. They would appear before glpath's error message, or inside an image that is
written to standard output. The filter applies to the whole process, so only commands use it.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from glpath.system.report_pipe import write_report

_STDOUT, _STDERR = 1, 2
_lock = threading.Lock()


@contextmanager
def without_lines(*beginnings: str) -> Iterator[None]:
    """Context that drops lines with these beginnings from `sys.stdout` and from file descriptors 1 and 2.

    All other lines are written at the end. Lines from the descriptors go to standard error; they may include
    lines of other threads.
    """
    printed = io.StringIO()
    try:
        with _lock, _files_held(beginnings), contextlib.redirect_stdout(printed):
            yield
    finally:
        rest = [line for line in printed.getvalue().splitlines(True) if not line.startswith(beginnings)]
        if rest and sys.stdout is not None:
            with contextlib.suppress(OSError, ValueError):  # stdout is full or closed; it must not end the work
                sys.stdout.write("".join(rest))


@contextmanager
def _files_held(beginnings: tuple[str, ...]) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        _flush()
        try:
            held = stack.enter_context(tempfile.TemporaryFile())
            before = {number: os.dup(number) for number in (_STDOUT, _STDERR)}
        except OSError:  # a descriptor is closed, or no temporary file can be made: filter nothing
            yield
            return
        for number in before:
            os.dup2(held.fileno(), number)
        try:
            yield
        finally:
            _flush()
            for number, there in before.items():
                os.dup2(there, number)
                os.close(there)
            held.seek(0)
            dropped = tuple(os.fsencode(beginning) for beginning in beginnings)
            rest = b"".join(line for line in held if not line.startswith(dropped))
            with contextlib.suppress(OSError):
                write_report(_STDERR, rest)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # the stream may be closed, or no file
            stream.flush()
    with contextlib.suppress(OSError, AttributeError, TypeError):  # Windows cannot load a library without a name
        ctypes.CDLL(None).fflush(None)
