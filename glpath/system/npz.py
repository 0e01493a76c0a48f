"""Arrays from files that may be damaged or hostile: .npz and .npy.

The header of an array is read before its data: its type, its shape, and that the file can hold so much. A few
kilobytes of zip can unfold to gigabytes; what unfolds beyond reason is refused, as nothing that is rendered does.

Source: numpy's NEP 1 (the .npy format).
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.system.files import open_file, reading

# Longer than the header of any array of numbers.
_HEADER = 4096
# Data may unfold to so many bytes, or to so many times their size in the file.
_UNFOLDED = 256 << 20
_RATIO = 64


class Arrays:
    """The arrays of an .npz file, by name; none is read before it is asked for."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, what: str, remedy: str) -> None:
        self._path, self._archive, self._what, self._remedy = path, archive, what, remedy
        self.names = tuple(name.removesuffix(".npy") for name in archive.namelist())

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def read(self, name: str, kinds: str, shape: tuple[int | None, ...] | None = None) -> NDArray[Any]:
        """An array of one of the `kinds` (as `numpy.dtype.kind`) and of a shape, in which None is any length.

        Raises ImageError where it is missing or another; what the parsers raise where it is damaged.
        """
        if name not in self:
            raise ImageError(f"{self._path}: is not {self._what}: it holds no `{name}`.", self._remedy)
        member = self._archive.getinfo(f"{name}.npy")
        check_unfolded(member.file_size, member.compress_size)
        with self._archive.open(member) as stream:
            found, dtype, size = _header(stream)
        if size != member.file_size:
            raise ValueError(f"`{name}` holds {member.file_size} bytes, its header says {size}")
        fits = shape is None or (
            len(found) == len(shape) and all(w in (None, n) for n, w in zip(found, shape, strict=True))
        )
        if dtype.kind not in kinds or not fits:
            wanted = "" if shape is None else f", expected {_shown(shape)}"
            raise ValueError(f"`{name}` is an array {_shown(found)} of {dtype}{wanted} of kind {'/'.join(kinds)}")
        with self._archive.open(member) as stream:
            return npy.read_array(stream, allow_pickle=False)


@contextmanager
def open_npz(path: str | Path, what: str, remedy: str = "") -> Iterator[Arrays]:
    """The arrays of a file that must be `what`, such as "a film". Raises ImageError, also for what fails inside."""
    with reading(path, what, remedy), open_file(path) as file:
        if not zipfile.is_zipfile(file):
            raise ValueError("it is cut off, or not of this format")
        with zipfile.ZipFile(file) as archive:
            yield Arrays(Path(path), archive, what, remedy)


def read_npy(path: str | Path) -> NDArray[Any]:
    """The numbers of an .npy file. To be called within `reading`."""
    with open_file(path) as file:
        _, dtype, size = _header(file)
        present = file.seek(0, io.SEEK_END)
        if size != present:
            raise ValueError(f"it has {present} bytes, its header says {size}")
        if dtype.kind not in "biuf":
            raise ValueError(f"it holds {dtype}, expected numbers")
        file.seek(0)
        return npy.read_array(file, allow_pickle=False)


def check_unfolded(unfolded: int, stored: int) -> None:
    """Raise ValueError for data that fill far more memory than their size in the file lets expect."""
    if unfolded > max(_UNFOLDED, _RATIO * stored):
        raise ValueError(
            f"{stored} bytes in it unfold to {unfolded / 1e9:,.3g} GB; no more than {_RATIO} times is read"
        )


def _header(stream: BinaryIO | Any) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Shape and type of an array, and the bytes of header and data. Raises ValueError."""
    head = io.BytesIO(stream.read(_HEADER))
    version = npy.read_magic(head)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(
            f"it is of version {version[0]}.{version[1]} of the .npy format, which numbers do not need"
        )
    parse = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = parse(head)
    if dtype.hasobject or dtype.names is not None or not dtype.itemsize or min(shape, default=1) < 0:
        raise ValueError(f"it is an array {_shown(shape)} of {dtype}")
    return shape, dtype, head.tell() + math.prod(shape) * dtype.itemsize


def _shown(shape: tuple[int | None, ...]) -> str:
    return "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
