"""Holds back the output of C libraries to standard output and standard error.

OpenEXR does so before it raises: its lines would stand before the error with its remedy, or within a
picture that goes to standard output.
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

_STDOUT, _STDERR = 1, 2
_lock = threading.Lock()


@contextmanager
def without_lines(*beginnings: str) -> Iterator[None]:
    """Leave out lines that begin so, of all that is written to the two files, or to `sys.stdout`, within the block.

    All others are written at the end, those of the files to standard error: other threads write meanwhile, too.
    """
    printed = io.StringIO()
    try:
        with _lock, _files_held(beginnings), contextlib.redirect_stdout(printed):
            yield
    finally:
        rest = [line for line in printed.getvalue().splitlines(True) if not line.startswith(beginnings)]
        if rest and sys.stdout is not None:
            with contextlib.suppress(OSError, ValueError):  # full or closed: a report never ends the work
                sys.stdout.write("".join(rest))


@contextmanager
def _files_held(beginnings: tuple[str, ...]) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        _flush()
        try:
            held = stack.enter_context(tempfile.TemporaryFile())
            before = {number: os.dup(number) for number in (_STDOUT, _STDERR)}
        except OSError:  # closed, or nowhere to hold it: then nothing is held back
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
                os.write(_STDERR, rest)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # closed, or no file
            stream.flush()
    with contextlib.suppress(OSError, AttributeError, TypeError):  # Windows has no library without a name
        ctypes.CDLL(None).fflush(None)
