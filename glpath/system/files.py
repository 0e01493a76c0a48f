"""Atomic writing of files, and safe reading.

A file is written beside its target under another name and then moved, so a stopped process leaves no partial file.
The file and its entry in the folder are on disk (fsync) when the call returns. Missing folders of an output are
created. A pipe or a device is written into, never replaced; `-` is standard output.
"""

from __future__ import annotations

import errno
import hashlib
import io
import math
import os
import re
import secrets
import select
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

from glpath.errors import GlpathError, ImageError
from glpath.system.bounded_reading import count_bytes, count_file, reading_result
from glpath.system.machine import posix_module
from glpath.system.signals import RECORDS
from glpath.system.time_limit import check_time

_fcntl = posix_module("fcntl")

#: Path that means standard output.
STDOUT = "-"
# Maximum length of a file name in bytes on nearly all file systems.
_MAX_NAME_BYTES = 255
# Placeholder for the random part of a temporary name. No file name contains these null characters.
_NO_TOKEN = 8 * "\0"
# Paths of the files that the running command has read, in order; None outside of `recorded_inputs`. It is shared by
# all threads, because some readers have threads of their own.
_inputs: dict[str, None] | None = None
# True within `replacing_links`.
_REPLACING_LINKS: ContextVar[bool] = ContextVar("replacing_links", default=False)
# True within `without_waiting`.
_WITHOUT_WAITING: ContextVar[bool] = ContextVar("without_waiting", default=False)


def shipped_folder(name: str) -> Path | None:
    """Return a folder that ships with glpath, in the package (wheel) or beside it (checkout); None if missing."""
    package = Path(__file__).resolve().parents[1]
    return next((f for f in (package / name, package.parent / name) if f.is_dir()), None)


def is_denied(path: str | Path) -> bool:
    """Return True if missing permission for a folder of the path prevents a test whether the path exists."""
    try:
        os.stat(path)
    except PermissionError:
        return True
    except (OSError, ValueError):  # ValueError for a NUL
        pass
    return False


def absence_of(path: str | Path, missing: str = "does not exist") -> str:
    """Return the predicate of an error for a path that `os.path.isfile` rejects; `missing` if it does not exist."""
    if is_denied(path):
        return f"cannot be read: {os.strerror(errno.EACCES)}"
    return "is not a file" if os.path.exists(path) else missing


def absolute_path(path: str | Path) -> str:
    """Return the absolute path. Raises GlpathError if the path is relative and the current folder was removed."""
    try:
        return os.path.abspath(path)
    except FileNotFoundError as error:
        raise missing_current_folder() from error


def missing_current_folder() -> GlpathError:
    """Return the error for a current folder that was removed."""
    return GlpathError("the current folder does not exist any more.", "Change to another folder with cd.")


def is_stream(path: str | Path) -> bool:
    """Return True if `path` is written into, not replaced: a pipe, a character device, or `-` (standard output)."""
    mode = _mode(path)
    return str(path) == STDOUT or stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


@contextmanager
def recorded_inputs() -> Iterator[None]:
    """Context of one command. Within it, `check_outputs` knows all files that the functions of this module read.

    Among them are files that the user did not name, such as the textures of a model.
    """
    global _inputs
    before, _inputs = _inputs, {}
    try:
        yield
    finally:
        _inputs = before


def record_input(path: str | Path) -> None:
    """Record a file that the command reads. Readers of this module do it; call it for a file that is read later."""
    if _inputs is not None:
        _inputs[os.fspath(path)] = None


def inputs_of_command() -> list[str | Path]:
    """Return the files that the running command has read, in order; [] outside of `recorded_inputs`."""
    return list(_inputs or ())


@contextmanager
def replacing_links() -> Iterator[None]:
    """Context in which `whole_file` replaces a symbolic link instead of following it.

    It is for file names that the user did not give. A link of such a name could lead to a file that must stay.
    """
    token = _REPLACING_LINKS.set(True)
    try:
        yield
    finally:
        _REPLACING_LINKS.reset(token)


@contextmanager
def without_waiting() -> Iterator[None]:
    """Context in which writing to a pipe fails if nobody reads the pipe, or too slowly, instead of waiting."""
    token = _WITHOUT_WAITING.set(True)
    try:
        yield
    finally:
        _WITHOUT_WAITING.reset(token)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Context that yields a temporary path. The file written there appears at `path` complete or not at all.

    On leaving the block, the file is moved to `path` and replaces an existing file. If `path` is a pipe or device,
    the content is copied into it. If the block fails, the file is removed. Missing folders are created, and links
    are followed, except within `replacing_links`. Raises ImageError if the system refuses.
    """
    is_replaced = _REPLACING_LINKS.get() and os.path.islink(path)
    put = _through_a_folder if is_stream(path) and not is_replaced else _beside
    try:
        with put(path) as temporary:
            yield temporary
    except (OSError, RuntimeError) as error:  # OpenEXR raises RuntimeError if the system refuses
        raise ImageError(f"{path}: cannot be written: {reason_of(error)}.") from error


# Flags for opening a file to read, except flags that the system lacks. Windows has only O_BINARY, because it has
# neither forks (O_CLOEXEC) nor named pipes (O_NONBLOCK).
_READ = os.O_RDONLY
for _name in ("O_CLOEXEC", "O_NONBLOCK", "O_BINARY"):
    _READ |= getattr(os, _name, 0)

_WITHOUT_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)

#: Maximum size of a file that is read as a whole, bytes.
MAX_FILE_BYTES = 2**32
#: Maximum size of a scene or a job in TOML or JSON, bytes. To parse a file of this size takes up to 5 s.
MAX_TEXT_BYTES = 2**23
# Maximum size of data from a pipe, whose size is unknown in advance, bytes.
_MAX_PIPE_BYTES = 2**28
# Maximum wait for a writer of a named pipe, seconds. After it, reading fails.
_WRITER_S = 3.5
# Maximum time without a reader, or with a reader that reads nothing, after a signal, seconds.
_AFTER_SIGNAL_S = 1.0
# Interval between checks for a writer or a reader of a named pipe, seconds.
_LOOK_S = 0.02
# Interval between checks of time and signals while a pipe is silent, milliseconds.
_SILENCE_MS = 100
_PART_BYTES = 1 << 20
_MORE_MEMORY = "Close other programs, or use a machine with more memory."
# Maximum ratio of a sparse file's size to the size of its data. Files with a higher ratio are refused.
_HOLES_RATIO = 64
# Size up to which any sparse file is allowed, bytes.
_SMALL_BYTES = 2**26


def check_file(path: str | Path) -> None:
    """Raise OSError, with the reason as its text, for a path that must not be given to a library.

    Such paths are pipes, devices, folders, unreadable files, and files that are nearly all holes. A missing path is
    allowed.
    """
    if (kind := _unreadable_kind(mode := _mode(path))) or stat.S_ISFIFO(mode):
        raise _refused(path, kind or "a pipe")  # not opened, because closing it would end its writer
    if mode:
        open_file(path).close()


def open_file(path: str | Path) -> BinaryIO:
    """Open a file for reading. Raises OSError, also for a pipe, a device, or a file that is nearly all holes."""
    descriptor = _open(path)
    try:
        status = os.fstat(descriptor)
        if (kind := _unreadable_kind(status.st_mode)) or stat.S_ISFIFO(status.st_mode):
            raise _refused(path, kind or "a pipe")
        _check_holes(descriptor, status.st_size)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def open_without_links(path: str | Path, flags: int, mode: int = 0o666) -> int:
    """Open a file without following links, and return its descriptor.

    Raises OSError, with the reason as its text, for a symbolic link, a file with further hard links, and a path
    that is not a file. Writing through a link could change a file elsewhere.
    """
    try:
        descriptor = os.open(path, flags | _WITHOUT_LINKS, mode)
    except OSError as error:
        if os.path.islink(path):
            raise _refused(path, "a symbolic link") from error
        raise
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise _refused(path, _unreadable_kind(status.st_mode) or "a pipe")
        if status.st_nlink > 1:
            raise _refused(path, f"one of {status.st_nlink} names (hard links)")
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def read_bytes(path: str | Path, limit: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a file or pipe, such as the named pipe of bash for <(...).

    limit : maximum size in bytes

    Waits while a process has the pipe open for writing. Raises OSError, with the reason as its text, for a device,
    for too many bytes, and for a named pipe without a writer.
    """
    descriptor = _open(path)
    with os.fdopen(descriptor, "rb") as file:
        mode = os.fstat(descriptor).st_mode
        if kind := _unreadable_kind(mode):
            raise _refused(path, kind)
        if stat.S_ISFIFO(mode):
            return _all_of_stream(descriptor, limit, _first_of_pipe(descriptor, path))
        return _all_of(file, limit)


def _open(path: str | Path) -> int:
    """Open a file for reading, record it, and return its descriptor. Does not wait for the writer of a pipe."""
    try:
        descriptor = os.open(path, _READ)
    except ValueError as error:  # the name contains a NUL
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path)) from error
    record_input(path)
    count_file(descriptor)
    return descriptor


def read_standard_input(limit: int = MAX_FILE_BYTES) -> bytes:
    """Return all bytes of standard input, which may be a file, a pipe, a socket or a terminal.

    limit : maximum size in bytes

    Waits for the end of the input. Raises OSError, with the reason as its text, and TimeLimitError.
    """
    stream: BinaryIO | None = getattr(sys.stdin, "buffer", None)
    if stream is None:
        raise OSError(errno.EBADF, "it is closed")
    try:
        descriptor = stream.fileno()
    except OSError:  # `sys.stdin` was replaced by an object without a file descriptor
        return _within(stream.read(limit + 1), limit)
    if os.isatty(descriptor):
        return _within(stream.read(), limit)
    count_file(descriptor)
    mode = os.fstat(descriptor).st_mode
    if (kind := _unreadable_kind(mode)) and not stat.S_ISSOCK(mode):
        raise _refused(STDOUT, kind)
    return _all_of(stream, limit)


def _all_of(file: BinaryIO, limit: int) -> bytes:
    """Return all bytes of an open file or stream.

    Raises OSError for more than `limit` bytes, and for a file that is nearly all holes.
    """
    descriptor = file.fileno()
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or not status.st_size:  # the size of files in /proc is 0
        return _all_of_stream(descriptor, limit)
    if status.st_size > limit:
        raise _too_large(f"{status.st_size:,}", limit)
    _check_holes(descriptor, status.st_size)
    return file.read(status.st_size)


def _first_of_pipe(descriptor: int, path: str | Path) -> bytes:
    """Wait for a writer of a named pipe, and return the first bytes; b"" if it has written none yet.

    Raises OSError if no writer opens the pipe in `_WRITER_S` seconds, and TimeLimitError.
    """
    end = time.monotonic() + _WRITER_S
    while time.monotonic() < end:
        check_time("reading a pipe")
        try:
            if first := os.read(descriptor, _PART_BYTES):
                return first
        except BlockingIOError:  # there is a writer, but nothing is written yet
            return b""
        time.sleep(_LOOK_S)
    raise _refused(path, f"a pipe into which nobody writes, as nobody opened it within {_WRITER_S:g} s")


def _all_of_stream(descriptor: int, limit: int, first: bytes = b"") -> bytes:
    """Return `first` and all further bytes of a pipe or socket, until it has no writer.

    Raises OSError for too many bytes, and TimeLimitError if the time limit is over before the end of the data.
    """
    limit, content = min(limit, _MAX_PIPE_BYTES), bytearray(first)
    waiting = select.poll() if hasattr(select, "poll") else None  # Windows has no poll
    if waiting is not None:
        waiting.register(descriptor, select.POLLIN)
    while len(content) <= limit:
        check_time("reading a pipe")
        if waiting is not None and not waiting.poll(_SILENCE_MS):
            continue
        part = os.read(descriptor, _PART_BYTES)
        if not part:
            count_bytes(len(content))
            return bytes(content)
        content += part
    raise _too_large("more", limit)


def _within(content: bytes, limit: int) -> bytes:
    if len(content) > limit:
        raise _too_large("more", limit)
    count_bytes(len(content))
    return content


def _too_large(size: str, limit: int) -> OSError:
    than = "than" if size == "more" else "bytes, more than"
    return OSError(errno.EFBIG, f"it has {size} {than} the {limit:,} bytes that are read")


def _check_holes(descriptor: int, size: int) -> None:
    """Raise OSError for a large file that is nearly all holes, which need memory but no disk space."""
    if size <= _SMALL_BYTES or not hasattr(os, "SEEK_DATA"):
        return
    here, data, start = os.lseek(descriptor, 0, os.SEEK_CUR), 0, 0
    while start < size:
        try:
            start = os.lseek(descriptor, start, os.SEEK_DATA)
            stop = os.lseek(descriptor, start, os.SEEK_HOLE)
        except OSError:  # the rest of the file is a hole
            break
        data, start = data + stop - start, stop
        if data * _HOLES_RATIO >= size:
            break
    os.lseek(descriptor, here, os.SEEK_SET)
    if data * _HOLES_RATIO < size:
        raise OSError(errno.EFBIG, f"of its {size:,} bytes {size - data:,} are holes")


def _unreadable_kind(mode: int) -> str:
    """Return what an unreadable path is, such as "a device"; "" for a file, a pipe, or a missing path."""
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        return "a device"
    return "a socket" if stat.S_ISSOCK(mode) else "a folder" if stat.S_ISDIR(mode) else ""


def special_kind(path: str | Path) -> str:
    """Return what a path is if it is neither file nor folder, such as "a device" or "a pipe"; otherwise ""."""
    mode = _mode(path)
    if stat.S_ISDIR(mode):
        return ""
    return "a pipe" if stat.S_ISFIFO(mode) else _unreadable_kind(mode)


def _refused(path: str | Path, kind: str) -> OSError:
    if kind == "a folder":
        return IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    return OSError(errno.EINVAL, f"it is {kind}, not a file", str(path))


def write_bytes(content: bytes, path: Path) -> None:
    """Write bytes to a file atomically. Raises ImageError if it cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def _beside(path: str | Path) -> Iterator[Path]:
    if _REPLACING_LINKS.get():
        target = real_path(Path(path).parent) / Path(path).name
        kind = None if os.path.islink(path) else _unwritable_kind(path)
    else:
        target, kind = real_path(path), _unwritable_kind(path)
    if kind is not None:
        raise OSError(f"it is {kind}")
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = new_file(target.parent, target, suffix=Path(path).suffix)
    descriptor = _locked(temporary)
    try:
        yield temporary
        with temporary.open("r+b") as written:  # "r+", because Windows cannot flush a file opened for reading
            os.fsync(written.fileno())
        os.replace(temporary, target)
        _sync_folder(target.parent)
    finally:
        # Ignore errors of the removal, so that an earlier error is reported. The folder may be gone or read-only.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        if descriptor is not None:
            os.close(descriptor)


def _locked(path: Path) -> int | None:
    """Lock a temporary file and return its open descriptor; None if that fails.

    It fails if the file cannot be opened, if another process has locked it, if the file system has no locks, and on
    Windows. The kernel releases the lock when the process ends for any reason.
    """
    if _fcntl is None:
        return None
    with suppress(OSError):
        descriptor = open_without_links(path, os.O_RDWR)
        try:
            _fcntl.flock(descriptor, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
        else:
            return descriptor
    return None


def _sync_folder(folder: Path) -> None:
    """Flush a folder to disk, so that the entry of a new file survives a crash; do nothing if unsupported."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    with suppress(PermissionError):  # the folder is writable but not readable
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(descriptor)


def remove_parts(path: str | Path) -> None:
    """Remove temporary files that killed processes left while writing `path`.

    Files that a process is still writing are locked, and stay. If the system has no file locks, all files stay.
    """
    target = real_path(path)
    before, after = _part_name(target, _NO_TOKEN, Path(path).suffix).split(_NO_TOKEN)
    left = re.compile(re.escape(before) + "[0-9a-f]{8}" + re.escape(after))
    with suppress(OSError):
        for entry in list(target.parent.iterdir()):
            if left.fullmatch(entry.name) and (descriptor := _locked(entry)) is not None:
                os.close(descriptor)
                entry.unlink(missing_ok=True)


@contextmanager
def _through_a_folder(path: str | Path) -> Iterator[Path]:
    """Context that yields a temporary path, and copies the file written there into a pipe or device at its end.

    File writers need the temporary file because they seek, which is impossible in a pipe.
    """
    with tempfile.TemporaryDirectory(prefix="glpath-") as folder:
        temporary = Path(folder) / f"output{Path(path).suffix}"
        yield temporary
        with temporary.open("rb") as written, _opened(path) as stream:
            if (descriptor := _descriptor_to_wait_for(stream)) is None:
                shutil.copyfileobj(written, stream)
                stream.flush()
                return
            patience = _Patience()
            # Pieces of this size never block after `poll` has reported that the pipe takes bytes (POSIX).
            while piece := written.read(select.PIPE_BUF):
                while piece:
                    patience.wait_for_reader(descriptor)
                    with suppress(BlockingIOError):
                        piece = piece[os.write(descriptor, piece) :]


class _Patience:
    """Wait for the reader of a pipe. After a signal, the wait soon ends with an error; otherwise it has no limit.

    A signal that came before the wait counts too.
    """

    def __init__(self) -> None:
        self._ends = math.inf

    def check(self) -> None:
        """Raise TimeoutError within `without_waiting`, or if `_AFTER_SIGNAL_S` passed after a signal."""
        arrived = any(record.first is not None for record in RECORDS)
        if arrived and self._ends == math.inf:
            self._ends = time.monotonic() + _AFTER_SIGNAL_S
        if _WITHOUT_WAITING.get() or time.monotonic() > self._ends:
            ended = ", and a signal ended the wait" if arrived else ""
            raise TimeoutError(errno.ETIMEDOUT, f"nobody reads the pipe{ended}")

    def wait_for_reader(self, descriptor: int) -> None:
        """Return when a pipe takes bytes. Raises TimeoutError as `check`."""
        poll = select.poll()
        poll.register(descriptor, select.POLLOUT)
        while not poll.poll(_SILENCE_MS):
            self.check()
        self._ends = math.inf


def _descriptor_to_wait_for(stream: BinaryIO) -> int | None:
    """Return the descriptor of a stream if the system can wait for its reader; otherwise None."""
    # Other objects, such as compressed files, may have the descriptor of a file that they write to.
    if not hasattr(select, "poll") or not isinstance(getattr(stream, "raw", stream), io.FileIO):
        return None
    stream.flush()  # what was printed before
    return stream.fileno()


def _opened(path: str | Path) -> AbstractContextManager[BinaryIO]:
    if str(path) == STDOUT:
        return nullcontext(_standard_output())
    # Without a buffer where `poll` is used; elsewhere only a buffered file writes all bytes.
    return open(path, "wb", buffering=0 if hasattr(select, "poll") else -1, opener=_open_for_reader)


def _open_for_reader(path: str, flags: int) -> int:
    """Open a pipe or device as soon as it has a reader. Raises OSError, and TimeoutError as `_Patience.check`."""
    patience = _Patience()
    while True:
        try:
            # Without O_CREAT, because a pipe that was removed meanwhile must not become a file.
            return os.open(path, (flags & ~(os.O_CREAT | os.O_TRUNC)) | getattr(os, "O_NONBLOCK", 0))
        except OSError as error:
            # ENXIO is the error of a pipe without a reader, and of a device without a driver.
            if error.errno != errno.ENXIO or not stat.S_ISFIFO(os.stat(path).st_mode):
                raise
        patience.check()
        time.sleep(_LOOK_S)


def _standard_output() -> BinaryIO:
    buffer: BinaryIO | None = getattr(sys.stdout, "buffer", None)
    if buffer is None:
        raise OSError("standard output takes no bytes here")
    return buffer


def check_writable(path: str | Path) -> None:
    """Raise ImageError if a file cannot be written at `path`. Commands call this before long work starts."""
    if str(path) == STDOUT:
        try:
            _standard_output()
        except OSError as error:
            raise ImageError(f"{path}: {reason_of(error)}.") from error
        return
    if is_stream(path):
        if not os.access(path, os.W_OK):
            raise ImageError(f"{path}: cannot be written to: Permission denied.")
        return
    if (kind := _unwritable_kind(path)) is not None:
        raise ImageError(f"{path}: is {kind}.", "Name a file in it." if kind == "a folder" else "Name a file.")
    target = real_path(path)
    folder = target.parent
    while not os.path.exists(folder):  # unlike Path.exists, does not raise if the folder above may not be entered
        folder = folder.parent
    if not os.path.isdir(folder):
        raise ImageError(
            f"{path}: {folder} is a file, but a folder of this name is needed.",
            "Rename it, or name another output.",
        )
    # Create a file, because permissions say little about root, network shares and read-only file systems. Before
    # that, `lstat` raises OSError if the target's name is too long; `new_file` would shorten the name.
    try:
        with suppress(FileNotFoundError):
            os.lstat(folder / target.name)
        new_file(folder, target, suffix=Path(path).suffix).unlink()
    except OSError as error:
        raise ImageError(f"{path}: the folder {folder} cannot be written to: {reason_of(error)}.") from error


def file_id(path: str | Path) -> tuple[int, int] | None:
    """Return device and inode of the file to which `path` leads; None if it does not exist."""
    with suppress(OSError, ValueError):
        status = os.stat(path)
        return status.st_dev, status.st_ino
    return None


def new_file(folder: Path, target: Path, mode: int = 0o666, suffix: str | None = None) -> Path:
    """Create an empty file in `folder` for the content of `target`, and return its path. Raises OSError.

    The name is random, and an existing file or link of that name is never opened.

    suffix : suffix of the new file; None: that of `target`, which may lack it if a link leads to it
    """
    while True:
        path = folder / _part_name(target, secrets.token_hex(4), target.suffix if suffix is None else suffix)
        with suppress(FileExistsError):
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _WITHOUT_LINKS, mode))
            return path


def _part_name(target: Path, token: str, suffix: str) -> str:
    # The suffix stays last, because some libraries choose the format by it.
    return short_name(".", target.stem, f".{token}.part{suffix}")


def short_name(before: str, stem: str, after: str) -> str:
    """Return the joined parts as a file name; the stem is shortened if the name is too long for file systems.

    Different stems give different names.
    """
    encoded = os.fsencode(stem)
    beyond = len(os.fsencode(f"{before}{stem}{after}")) - _MAX_NAME_BYTES
    if beyond <= 0:
        return f"{before}{stem}{after}"
    digest = hashlib.sha256(encoded).hexdigest()[:16]
    start = encoded[: max(0, len(encoded) - beyond - len(digest))].decode(errors="ignore")
    return f"{before}{start}{digest}{after}"


def real_path(path: str | Path) -> Path:
    """Return the absolute path with links resolved. Raises ImageError for characters that no path has.

    Also raises ImageError if `path` is relative to a deleted folder.
    """
    try:
        return Path(os.path.realpath(path))
    except ValueError as error:  # the name contains a NUL or a surrogate
        raise ImageError(
            f"{path}: is no path, because it contains a character that no file name has.", "Name another file."
        ) from error
    except FileNotFoundError as error:
        raise ImageError(
            f"{path}: the current folder was deleted, so a path in it leads nowhere.",
            "Change to another folder, or give an absolute path.",
        ) from error


def _mode(path: str | Path) -> int:
    """Return `st_mode` of the file to which `path` leads; 0 if it does not exist."""
    try:
        return os.stat(path).st_mode
    except (OSError, ValueError):  # ValueError: the name contains a NUL or a surrogate
        return 0


def _unwritable_kind(path: str | Path) -> str | None:
    """Return what a path is, such as "a folder", if no file may replace it; None for a file or a missing path."""
    mode = _mode(path)
    if stat.S_ISDIR(mode):
        return "a folder"
    return None if stat.S_ISREG(mode) or not mode else "a block device or a socket"


@contextmanager
def reading(path: str | Path, what: str, remedy: str = "") -> Iterator[None]:
    """Context that turns all errors of parsers into ImageError: the file cannot be read as `what`."""
    try:
        with reading_result(str(path)):
            yield
    except GlpathError:
        raise
    except FileNotFoundError as error:
        raise ImageError(f"{path}: there is no such file.", remedy) from error
    except MemoryError as error:
        raise ImageError(f"{path}: needs more memory than is free: {reason_of(error)}.", _MORE_MEMORY) from error
    except Exception as error:  # libraries raise any type for a damaged file
        raise ImageError(f"{path}: cannot be read as {what}: {reason_of(error)}.", remedy) from error


def reason_of(error: BaseException) -> str:
    """Return the system's message of an OSError, or the text of another error, without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error).rstrip(".") or type(error).__name__
