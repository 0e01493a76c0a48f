"""Locks against two processes that write the same file: the second one gets an error that names the first.

    with Lock(Path("a.checkpoint.npz"), "a render"):
        ...

A lock is a file beside the target, `.a.checkpoint.npz.lock`, with locked bytes (`F_OFD_SETLK`). The kernel unlocks
the bytes when the process ends for any reason, so a killed process leaves no stale lock. The content of the lock
file names the holder, only for the error message. The lock file is removed at the end; a lock file left by a killed
process is reused.

Network file systems: on NFS (4, or 3 with its lock daemon) a lock also works between machines. If a machine dies,
its locks end with its lease, usually 90 s. With the mount options `nolock` or `local_lock`, and on Lustre with
`localflock`, a lock works only within each machine. If the file system has no locks, a lock has no effect, and a
warning is logged.

Only Linux has byte-range locks that belong to an open file instead of a process. On other systems the package
filelock locks the whole file. There, processes with different parts also conflict, and the error names no holder.

A lock file that is a link is refused, because the lock would write into another file.

Poor at: a lock file that is deleted while a process holds the lock, because the next process creates another file.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import struct
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from glpath.errors import GlpathError, ImageError
from glpath.system.files import open_without_links, real_path, reason_of, short_name
from glpath.system.log import log
from glpath.system.machine import posix_module

_fcntl = posix_module("fcntl")
_LOCKS_PARTS = hasattr(_fcntl, "F_OFD_SETLK")

# Offset of the locked bytes. These bytes lie beyond the text of any lock file, because some network file systems
# forbid reading locked bytes.
_BASE = 1 << 40
# Offset and length of the byte that a process locks while it adds or removes itself as a holder.
_DESK = (_BASE - 1, 1)
_HELD = (errno.EACCES, errno.EAGAIN)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


class Lock:
    """Lock that keeps other processes from a file during a `with` block; nested blocks share one lock.

    path        : file to protect; each file has a lock file of its own
    what        : description of the holder for the message, such as "a render"
    first, stop : range of parts that this process writes, if several processes write parts of one result. Processes
                  with other parts do not conflict

    On entering, raises GlpathError with the name of the holder, or ImageError if no lock file can be created.
    """

    def __init__(self, path: Path, what: str, first: int = 0, stop: int = 1) -> None:
        self._target = real_path(path)
        if not self._target.name:
            raise ImageError(f"{path}: is a folder, where a file is needed.", "Name a file in it.")
        self._path = path
        self._file = self._target.with_name(short_name(".", self._target.name, ".lock"))
        self._what = what
        self._range = (first, stop)
        self._depth = 0
        self._descriptor: int | None = None
        self._whole: Any = None

    @property
    def exists(self) -> bool:
        """True if the lock file exists, held or not."""
        return os.path.lexists(self._file)

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
        """Take the lock. Returns False if the lock file was removed between opening and locking it."""
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
        # The lock was free, so any recorded holder of the same parts was killed. Remove it from the record.
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
        except OSError as error:  # the folder was removed or made read-only; nothing is lost
            log.info("%s: cannot be removed: %s", self._file, reason_of(error))

    def _is_there(self, descriptor: int) -> bool:
        """Return True if the open file still is the lock file, so neither removed nor replaced."""
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


def check_unlocked(path: Path) -> None:
    """Raise GlpathError with the name of the holder if another process has the lock of `path`."""
    lock = Lock(path, "a render that resumes from it")
    if lock.exists:
        with suppress(ImageError), lock:  # ignore a lock file that cannot be opened
            pass


class Locked:
    """Base class of objects that hold a file's lock, `_lock`, during a `with` block."""

    _lock: Lock

    def __enter__(self) -> Self:
        self._lock.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._lock.__exit__(*exception)


def _lock(descriptor: int, start: int, length: int, wait: bool = False) -> None:
    """Lock a range of bytes. Raises OSError, with an errno in `_HELD` if another process holds some of them."""
    command = _fcntl.F_OFD_SETLKW if wait else _fcntl.F_OFD_SETLK
    _fcntl.fcntl(descriptor, command, _flock(_fcntl.F_WRLCK, start, length))


def _unlock(descriptor: int, start: int, length: int) -> None:
    _fcntl.fcntl(descriptor, _fcntl.F_OFD_SETLK, _flock(_fcntl.F_UNLCK, start, length))


def _flock(kind: int, start: int, length: int) -> bytes:
    """Pack a `struct flock`: l_type, l_whence, l_start, l_len, l_pid. l_pid is 0 for locks of open files."""
    return struct.pack("hhqqi", kind, os.SEEK_SET, start, length, 0)


def _read(descriptor: int) -> list[dict[str, Any]]:
    """Return the holders recorded in the file; other content is ignored."""
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
    except OSError as error:  # full disk: the lock works, but does not name its holder
        log.info("lock: %s", reason_of(error))
