"""Writing of reports to a pipe, socket or terminal whose reader may have stopped reading.

A write to a full pipe blocks until somebody reads from the pipe, and a write to a terminal blocks after Ctrl-S.
Reports must not stop the work, so a report is dropped if its write would block. The file is not made non-blocking,
because other processes share its open file description.

Poor at:  several processes that fill one pipe at the same time, and a Ctrl-S between the check and the write. The
          write then blocks.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import stat
from typing import IO

#: Maximum wait for a reader, seconds. After a wait in vain, further reports are dropped at once as long as the file
#: is full.
_PATIENCE = 1.0
# Number of bytes that a pipe takes without blocking if it is reported as writable (POSIX).
_CHUNK_BYTES = getattr(select, "PIPE_BUF", 512)
# Number of bytes that a terminal takes without blocking if it is reported as writable. It then has room for 256
# bytes, and a line break takes two of them.
_TERMINAL_CHUNK_BYTES = 128

# Descriptors of files that did not take the last report.
_unread: set[int] = set()


def pipe_or_terminal(stream: IO[str] | None) -> int | None:
    """Return the descriptor of a text stream that is a pipe, socket or terminal; None if it is anything else."""
    if not isinstance(stream, io.TextIOWrapper):  # others, such as a notebook's, may send text elsewhere
        return None
    with contextlib.suppress(OSError, ValueError):  # the stream may be closed, or have no file
        descriptor = stream.fileno()
        if _chunk_bytes(descriptor):
            return descriptor
    return None


def write_report(descriptor: int, data: bytes) -> None:
    """Write a report to a descriptor; drop the rest of the report if a pipe, socket or terminal accepts no more.

    Raises the OSError of `os.write`, for example if the reader has closed the pipe.
    """
    chunk = _chunk_bytes(descriptor)
    if chunk is None:
        os.write(descriptor, data)
        return
    rest = memoryview(data)
    while rest and _is_read(descriptor):
        rest = rest[os.write(descriptor, rest[:chunk]) :]


def _chunk_bytes(descriptor: int) -> int | None:
    """Return how many bytes a writable pipe, socket or terminal takes without blocking.

    None for another kind of file, and on systems without `select.poll`.
    """
    mode = os.fstat(descriptor).st_mode
    if not hasattr(select, "poll"):
        return None
    if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
        return _CHUNK_BYTES
    return _TERMINAL_CHUNK_BYTES if os.isatty(descriptor) else None


def _is_read(descriptor: int) -> bool:
    """Return True if a file takes a chunk of bytes without blocking; before that, wait for its reader if needed.

    The wait is at most `_PATIENCE`, and zero if the file did not take the last report.
    """
    file = select.poll()
    file.register(descriptor, select.POLLOUT)
    patience = 0.0 if descriptor in _unread else _PATIENCE
    _unread.add(descriptor)  # recorded before the wait, because a signal may end the wait
    if not file.poll(1000 * patience):
        return False
    _unread.discard(descriptor)
    return True
