"""Files that appear whole or not at all, and files of arrays.

A file is written beside its place under another name and then moved there, also when the process is stopped
meanwhile. Missing folders of an output are made: who types `-o out/a.png` means it.
"""

from __future__ import annotations

import os
import secrets
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile

from glpath.errors import ImageError


def shipped_folder(name: str) -> Path | None:
    """A folder that ships with glpath: inside the package in a wheel, beside it in a checkout."""
    package = Path(__file__).resolve().parent
    return next((f for f in (package / name, package.parent / name) if f.is_dir()), None)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """The place to write a file to, so that it appears at `path` whole or not at all.

    On leaving the block the file is moved to `path`, over what was there; if the block fails it is removed. Missing
    folders are made. A link is followed. Raises ImageError when the system refuses.
    """
    target = Path(os.path.realpath(path))
    # The suffix stays last, as some libraries choose the format by it.
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except (OSError, RuntimeError) as error:  # OpenEXR raises RuntimeError for what the system refuses
        raise ImageError(f"{path}: cannot be written: {reason_of(error)}.") from error


def check_writable(path: str | Path) -> None:
    """Raise ImageError if a file cannot be written at `path`: to be asked before hours of rendering, not after."""
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise ImageError(f"{path}: is a folder.", "Name a file in it.")
    folder = target.parent
    while not os.path.exists(folder):  # unlike Path.exists, also where the folder above may not be entered
        folder = folder.parent
    # Trying is the only sure way: permissions say little about root, network shares and read-only file systems.
    trial = folder / f".glpath.{secrets.token_hex(4)}.part"
    try:
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise ImageError(f"{path}: the folder {folder} cannot be written to: {reason_of(error)}.") from error


def open_npz(path: str | Path) -> NpzFile:
    """Open a file of arrays. Raises OSError, ValueError and zipfile.BadZipFile."""
    with open(path, "rb") as file:
        # numpy takes anything else for a pickle, and says so.
        if not zipfile.is_zipfile(file):
            raise ValueError("it is cut off, or not of this format")
    opened: NpzFile = np.load(path, allow_pickle=False)
    return opened


def reason_of(error: BaseException) -> str:
    """What went wrong, in the system's words, without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error).rstrip(".") or type(error).__name__
