"""Two processes that would write one file: the second gets an error that names the first.

    with Lock(Path("a.checkpoint.npz"), "a render"):
        ...

A lock is a file beside, `.a.checkpoint.npz.lock`, of which bytes are locked (`F_OFD_SETLK`): the kernel lets go of
them when the process ends, whatever ends it, so that a killed one leaves no stale lock. What stands in the file
says who holds it, for the message alone. It is removed at the end; what a killed process has left is taken over.

Network file systems: on NFS (4, or 3 with its lock daemon) it holds between machines, too; when a machine dies, its
locks end with its lease, 90 s as a rule. Where a mount has `nolock` or `local_lock`, and on Lustre with
`localflock`, it holds within each machine. Without any locks it has no effect, as the log says.

Linux alone has locks of parts of a file that belong to the open file. Elsewhere filelock locks the whole file, so
that processes with other parts meet, too, and the error names no holder.

A lock file that is a link is refused: what stands in it would be written into another file.

Poor at: a lock file that is removed while it is held, by hand or with its folder: the next process makes another.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import socket
import struct
import time
from pathlib import Path
from typing import Any, Self

from glpath.errors import GlpathError, ImageError
from glpath.system.files import open_without_links, real_path, reason_of, short_name
from glpath.system.machine import posix_module

log = logging.getLogger("glpath")

_fcntl = posix_module("fcntl")
_LOCKS_PARTS = hasattr(_fcntl, "F_OFD_SETLK")

# What is locked lies beyond the text of any lock file, as some network file systems forbid to read locked bytes.
_BASE = 1 << 40
# Held for the moment in which one enters the file or leaves it.
_DESK = (_BASE - 1, 1)
_HELD = (errno.EACCES, errno.EAGAIN)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


class Lock:
    """Keeps other processes from a file while a `with` block runs; blocks within each other are one.

    path        : the file; no other lock file has its name
    what        : that holds it, in the words of the message: "a render"
    first, stop : of what is written there in parts, which of them: processes with others do not meet

    On entering, raises GlpathError, which names who holds it, or ImageError where there can be no lock file.
    """

    def __init__(self, path: Path, what: str, first: int = 0, stop: int = 1) -> None:
        self._target = real_path(path)
        self._path = path
        self._file = self._target.with_name(short_name(".", self._target.name, ".lock"))
        self._what = what
        self._range = (first, stop)
        self._depth = 0
        self._descriptor: int | None = None
        self._whole: Any = None

    def __enter__(self) -> Lock:
        if self._depth == 0:
            try:
                if _LOCKS_PARTS:
                    self._acquire()
                else:
                    self._acquire_whole()
            except OSError as error:
                raise ImageError(
                    f"{self._path}: its lock {self._file} cannot be made: {reason_of(error)}.",
                    "Remove that file if no process uses it: a lock is a file of its own, and never a link.",
                ) from error
        self._depth += 1
        return self

    def __exit__(self, *exception: object) -> None:
        self._depth -= 1
        if self._depth == 0 and self._descriptor is not None:
            descriptor, self._descriptor = self._descriptor, None
            try:
                self._leave(descriptor)
            finally:
                os.close(descriptor)
        elif self._depth == 0 and self._whole is not None:
            whole, self._whole = self._whole, None
            whole.release()

    def _acquire_whole(self) -> None:
        try:
            import filelock
        except ImportError:
            log.warning("%s: no locks without filelock: take care that one process writes it", self._path)
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(self._file):
            os.close(open_without_links(self._file, os.O_RDWR))
        lock = filelock.FileLock(self._file, timeout=0)
        try:
            lock.acquire()
        except filelock.Timeout:
            raise self._refusal([]) from None
        except NotImplementedError:
            log.warning("%s: this file system has no locks: take care that one process writes it", self._path)
            return
        self._whole = lock

    def _acquire(self) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        while True:
            descriptor = open_without_links(self._file, os.O_RDWR | os.O_CREAT)
            try:
                if self._enter(descriptor):
                    self._descriptor, descriptor = descriptor, -1
                    return
            except OSError as error:
                if error.errno not in _NO_LOCKS:
                    raise
                log.warning("%s: this file system has no locks: take care that one process writes it", self._path)
                return
            finally:
                if descriptor >= 0:
                    os.close(descriptor)

    def _enter(self, descriptor: int) -> bool:
        """Whether that went well; not where the file was removed between opening and locking it."""
        _lock(descriptor, *_DESK, wait=True)
        if not self._is_there(descriptor):
            return False
        first, stop = self._range
        held = _read(descriptor)
        try:
            _lock(descriptor, _BASE + first, stop - first)
        except OSError as error:
            if error.errno not in _HELD:
                raise
            raise self._refusal([each for each in held if self._meets(each)]) from None
        # What is recorded as a holder of this part was killed.
        mine = {
            "pid": os.getpid(),
            "host": socket.gethostname(),
            "since": time.strftime("%Y-%m-%d %H:%M:%S %z"),
            "range": [first, stop],
        }
        _write(descriptor, [*(each for each in held if not self._meets(each)), mine])
        _unlock(descriptor, *_DESK)
        return True

    def _leave(self, descriptor: int) -> None:
        try:
            _lock(descriptor, *_DESK, wait=True)
            if not self._is_there(descriptor):
                return
            try:
                _lock(descriptor, _BASE, _BASE)
            except OSError as error:
                if error.errno not in _HELD:
                    raise
                _write(descriptor, [each for each in _read(descriptor) if not self._meets(each)])
            else:
                self._file.unlink()
        except OSError as error:  # a folder that is gone or read-only by now: nothing is lost by it
            log.info("%s: cannot be removed: %s", self._file, reason_of(error))

    def _is_there(self, descriptor: int) -> bool:
        """Whether the open file is still the one of this name."""
        try:
            named, opened = os.lstat(self._file), os.fstat(descriptor)
        except FileNotFoundError:
            return False
        return (named.st_dev, named.st_ino) == (opened.st_dev, opened.st_ino)

    def _meets(self, held: dict[str, Any]) -> bool:
        first, stop = held["range"]
        return bool(max(first, self._range[0]) < min(stop, self._range[1]))

    def _refusal(self, holders: list[dict[str, Any]]) -> GlpathError:
        who, end = "another process", ""
        if holders:
            last = holders[-1]
            who = f"process {last.get('pid')} on {last.get('host')}, since {last.get('since')}"
            end = f" (there: kill {last.get('pid')})"
        return GlpathError(
            f"{self._path}: {self._what} has it already: {who}.",
            f"Wait until that ends, or end it{end}; or name another output. Once it has ended, however that was, "
            f"{self._file} locks nothing.",
        )


class Locked:
    """Holds a file's lock, `_lock`, while a `with` block runs."""

    _lock: Lock

    def __enter__(self) -> Self:
        self._lock.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._lock.__exit__(*exception)


def _lock(descriptor: int, start: int, length: int, wait: bool = False) -> None:
    """Raises OSError, with one of `_HELD` where others hold some of it."""
    command = _fcntl.F_OFD_SETLKW if wait else _fcntl.F_OFD_SETLK
    _fcntl.fcntl(descriptor, command, _flock(_fcntl.F_WRLCK, start, length))


def _unlock(descriptor: int, start: int, length: int) -> None:
    _fcntl.fcntl(descriptor, _fcntl.F_OFD_SETLK, _flock(_fcntl.F_UNLCK, start, length))


def _flock(kind: int, start: int, length: int) -> bytes:
    """`struct flock`: l_type, l_whence, l_start, l_len, l_pid; the last of these is 0 for locks of open files."""
    return struct.pack("hhqqi", kind, os.SEEK_SET, start, length, 0)


def _read(descriptor: int) -> list[dict[str, Any]]:
    """The holders recorded in the file; anything else in it is ignored."""
    try:
        found = json.loads(os.pread(descriptor, 1 << 20, 0) or b"[]")
    except (OSError, ValueError, RecursionError):
        return []
    return [each for each in found if _is_holder(each)] if isinstance(found, list) else []


def _is_holder(found: object) -> bool:
    held = found.get("range") if isinstance(found, dict) else None
    return isinstance(held, list) and len(held) == 2 and all(isinstance(end, int) for end in held)


def _write(descriptor: int, holders: list[dict[str, Any]]) -> None:
    text = json.dumps(holders).encode()
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, text, 0)
    except OSError as error:  # a disk that is full: the lock holds, but does not name its holder
        log.info("lock: %s", reason_of(error))
