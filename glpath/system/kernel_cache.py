"""Cache of compiled kernels on disk; a kernel with a missing or damaged file is compiled again.

Each user has a folder of kernels beside numba's cache (`__pycache__`, else the user's cache folder, or
NUMBA_CACHE_DIR). This cache guarantees the following, which numba's does not:

- Kernels are executable code, so folder and files have the modes 0700 and 0600. If another user owns or can write
  them, or if they are links, they are not read. A `.numba_config.yaml` in the current folder has no effect.
- A kernel is stale if any Python file of its top-level package has changed; see `room_stamp`. Contents are
  compared, so a cache that was copied with its installation stays valid.
- A file holds the kernel of one signature, and a checksum of the kernel and its inputs. A file that is damaged,
  truncated, or made from other inputs counts as missing, and is not unpickled.
- A failure to write (full disk, no permission) gives one warning.
- If several processes need the same kernel, one compiles it, and the others wait and load it.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import os
import pickle
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from glpath.system.files import new_file, open_without_links
from glpath.system.log import log
from glpath.system.machine import posix_module
from glpath.system.private_interfaces import import_numba, numba_folders_of_environment, numba_internals
from glpath.system.time_limit import check_time

numba = import_numba()
NUMBA = numba_internals()
_fcntl = posix_module("fcntl")

#: Maximum wait for another process that compiles the same kernel, seconds. After it, that process probably hangs,
#: so this process compiles the kernel too.
_PATIENCE = 60.0
# Stands for a descriptor if locks are impossible. 0 is a descriptor if standard input is closed.
_NO_LOCKS = -1
_HOUSE = Path(__file__).parents[1]
# Name of the folder of kernels. It has the user's id, so that users of a shared installation have separate folders.
_FOLDER = f"glpath-kernels-{os.geteuid()}" if hasattr(os, "geteuid") else "glpath-kernels"


@functools.cache
def room_stamp(file: Path) -> tuple[tuple[str, str], ...]:
    """Return path and SHA-256 of the Python files on which kernels in `file` can depend.

    These are the files of the outermost package below `glpath` that contains `file`. For a file directly in
    `glpath`, it is that file alone.
    """
    room = _room(file)
    files = [file] if file.parent == _HOUSE else sorted(room.rglob("*.py"))
    return tuple((path.relative_to(room).as_posix(), _digest(path)) for path in files)


def _room(file: Path) -> Path:
    room = file.parent
    while room.parent != _HOUSE and (room.parent / "__init__.py").exists():
        room = room.parent
    return room


@functools.cache
def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class KernelCache(NUMBA.function_cache):  # type: ignore[misc, name-defined]
    """Cache of one function, with a file for each signature.

    on_wait : function called with the kernel's name if another process is compiling it
    on_load : function called with the kernel's name if it was loaded instead of compiled
    """

    def __init__(
        self,
        function: Any,
        on_wait: Callable[[str], None] | None = None,
        on_load: Callable[[str], None] | None = None,
    ) -> None:
        with numba_folders_of_environment():
            super().__init__(function)
        self._stamp = room_stamp(Path(function.__code__.co_filename))
        self._version = _short(repr((numba.__version__, self._stamp)))
        self._on_wait, self._on_load = on_wait, on_load
        # Set during a compilation. A lock that keeps other processes from the same kernel is then entered on this
        # stack, which releases it after the compilation.
        self.alone: ExitStack | None = None

    @property
    def folder(self) -> Path:
        """Folder of the kernels. It may not exist yet."""
        return Path(self._cache_path) / _FOLDER

    def refusal(self) -> str:
        """Return the reason why the folder must not be used; "" if it may be used, or does not exist."""
        try:
            status = os.lstat(self.folder)
        except OSError:
            return ""
        if not stat.S_ISDIR(status.st_mode):
            return "it is no folder, or a link"
        return "" if _is_private(status) else _OF_OTHERS

    def holds_any(self) -> bool:
        """Return True if a file exists for any signature of the current version of the function."""
        files = self.folder.glob(f"{self._impl.filename_base}.*.{self._version}.nbc")
        return not self.refusal() and any(files)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel of a signature; None if the cache has none, or must not be used.

        Numba's own method first imports the whole compiler, which takes a quarter of a second. Loading a kernel
        does not need the compiler, because kernels allocate no arrays (`kernels`). Compiling a kernel imports it.
        """
        if reason := self.refusal():
            _warn_that_nothing_is_kept(self.folder, reason)
            return None
        found = self._stored(sig, target_context)
        if found is None and self.alone is not None:
            lock = self._file(sig, target_context.codegen()).with_suffix(".lock")
            self.alone.enter_context(_alone(lock, self._report_wait))
            found = self._stored(sig, target_context)
        if found is not None and self._on_load is not None:
            self._on_load(self._py_func.__name__)
        return found

    def _report_wait(self) -> None:
        if self._on_wait is not None:
            self._on_wait(self._py_func.__name__)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled kernel; give one warning if that is impossible."""
        if not self._impl.check_cachable(data):
            return
        path = self._file(sig, data.codegen)
        content = NUMBA.dumps(self._impl.reduce(data))
        if self.refusal():  # `load_overload` has warned
            return
        try:
            _make_folder(path.parent)
            temporary = new_file(path.parent, path, 0o600)
            try:
                temporary.write_bytes(self._checksum(sig, data.codegen, content) + content)
                for stale in path.parent.glob(path.name.replace(self._version, "*")):
                    stale.unlink(missing_ok=True)
                os.replace(temporary, path)
            finally:
                temporary.unlink(missing_ok=True)
        except OSError as error:
            _warn_that_nothing_is_kept(path.parent, error.strerror or str(error))

    def _stored(self, sig: Any, target_context: Any) -> Any:
        try:
            content = memoryview(_read_private(self._file(sig, target_context.codegen())))
            if self._checksum(sig, target_context.codegen(), content[32:]) != content[:32]:
                return None
            return self._impl.rebuild(target_context, pickle.loads(content[32:]))
        except Exception as error:  # any error of reading or unpickling: compile again
            log.debug("kernel cache: %s: %s", self._py_func.__qualname__, error)
            return None

    def _file(self, sig: Any, codegen: Any) -> Path:
        which = _short(repr(self._index_key(sig, codegen)))
        return self.folder / f"{self._impl.filename_base}.{which}.{self._version}.nbc"

    def _checksum(self, sig: Any, codegen: Any, content: Any) -> bytes:
        """Return the SHA-256 of compiled code and of its source. It is compared before the code is unpickled."""
        made_from = repr((numba.__version__, self._stamp, self._index_key(sig, codegen)))
        return hashlib.sha256(made_from.encode() + content).digest()


_OF_OTHERS = "another user owns it or may write to it"


def _is_private(status: os.stat_result) -> bool:
    """Return True if this user owns the file or folder, and only this user may write it; True on Windows."""
    if not hasattr(os, "geteuid"):
        return True
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _make_folder(folder: Path) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def _read_private(path: Path) -> bytes:
    """Return the content of a file of this user. Raises OSError if another user owns it or may write to it."""
    with os.fdopen(open_without_links(path, os.O_RDONLY | getattr(os, "O_BINARY", 0)), "rb") as file:
        if not _is_private(os.fstat(file.fileno())):
            raise PermissionError(errno.EPERM, _OF_OTHERS, str(path))
        return file.read()


@functools.cache
def _warn_that_nothing_is_kept(folder: Path, reason: str) -> None:
    log.warning(
        "compiled kernels cannot be kept in %s (%s), so that every run compiles them anew: "
        "let NUMBA_CACHE_DIR name a folder of your own that can be written to",
        folder,
        reason,
    )


@contextmanager
def _alone(path: Path, on_wait: Callable[[], None]) -> Iterator[None]:
    """Context that locks a file against other processes.

    There is no lock if locks are impossible, or if another process still has the lock after `_PATIENCE` seconds.
    Raises TimeLimitError if the time limit is over during the wait.

    on_wait : function called once if another process has the lock
    """
    until = time.monotonic() + _PATIENCE
    handle = _locked(path)
    if handle is None:
        on_wait()
    while handle is None and time.monotonic() < until:
        check_time("waiting for kernels that another process compiles")
        time.sleep(0.05)
        handle = _locked(path)
    try:
        yield
    finally:
        if handle is not None and handle != _NO_LOCKS:
            path.unlink(missing_ok=True)
            os.close(handle)


def _locked(path: Path) -> int | None:
    """Lock a file and return its descriptor; None if another process has the lock, `_NO_LOCKS` if impossible."""
    if _fcntl is None:
        return _NO_LOCKS
    try:
        _make_folder(path.parent)
        handle = open_without_links(path, os.O_CREAT | os.O_RDWR, 0o600)
    except OSError:
        return _NO_LOCKS
    try:
        _fcntl.flock(handle, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(handle), os.lstat(path)):  # the last holder has not removed it
            return handle
    except BlockingIOError:
        pass
    except FileNotFoundError:
        pass
    except OSError:
        os.close(handle)
        return _NO_LOCKS
    os.close(handle)
    return None
