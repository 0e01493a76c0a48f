"""Reader of arrays from .npz and .npy files, which may be damaged or hostile.

The header of an array is read before its data, to check the type, the shape, and that the file can hold the data. A
few kilobytes of zip can expand to gigabytes. Data that expand more than real data of a rendering are rejected.

Source: numpy's NEP 1 (the .npy format).
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from glpath.errors import ImageError
from glpath.system.bounded_reading import allow_unfolded
from glpath.system.files import MAX_TEXT_BYTES, open_file, reading

# Upper bound of the header size of an array of numbers, bytes.
_HEADER = 4096
# Accepted compression methods, which are those that numpy writes. bzip2 and LZMA may unfold a few bytes to
# gigabytes at once.
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# Bytes of memory for a text of an array that becomes a Python object.
_TEXT_OBJECT = 64
# Bytes per character of an array of text.
_CHARACTER = np.dtype("U1").itemsize
# Data whose uncompressed size in bytes is at most this are always accepted.
_UNFOLDED = 256 << 20
# Maximum ratio of uncompressed to stored bytes for larger data. Above it the data are rejected.
_RATIO = 64
# Maximum ratio of decoded to stored bytes for larger data. It is that of colours of 8 bits, decoded to float64.
_DECODED_RATIO = 8 * _RATIO
# The same for all pictures of a model together. Lossy pictures of smooth surfaces reach a ratio of 200.
_PICTURES_RATIO = 256
# Size of all images that are computed from the pictures of a model that is always accepted, bytes.
_DERIVED = 512 << 20
# Maximum ratio of the size of these images to the stored bytes of the pictures, for larger images. Floats are four
# times as large as colours of 8 bits.
_DERIVED_RATIO = 8 * _PICTURES_RATIO
# Maximum size of these images in any case, bytes.
_MAX_DERIVED = 1 << 33
#: Bytes of memory for a pixel that is decoded to three float64.
FLOAT_PIXEL = 24


class Arrays:
    """Arrays of an .npz file by name, which are read on demand."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, what: str, remedy: str) -> None:
        self._path, self._archive, self._what, self._remedy = path, archive, what, remedy
        self.names = tuple(name.removesuffix(".npy") for name in archive.namelist())

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def read(
        self,
        name: str,
        kinds: str,
        shape: tuple[int | None, ...] | None = None,
        *,
        max_values: int | None = None,
        decoded_bytes: int = 0,
    ) -> NDArray[Any]:
        """Read an array with one of the `kinds` (as `numpy.dtype.kind`) and a shape, in which None is any length.

        max_values    : maximum number of values
        decoded_bytes : memory in bytes that the caller needs per value

        Raises ImageError if the array is missing, ValueError for another kind or shape, and the parsers' errors for
        damaged data.
        """
        if name not in self:
            raise ImageError(f"{self._path}: is not {self._what}: it holds no `{name}`.", self._remedy)
        member = self._archive.getinfo(f"{name}.npy")
        if member.compress_type not in _COMPRESSIONS:
            methods = {zipfile.ZIP_BZIP2: "bzip2", zipfile.ZIP_LZMA: "lzma"}
            method = methods.get(member.compress_type, f"method {member.compress_type}")
            raise ValueError(f"`{name}` is compressed by {method}, expected deflate, or no compression")
        check_unfolded(member.file_size, member.compress_size)
        with self._archive.open(member) as stream:
            found, dtype, size = _header(stream)
        if size != member.file_size:
            raise ValueError(f"`{name}` holds {member.file_size} bytes, its header says {size}")
        fits = shape is None or (
            len(found) == len(shape) and all(w in (None, n) for n, w in zip(found, shape, strict=True))
        )
        value_bytes = max(decoded_bytes, _TEXT_OBJECT) if dtype.kind == "U" else decoded_bytes
        check_unfolded(member.file_size, member.compress_size, math.prod(found) * value_bytes)
        if max_values is not None and math.prod(found) > max_values:
            raise ValueError(f"`{name}` is an array {_shown(found)}, expected {max_values} values at most")
        if dtype.kind not in kinds or not fits:
            wanted = "" if shape is None else f", expected {_shown(shape)}"
            raise ValueError(f"`{name}` is an array {_shown(found)} of {dtype}{wanted} of kind {'/'.join(kinds)}")
        with self._archive.open(member) as stream:
            return npy.read_array(stream, allow_pickle=False)

    def read_object(self, name: str, *, only_finite: bool = False) -> dict[str, Any]:
        """Read a JSON object, which the array `name` holds as text.

        only_finite : True if NaN and infinite numbers are not allowed

        Raises ValueError for compressed text of more than MAX_TEXT_BYTES characters and for other JSON values, and
        the errors of `read`.
        """
        if name in self:
            member = self._archive.getinfo(f"{name}.npy")
            characters = member.file_size // _CHARACTER
            # An uncompressed text takes as many bytes of the file as the limit allows, so it may be longer.
            if characters > max(MAX_TEXT_BYTES + _HEADER, member.compress_size // _CHARACTER):
                raise ValueError(
                    f"`{name}` is a compressed text of {characters:,} letters, expected {MAX_TEXT_BYTES:,} at most"
                )
        found = json.loads(str(self.read(name, "U", ())), parse_constant=_refuse if only_finite else None)
        if not isinstance(found, dict):
            kinds = {list: "a list", str: "a text", bool: "a bool", type(None): "null"}
            raise ValueError(f"its {name} is {kinds.get(type(found), 'a number')}, expected an object")
        return found


def _refuse(constant: str) -> None:
    raise ValueError(f"it holds {constant} where a finite number is expected")


@contextmanager
def open_npz(path: str | Path, what: str, remedy: str = "") -> Iterator[Arrays]:
    """Open an .npz file and yield its arrays. All errors become ImageError.

    what : expected content for the messages, such as "a film"
    """
    with reading(path, what, remedy), open_file(path) as file:
        if not zipfile.is_zipfile(file):
            raise ValueError("it is cut off, or not of this format")
        with zipfile.ZipFile(file) as archive:
            yield Arrays(Path(path), archive, what, remedy)


def read_npy(path: str | Path) -> NDArray[Any]:
    """Return the numbers of an .npy file. Call it within `reading`, which turns all errors into ImageError."""
    with open_file(path) as file:
        _, dtype, size = _header(file)
        present = file.seek(0, io.SEEK_END)
        if size != present:
            raise ValueError(f"it has {present} bytes, its header says {size}")
        if dtype.kind not in "biuf":
            raise ValueError(f"it holds {dtype}, expected numbers")
        file.seek(0)
        return npy.read_array(file, allow_pickle=False)


def check_unfolded(unfolded: int, stored: int, decoded: int = 0) -> None:
    """Raise ValueError for data whose size in memory is implausibly large for their size in the file.

    unfolded : size in bytes of the uncompressed data
    stored   : size in bytes of the compressed data
    decoded  : memory in bytes of the values made from the uncompressed data, if it is more
    """
    memory = max(unfolded, decoded)
    if memory > _UNFOLDED and (unfolded > _RATIO * stored or decoded > _DECODED_RATIO * stored):
        ratio = _RATIO if unfolded > _RATIO * stored else _DECODED_RATIO
        raise ValueError(
            f"{stored} bytes in it unfold to {memory / 1e9:,.3g} GB; no more than {ratio} times is read"
        )
    allow_unfolded(unfolded + decoded)


@dataclass
class UnfoldedPictures:
    """Sums of the sizes of all pictures of a model in bytes, which `add` limits as `check_unfolded` does.

    derived : size of the images that are computed from the pictures
    """

    unfolded: int = 0
    stored: int = 0
    decoded: int = 0
    derived: int = 0

    def add(self, unfolded: int, stored: int, decoded: int) -> None:
        """Count a picture before it is decoded. Raises ValueError if the sums become too large.

        A picture that is refused is not counted. The parameters are those of `check_unfolded`.
        """
        sums = self.unfolded + unfolded, self.stored + stored, self.decoded + decoded
        memory = max(sums[0], sums[2])
        if memory > _UNFOLDED and sums[0] > _PICTURES_RATIO * sums[1]:
            raise ValueError(
                f"with the pictures before it, {sums[1]:,} bytes unfold to {memory / 1e9:,.3g} GB; no more than "
                f"{_PICTURES_RATIO} times is read, so make large plain pictures smaller"
            )
        self.unfolded, self.stored, self.decoded = sums
        allow_unfolded(unfolded + decoded)

    def add_derived(self, size: int) -> None:
        """Count an image before it is computed from pictures. Raises ValueError if their sum becomes too large."""
        derived = self.derived + size
        allowed = max(_DERIVED, min(_DERIVED_RATIO * self.stored, _MAX_DERIVED))
        if derived > allowed:
            raise ValueError(
                f"images of {derived / 1e9:,.3g} GB would be computed from {self.stored:,} bytes of pictures, but "
                f"{allowed / 1e9:,.3g} GB are allowed, so make large plain pictures smaller"
            )
        self.derived = derived
        allow_unfolded(size)


def _header(stream: BinaryIO | Any) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Return shape and type of an array, and total bytes of header and data. Raises ValueError for other data."""
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
