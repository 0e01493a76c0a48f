"""Writing of reports to a pipe or socket whose reader may have stopped reading.

A write to a full pipe blocks until somebody reads it. Reports must not stop the work, so a report that a pipe does
not take is dropped. The file is not made non-blocking, because other processes share its description.

Poor at:  several processes that fill one pipe at the same time. Another process may fill the pipe between the
          check and the write, which then blocks.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import stat
from typing import IO

#: Maximum wait for a reader, seconds. After a wait in vain, reports are dropped without waiting until the pipe
#: takes one again.
_PATIENCE = 1.0
# Number of bytes that a pipe takes without blocking if it is reported as writable (POSIX).
_CHUNK_BYTES = getattr(select, "PIPE_BUF", 512)

# Descriptors of pipes that did not take the last report.
_unread: set[int] = set()


def pipe_of(stream: IO[str] | None) -> int | None:
    """Return the descriptor of a text stream that is a pipe or socket; None if it is anything else."""
    if not isinstance(stream, io.TextIOWrapper):  # other streams may send text elsewhere, as a notebook's does
        return None
    with contextlib.suppress(OSError, ValueError):  # the stream may be closed, or no file
        descriptor = stream.fileno()
        if _is_pipe(descriptor):
            return descriptor
    return None


def write_report(descriptor: int, data: bytes) -> None:
    """Write a report to a file; drop the rest of it if a pipe or socket is full. Raises OSError as `os.write`."""
    if not _is_pipe(descriptor):
        os.write(descriptor, data)
        return
    rest = memoryview(data)
    while rest and _is_read(descriptor):
        rest = rest[os.write(descriptor, rest[:_CHUNK_BYTES]) :]


def _is_pipe(descriptor: int) -> bool:
    mode = os.fstat(descriptor).st_mode
    return hasattr(select, "poll") and (stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode))


def _is_read(descriptor: int) -> bool:
    """Return True if a pipe takes a chunk of bytes without blocking; wait for its reader if necessary."""
    pipe = select.poll()
    pipe.register(descriptor, select.POLLOUT)
    patience = 0.0 if descriptor in _unread else _PATIENCE
    _unread.add(descriptor)  # recorded before the wait, because a signal may end the wait
    if not pipe.poll(1000 * patience):
        return False
    _unread.discard(descriptor)
    return True
