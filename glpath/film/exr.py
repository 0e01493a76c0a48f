"""OpenEXR files: pixels, further channels, windows and texts of their headers."""

from __future__ import annotations

import contextlib
import ctypes
import io
import mmap
import os
import re
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import ImageError, UsageError
from glpath.film.aovs import AOV_KINDS
from glpath.system.arguments import check_texts, checked, short_repr
from glpath.system.colour import REC709_CHROMATICITIES, matrix_to_rec709
from glpath.system.files import check_file, reading, whole_file
from glpath.system.npz import FLOAT_PIXEL, check_unfolded
from glpath.system.report_pipe import write_report
from glpath.system.time_limit import in_command

__all__ = ["write_exr"]

Float64 = NDArray[np.float64]

# OpenEXR: maximum number of attributes and channels in all parts of a file together.
_MAX_EXR_ENTRIES = 4096


# OpenEXR: maximum size of a position in a window, pixels.
_MAX_EXR_EDGE = 2**30


# OpenEXR: maximum aspect of a pixel, and of its reciprocal.
_MAX_EXR_ASPECT = 1e6


# OpenEXR: maximum length of a name or a type, bytes.
_MAX_EXR_NAME = 255


# OpenEXR: pattern of one entry of the channel list: a name, a zero byte, and 16 bytes of numbers.
_EXR_CHANNEL = re.compile(rb"[^\0]{1,255}\0.{16}", re.DOTALL)


@checked
def write_exr(
    path: str | Path,
    radiance: ArrayLike,
    metadata: Mapping[str, str] | None = None,
    *,
    window: tuple[int, int, int, int] | None = None,
    full_resolution: tuple[int, int] | None = None,
    pixel_aspect: float = 1.0,
    layers: Mapping[str, NDArray[Any]] | None = None,
    channels: Mapping[str, NDArray[np.float32]] | None = None,
    alpha: Float64 | None = None,
) -> None:
    """Write (H, W, 3) radiance, linear Rec. 709, as float32 channels R, G and B of scan lines with ZIP compression.

    metadata        : string attributes of the header
    window          : (x, y, width, height) of these pixels in the whole image, y from the top; the data window
    full_resolution : (width, height) of the whole image; the display window
    pixel_aspect    : width of a displayed pixel divided by its height, clipped to OpenEXR's range of 1e-6 to 1e6
    layers          : further images (H, W) or (H, W, k) by name; `layer_channels` gives the channels of a name
    channels        : further channels (H, W) by their full names in the file
    alpha           : (H, W) opacity, written as channel A; the colours do not change

    Raises ImageError for a file that cannot be written, and for arrays of other shapes.
    """
    import OpenEXR

    check_texts(metadata)
    pixels = np.ascontiguousarray(radiance, np.float32)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
        raise ImageError(
            f"{path}: found an array of shape {pixels.shape}, expected (H, W, 3).",
            "np.repeat(grey[..., None], 3, axis=-1) makes colours of grey values.",
        )
    for name, edges in (("window", window), ("full_resolution", full_resolution)):
        if edges is not None and not all(abs(edge) <= _MAX_EXR_EDGE for edge in edges):
            raise UsageError(f"{name}: {short_repr(edges)} where numbers up to {_MAX_EXR_EDGE:,} are needed")
    further = {"alpha": alpha, **(channels or {}), **(layers or {})}
    for name, plane in further.items():
        if plane is not None and np.shape(plane)[:2] != pixels.shape[:2]:
            raise ImageError(
                f"{path}: {name} is an array of shape {np.shape(plane)} beside colours of shape {pixels.shape}.",
                "Give an array of the same height and width.",
            )
    x, y = window[:2] if window else (0, 0)
    height, width = pixels.shape[:2]
    full_width, full_height = full_resolution or (x + width, y + height)
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "chromaticities": REC709_CHROMATICITIES,
        "dataWindow": _box(x, y, width, height),
        "displayWindow": _box(0, 0, full_width, full_height),
        "pixelAspectRatio": float(np.clip(pixel_aspect, 1 / _MAX_EXR_ASPECT, _MAX_EXR_ASPECT)),
        **(metadata or {}),
    }
    written = {"RGB": pixels} | {
        name: np.ascontiguousarray(channel, np.float32) for name, channel in (channels or {}).items()
    }
    if alpha is not None:
        written["A"] = np.ascontiguousarray(alpha, np.float32)
    for name, layer in (layers or {}).items():
        planes = layer[..., None] if layer.ndim == 2 else layer
        for i, channel in enumerate(layer_channels(name)):
            written[channel] = np.ascontiguousarray(planes[..., i], np.float32)
    with whole_file(path) as temporary, _openexr(temporary, os.O_RDWR | os.O_CREAT) as name:
        OpenEXR.File(header, written).write(name)


def layer_channels(name: str) -> list[str]:
    """Return the full channel names of a layer in an EXR.

    A layer NAME has the channels NAME.R, .G, .B for colours, .X, .Y, .Z for vectors, .Z for depths, and .X for
    other numbers. Nuke uses depth.Z, like Z, as its own depth. Blender and Natron show each layer as a pass.
    Integers are stored as float32, as in files of Blender and Cycles, because some readers support only one type of
    channel. float32 is exact for integers up to 2**24.
    """
    # A layer that is no AOV, such as "denoised", has colours.
    letters = AOV_KINDS[name].letters if name in AOV_KINDS else "RGB"
    return [f"{name}.{letter}" for letter in letters]


def _box(x: int, y: int, width: int, height: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return a window in OpenEXR's form, which is (x, y) of the first pixel and (x, y) of the last pixel."""
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)


def read_exr_channels(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, str]]:
    """Read all channels of an EXR by full name, (H, W) float32, and the texts of its header. Raises ImageError."""
    with reading(path, ".exr"):
        check_file(path)
        channels, header = _exr(Path(path))
        texts = {key: value for key, value in header.items() if isinstance(value, str)}
        return {name: pixels.astype(np.float32) for name, pixels in channels.items()}, texts


def read_exr(path: Path, convert: bool = True, display: bool = False, alpha: bool = False) -> Float64:
    channels, header = _exr(path)
    if not {"R", "G", "B"} <= channels.keys() and "Y" not in channels:
        raise ValueError(f"found the channels {', '.join(sorted(channels)) or 'none'}, expected R, G, B or Y")
    names = "RGB" if "R" in channels else "Y"
    colours = np.stack([channels[name] for name in names], axis=-1).astype(np.float64)
    matrix = matrix_to_rec709(header["chromaticities"]) if "chromaticities" in header else None
    if convert and names == "RGB" and matrix is not None:
        colours = colours @ matrix.T
    if alpha and "A" in channels:
        colours = np.dstack([np.broadcast_to(colours, (*colours.shape[:2], 3)), channels["A"]])
    return _in_display_window(colours, header, path) if display else colours


def _in_display_window(pixels: Float64, header: dict[str, Any], path: Path) -> Float64:
    """Return the pixels (H, W, C) of the display window of an EXR; zeros outside the data window.

    Raises ValueError if the display window is implausibly large for the file.
    """
    (left, top), _ = data = window_of(header, "dataWindow")
    (x, y), (right, bottom) = display = window_of(header, "displayWindow")
    if display == data or right < x or bottom < y:
        return pixels
    width, height = right - x + 1, bottom - y + 1
    check_unfolded(4 * width * height * pixels.shape[2], path.stat().st_size, FLOAT_PIXEL * width * height)
    result = np.zeros((height, width, pixels.shape[2]))
    visible = pixels[max(y - top, 0) : max(bottom + 1 - top, 0), max(x - left, 0) : max(right + 1 - left, 0)]
    row, column = max(top - y, 0), max(left - x, 0)
    result[row : row + visible.shape[0], column : column + visible.shape[1]] = visible
    return result


def window_of(header: dict[str, Any], name: str) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the (x, y) of the first and of the last pixel of a window of an EXR."""
    (left, top), (right, bottom) = (corner.astype(np.int64).tolist() for corner in header[name])
    return (left, top), (right, bottom)


def _exr(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the channels of an EXR by name, each (H, W), and the header."""
    import OpenEXR

    (height, width), header = exr_header(path)
    with _openexr(path) as name:
        channels = OpenEXR.File(name, separate_channels=True).channels()
    pixels = {name: np.asarray(channel.pixels) for name, channel in channels.items()}
    for name, array in pixels.items():
        if array.shape != (height, width) or array.dtype.kind not in "fiu":
            raise ValueError(f"its channel {name} is an array {array.shape} of {array.dtype}")
    return pixels, header


def exr_header(path: Path) -> tuple[tuple[int, int], dict[str, Any]]:
    """Read (height, width) and the header of the first part of an EXR.

    Raises ValueError if the file is too small for the pixels of all parts, because OpenEXR decodes all of them.
    """
    import OpenEXR

    with path.open("rb") as file:  # errors of the system are clearer than those of OpenEXR
        size = file.seek(0, 2)
        if size:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                _check_exr_entries(data)
    with _openexr(path) as name:
        headers = [part.header for part in OpenEXR.File(name, header_only=True).parts]
    sizes, unfolded, decoded = [], 0, 0
    for number, header in enumerate(headers, start=1):
        if header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
            raise ValueError(f"its part {number} has deep pixels, but only flat pixels are read")
        first, last = (corner.astype(np.int64) for corner in header["dataWindow"])
        width, height = (last - first + 1).tolist()
        channels = len(header["channels"])
        sizes.append((height, width))
        unfolded += width * height * 4 * channels
        decoded += width * height * max(8 * channels, FLOAT_PIXEL)
    check_unfolded(unfolded, size, decoded)
    return sizes[0], headers[0]


def _check_exr_entries(data: mmap.mmap) -> None:
    """Raise ValueError for a header with too many entries, because OpenEXR needs quadratic time to read them.

    An invalid header ends the check, because OpenEXR rejects it.

    Source: Academy Software Foundation, "OpenEXR File Layout".
    """
    is_multipart = data[5:6] >= b"\x10"
    position, entries = 8, 0
    while entries <= _MAX_EXR_ENTRIES:
        if data[position : position + 1] == b"\0":  # a zero byte ends the header of a part
            if not is_multipart or data[position + 1 : position + 2] in (b"", b"\0"):
                return
            position += 1
        name_end = data.find(b"\0", position, position + _MAX_EXR_NAME + 1)
        type_end = data.find(b"\0", name_end + 1, name_end + _MAX_EXR_NAME + 2)
        if min(name_end, type_end) < 0:
            return
        value = type_end + 5
        position = value + int.from_bytes(data[type_end + 1 : value], "little")
        entries += 1
        if data[name_end + 1 : type_end] == b"chlist":
            max_bytes = (_MAX_EXR_ENTRIES + 1) * (_MAX_EXR_NAME + 17)
            entries += len(_EXR_CHANNEL.findall(data, value, min(position, value + max_bytes)))
    raise ValueError(f"its header has more than {_MAX_EXR_ENTRIES:,} attributes and channels")


@contextmanager
def _openexr(path: Path, flags: int = os.O_RDONLY) -> Iterator[str]:
    """Context that yields a UTF-8 name for `path`, because OpenEXR opens no file by another name.

    In a command, lines that OpenEXR prints on errors are suppressed. In Python they are not, because other threads
    and child processes of the program may use standard output meanwhile.
    """
    with ExitStack() as stack:
        name = str(path)
        if name.encode(errors="surrogateescape") != name.encode(errors="replace"):
            descriptor = os.open(path, flags, 0o666)
            stack.callback(os.close, descriptor)
            name = f"/proc/self/fd/{descriptor}"
        if in_command():
            stack.enter_context(without_lines(f"{name}: (EXR_", "Warning: Exception raised reading pixel data"))
        yield name


_STDOUT, _STDERR = 1, 2


_lock = threading.Lock()


@contextmanager
def without_lines(*beginnings: str) -> Iterator[None]:
    """Context that drops lines with these beginnings from `sys.stdout` and from file descriptors 1 and 2.

    OpenEXR prints lines before it raises. They would appear before glpath's error message, or inside an image that
    is written to standard output. The filter applies to the whole process, so only commands use it.

    All other lines are written at the end. Lines from the descriptors go to standard error; they may include
    lines of other threads.
    """
    printed = io.StringIO()
    try:
        with _lock, _files_held(beginnings), contextlib.redirect_stdout(printed):
            yield
    finally:
        rest = [line for line in printed.getvalue().splitlines(True) if not line.startswith(beginnings)]
        if rest and sys.stdout is not None:
            with contextlib.suppress(OSError, ValueError):  # stdout is full or closed; it must not end the work
                sys.stdout.write("".join(rest))


@contextmanager
def _files_held(beginnings: tuple[str, ...]) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        _flush()
        try:
            held = stack.enter_context(tempfile.TemporaryFile())
            before = {number: os.dup(number) for number in (_STDOUT, _STDERR)}
        except OSError:  # a descriptor is closed, or no temporary file can be made: filter nothing
            yield
            return
        for number in before:
            os.dup2(held.fileno(), number)
        try:
            yield
        finally:
            _flush()
            for number, there in before.items():
                os.dup2(there, number)
                os.close(there)
            held.seek(0)
            dropped = tuple(os.fsencode(beginning) for beginning in beginnings)
            rest = b"".join(line for line in held if not line.startswith(dropped))
            with contextlib.suppress(OSError):
                write_report(_STDERR, rest)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # the stream may be closed, or no file
            stream.flush()
    with contextlib.suppress(OSError, AttributeError, TypeError):  # Windows cannot load a library without a name
        ctypes.CDLL(None).fflush(None)
