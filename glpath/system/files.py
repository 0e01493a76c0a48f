"""Files that appear whole or not at all, and outputs of which none is lost for another's sake.

A file is written beside its target under another name and then moved there, also when the process is stopped
meanwhile. It and the entry of its folder are on the disk (fsync) when the call returns. Missing folders of an
output are made. A pipe or a device is written into, never replaced; `-` is
standard output.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import select
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import BinaryIO

from glpath.errors import GlpathError, ImageError

#: Writes something to the path that it is given.
Save = Callable[[Path], object]

_STDOUT = "-"
# Longest name of a file in bytes, as nearly all file systems have it.
_MAX_NAME_BYTES = 255
# Stands for the random part of a temporary name, as no name has it.
_NO_TOKEN = 8 * "\0"


def shipped_folder(name: str) -> Path | None:
    """A folder that ships with glpath: inside the package in a wheel, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    return next((f for f in (package / name, package.parent / name) if f.is_dir()), None)


def is_stream(path: str | Path) -> bool:
    """Whether `path` is written into rather than replaced: a pipe, a character device, or `-`, standard output."""
    mode = _mode(path)
    return str(path) == _STDOUT or stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Where to write a file, so that it appears at `path` whole or not at all.

    On leaving the block the file is moved to `path`, over what was there, or copied into it where that is a pipe or
    a device; if the block fails it is removed. Missing folders are made. A link is followed. Raises ImageError when
    the system refuses.
    """
    put = _through_a_folder if is_stream(path) else _beside
    try:
        with put(path) as temporary:
            yield temporary
    except (OSError, RuntimeError) as error:  # OpenEXR raises RuntimeError for what the system refuses
        raise ImageError(f"{path}: cannot be written: {reason_of(error)}.") from error


# Where the system has it: Windows opens text otherwise, and neither forks nor has pipes by name.
_READ = os.O_RDONLY
for _name in ("O_CLOEXEC", "O_NONBLOCK", "O_BINARY"):
    _READ |= getattr(os, _name, 0)

_WITHOUT_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)

#: Maximum size of a file that is read as a whole, bytes.
MAX_FILE_BYTES = 2**32
#: Maximum size of a text that describes something, such as a scene, a job or a year of weather, bytes.
MAX_TEXT_BYTES = 2**28
# Maximum size of data from a pipe, which cannot tell its size, bytes.
_MAX_PIPE_BYTES = 2**28
# Seconds within which somebody must open a named pipe to write into it, and seconds between two looks.
_WRITER_S, _LOOK_S = 3.5, 0.02
_PART_BYTES = 1 << 20
# A file with holes may be that many times as large as its data, or have that many bytes in any case.
_HOLES_RATIO, _SMALL_BYTES = 64, 2**26


def check_file(path: str | Path) -> None:
    """Raise OSError, with the reason as its text, unless a library may open `path` itself and read all of it."""
    if (kind := _unreadable_kind(mode := _mode(path))) or stat.S_ISFIFO(mode):
        raise _refused(path, kind or "a pipe")  # without opening it, which would end its writer
    if mode:
        open_file(path).close()


def open_file(path: str | Path) -> BinaryIO:
    """Open a file to be read. Raises OSError, also for a pipe, a device, or a file that is nearly all holes."""
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
    """Open a file that no link leads to, and return its descriptor.

    Raises OSError, with the reason as its text, for a symbolic link, a file with several names (hard links) and
    anything but a file: to write there would change a file elsewhere.
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
    """Return all of a file, or of a pipe into which somebody writes, as bash has one for <(...).

    limit : maximum size in bytes

    Waits while somebody holds the pipe open to write. Raises OSError, with the reason as its text, for a device,
    for too many bytes, and for a named pipe that nobody opens to write into it.
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
    """A descriptor to read from. Does not wait: opening a pipe otherwise blocks until somebody writes."""
    try:
        return os.open(path, _READ)
    except ValueError as error:  # a name that holds a NUL
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path)) from error


def read_standard_input(limit: int = MAX_FILE_BYTES) -> bytes:
    """Return all of standard input: a file, a pipe, a socket or a terminal, within the limits of `read_bytes`.

    Waits until it ends. Raises OSError, with the reason as its text.
    """
    stream: BinaryIO | None = getattr(sys.stdin, "buffer", None)
    if stream is None:
        raise OSError(errno.EBADF, "it is closed")
    try:
        descriptor = stream.fileno()
    except OSError:  # it is an object of Python, not of the system
        return _within(stream.read(limit + 1), limit)
    if os.isatty(descriptor):
        return _within(stream.read(), limit)
    mode = os.fstat(descriptor).st_mode
    if (kind := _unreadable_kind(mode)) and not stat.S_ISSOCK(mode):
        raise _refused(_STDOUT, kind)
    return _all_of(stream, limit)


def _all_of(file: BinaryIO, limit: int) -> bytes:
    """Return all bytes of an open file or stream. Raises OSError as `read_bytes`."""
    descriptor = file.fileno()
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or not status.st_size:  # the size of a file of /proc is 0, too
        return _all_of_stream(descriptor, limit)
    if status.st_size > limit:
        raise _too_large(f"{status.st_size:,}", limit)
    _check_holes(descriptor, status.st_size)
    return file.read(status.st_size)


def _first_of_pipe(descriptor: int, path: str | Path) -> bytes:
    """Return what is in a named pipe, opened without waiting, as soon as somebody has opened it to write."""
    end = time.monotonic() + _WRITER_S
    while time.monotonic() < end:
        try:
            if first := os.read(descriptor, _PART_BYTES):
                return first
        except BlockingIOError:  # somebody holds it open, but has written nothing yet
            return b""
        time.sleep(_LOOK_S)
    raise _refused(path, f"a pipe into which nobody writes, as nobody opened it within {_WRITER_S:g} s")


def _all_of_stream(descriptor: int, limit: int, first: bytes = b"") -> bytes:
    """Return `first` and all bytes of a pipe or socket until nobody holds it open to write. Raises OSError."""
    limit, content = min(limit, _MAX_PIPE_BYTES), bytearray(first)
    waiting = select.poll() if hasattr(select, "poll") else None  # Windows has none
    if waiting is not None:
        waiting.register(descriptor, select.POLLIN)
    while len(content) <= limit:
        if waiting is not None:
            waiting.poll()  # as standard input may be set not to wait
        part = os.read(descriptor, _PART_BYTES)
        if not part:
            return bytes(content)
        content += part
    raise _too_large("more", limit)


def _within(content: bytes, limit: int) -> bytes:
    if len(content) > limit:
        raise _too_large("more", limit)
    return content


def _too_large(size: str, limit: int) -> OSError:
    than = "than" if size == "more" else "bytes, more than"
    return OSError(errno.EFBIG, f"it has {size} {than} the {limit:,} bytes that are read")


def _check_holes(descriptor: int, size: int) -> None:
    """Raise OSError for a large file that is nearly all holes, which take memory here but none of the disk."""
    if size <= _SMALL_BYTES or not hasattr(os, "SEEK_DATA"):
        return
    here, data, start = os.lseek(descriptor, 0, os.SEEK_CUR), 0, 0
    while start < size:
        try:
            start = os.lseek(descriptor, start, os.SEEK_DATA)
            stop = os.lseek(descriptor, start, os.SEEK_HOLE)
        except OSError:  # no data any more
            break
        data, start = data + stop - start, stop
        if data * _HOLES_RATIO >= size:
            break
    os.lseek(descriptor, here, os.SEEK_SET)
    if data * _HOLES_RATIO < size:
        raise OSError(errno.EFBIG, f"of its {size:,} bytes {size - data:,} are holes")


def _unreadable_kind(mode: int) -> str:
    """The kind of a path without content to read; "" for a file, a pipe, or nothing."""
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        return "a device"
    return "a socket" if stat.S_ISSOCK(mode) else "a folder" if stat.S_ISDIR(mode) else ""


def _refused(path: str | Path, kind: str) -> OSError:
    if kind == "a folder":
        return IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    return OSError(errno.EINVAL, f"it is {kind}, not a file", str(path))


def write_bytes(content: bytes, path: Path) -> None:
    """A whole file of these bytes. Raises ImageError."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def _beside(path: str | Path) -> Iterator[Path]:
    target = real_path(path)
    if (kind := _unwritable_kind(path)) is not None:
        raise OSError(f"it is {kind}")
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = new_file(target.parent, target)
    try:
        yield temporary
        with temporary.open("r+b") as written:  # Windows writes nothing to a disk by a file that is read
            os.fsync(written.fileno())
        os.replace(temporary, target)
        _sync_folder(target.parent)
    finally:
        # The first error is the one to report: the folder may be gone, or read-only by now.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """The new name is on the disk, too; not all systems have such a call."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    with suppress(PermissionError):  # a folder that may be written but not read
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(descriptor)


def remove_parts(path: str | Path) -> None:
    """Remove what killed processes have left of their attempts to write `path`. For a file with one writer."""
    target = real_path(path)
    before, after = _part_name(target, _NO_TOKEN).split(_NO_TOKEN)
    left = re.compile(re.escape(before) + "[0-9a-f]{8}" + re.escape(after))
    with suppress(OSError):
        for entry in list(target.parent.iterdir()):
            if left.fullmatch(entry.name):
                entry.unlink(missing_ok=True)


@contextmanager
def _through_a_folder(path: str | Path) -> Iterator[Path]:
    """Formats seek as they are written, so a pipe gets the bytes of a file that is done."""
    with tempfile.TemporaryDirectory(prefix="glpath-") as folder:
        temporary = Path(folder) / f"output{Path(path).suffix}"
        yield temporary
        with temporary.open("rb") as written, _opened(path) as stream:
            shutil.copyfileobj(written, stream)
            stream.flush()


def _opened(path: str | Path) -> AbstractContextManager[BinaryIO]:
    if str(path) != _STDOUT:
        return open(path, "wb")
    return nullcontext(_standard_output())


def _standard_output() -> BinaryIO:
    buffer: BinaryIO | None = getattr(sys.stdout, "buffer", None)
    if buffer is None:
        raise OSError("standard output takes no bytes here")
    return buffer


def check_writable(path: str | Path) -> None:
    """Raise ImageError if a file cannot be written at `path`: to be asked before hours of rendering, not after."""
    if str(path) == _STDOUT:
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
    while not os.path.exists(folder):  # unlike Path.exists, also where the folder above may not be entered
        folder = folder.parent
    # Only trying is sure: permissions say little about root, network shares and read-only file systems. The name
    # may be too long.
    try:
        with suppress(FileNotFoundError):
            os.lstat(folder / target.name)
        new_file(folder, target).unlink()
    except OSError as error:
        raise ImageError(f"{path}: the folder {folder} cannot be written to: {reason_of(error)}.") from error


def new_file(folder: Path, target: Path, mode: int = 0o666) -> Path:
    """Create an empty file in `folder` for the content of `target`, and return its path. Raises OSError.

    Nobody can guess its name, and a file or a link that has it already is never opened.
    """
    while True:
        path = folder / _part_name(target, secrets.token_hex(4))
        with suppress(FileExistsError):
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _WITHOUT_LINKS, mode))
            return path


def _part_name(target: Path, token: str) -> str:
    # The suffix stays last, as some libraries choose the format by it.
    return short_name(".", target.stem, f".{token}.part{target.suffix}")


def short_name(before: str, stem: str, after: str) -> str:
    """Return the three joined as the name of a file; of a name too long for file systems, the stem is shortened.

    Names of different stems stay different.
    """
    encoded = os.fsencode(stem)
    beyond = len(os.fsencode(f"{before}{stem}{after}")) - _MAX_NAME_BYTES
    if beyond <= 0:
        return f"{before}{stem}{after}"
    digest = hashlib.sha256(encoded).hexdigest()[:16]
    start = encoded[: max(0, len(encoded) - beyond - len(digest))].decode(errors="ignore")
    return f"{before}{start}{digest}{after}"


def real_path(path: str | Path) -> Path:
    """Return the absolute path to which links lead. Raises ImageError if it begins in a folder that was deleted."""
    try:
        return Path(os.path.realpath(path))
    except FileNotFoundError as error:
        raise ImageError(
            f"{path}: the current folder was deleted, so a path in it leads nowhere.",
            "Change to another folder, or give an absolute path.",
        ) from error


def _mode(path: str | Path) -> int:
    """`st_mode` of what `path` leads to; 0 where there is nothing."""
    try:
        return os.stat(path).st_mode
    except OSError:
        return 0


def _unwritable_kind(path: str | Path) -> str | None:
    """The kind of a path that a file must not replace; None for a file, or for nothing."""
    mode = _mode(path)
    if stat.S_ISDIR(mode):
        return "a folder"
    return None if stat.S_ISREG(mode) or not mode else "a block device or a socket"


def save_all(
    saves: Mapping[Path, Save], rescue: Mapping[str, Save], where: str
) -> tuple[list[Path], ImageError | None]:
    """Write several outputs of one result. One that fails does not keep the others from being written.

    saves  : what writes each output
    rescue : what writes all of the result, by the name of a file: into a temporary folder where no output could be
             written, or one with the suffix of such a file could not
    where  : the sentence that says where the rescue is, with {} for its files

    Returns what was written, and the error that names all failures and the rescue; None where all went well.
    """
    written: list[Path] = []
    failures: dict[Path, Exception] = {}
    for path, save in saves.items():
        try:
            save(path)
            written.append(path)
        except Exception as error:  # a mistake of ours in one format must not lose the others either
            failures[path] = error
    if not failures:
        return written, None
    notes = []
    suffixes = {Path(name).suffix for name in rescue}
    if not written or any(path.suffix.lower() in suffixes for path in failures):
        notes.append(rescued(rescue, where))
    reasons = [
        error.message if isinstance(error, GlpathError) else f"{path}: cannot be written: {error!r}."
        for path, error in failures.items()
    ]
    message = reasons.pop() if len(saves) == 1 else f"{len(failures)} of {len(saves)} outputs cannot be written."
    failure = ImageError(message, "\n".join([*reasons, *notes]))
    failure.__cause__ = next(iter(failures.values()))
    return written, failure


def rescued(rescue: Mapping[str, Save], where: str) -> str:
    """Write a result into a temporary folder; the sentence that says where it is. See `save_all`."""
    names = ", ".join(map(str, _into_temporary_folder(rescue)))
    return where.format(names) if names else "Nor could it be kept in a temporary folder."


def _into_temporary_folder(rescue: Mapping[str, Save]) -> list[Path]:
    """The files, in the first temporary folder that takes them. Empty where none does."""
    try:
        usual = tempfile.gettempdir()
    except OSError:
        usual = ""
    for parent in filter(os.path.isdir, dict.fromkeys((usual, "/var/tmp", "/dev/shm"))):
        folder = ""
        try:
            folder = tempfile.mkdtemp(prefix="glpath-", dir=parent)
            for name, save in rescue.items():
                save(Path(folder) / name)
        except (OSError, GlpathError):
            shutil.rmtree(folder, ignore_errors=True)
        else:
            return [Path(folder) / name for name in rescue]
    return []


@contextmanager
def reading(path: str | Path, what: str, remedy: str = "") -> Iterator[None]:
    """Whatever a damaged file makes parsers in the block raise is an ImageError: it cannot be read as `what`."""
    try:
        yield
    except GlpathError:
        raise
    except FileNotFoundError as error:
        raise ImageError(f"{path}: there is no such file.", remedy) from error
    except Exception as error:  # what libraries run into in a damaged file has no class of its own
        raise ImageError(f"{path}: cannot be read as {what}: {reason_of(error)}.", remedy) from error


def reason_of(error: BaseException) -> str:
    """The system's message, without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error).rstrip(".") or type(error).__name__
