"""Image files of the renderer Radiance (.hdr, .pic): colours as three 8-bit mantissas and one exponent.

Source: Ward 1991, Real pixels (Graphics Gems II); Radiance's color.c and resolu.c, for the formats of its lines.
        Values are mantissa times 2^(exponent - 136), as in most programs; Radiance itself adds half a mantissa.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.system.files import open_file
from glpath.system.npz import check_unfolded
from glpath.system.time_limit import check_time

_LONGEST_HEADER = 1 << 16
# Number of values of each header line that changes colours.
_COUNTS = {b"EXPOSURE": 1, b"COLORCORR": 3, b"PRIMARIES": 8}
_RESOLUTION = re.compile(rb"([-+][XY]) (\d{1,9}) ([-+][XY]) (\d{1,9})\n?")
# Minimum width in pixels of run-length encoded lines. Narrower lines are always stored flat.
_MIN_ENCODED = 8
# Maximum width in pixels of run-length encoded lines. The two bytes for the width cannot hold more.
_MAX_ENCODED = 0x7FFF
# Bytes of memory for a decoded pixel: three floats.
_PIXEL_BYTES = 12
# Minimum number of rows that are converted to floats at once, and approximate number of pixels. More of them need
# more memory and are not faster.
_ROWS, _BLOCK_PIXELS = 64, 1 << 16


class Header(NamedTuple):
    """Header of a .hdr file, which precedes the pixels.

    size     : (width, height), pixels
    flips    : two bool: True if columns run from right to left, and True if rows run from bottom to top
    exposure : factors of red, green and blue by which the stored values were multiplied
    primaries : chromaticities x and y of red, green, blue and white; None if the header has none, or only zeros
    """

    size: tuple[int, int]
    flips: tuple[bool, bool]
    exposure: tuple[float, float, float]
    primaries: tuple[float, ...] | None


def read_header(file: BinaryIO) -> Header:
    """Read the header of an open file and stop at the start of the pixels. Raises ValueError."""
    if not file.readline(80).startswith(b"#?"):
        raise ValueError("it does not begin with #?RADIANCE")
    exposure, read = (1.0, 1.0, 1.0), 0
    primaries: tuple[float, ...] | None = None
    while (line := file.readline(_LONGEST_HEADER)).strip():
        read += len(line)
        if read > _LONGEST_HEADER:
            raise ValueError("its header has no end")
        key, _, value = line.strip().partition(b"=")
        if key == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise ValueError(f"its FORMAT is {value.decode('latin-1')}, expected 32-bit_rle_rgbe")
        if key in _COUNTS:
            try:
                numbers = [float(word) for word in value.split()]
            except ValueError:
                numbers = []
            valid = len(numbers) == _COUNTS[key] and bool(np.isfinite(numbers).all())
            if key == b"PRIMARIES":
                # Some programs write eight zeros for unknown primaries.
                primaries = tuple(numbers) if valid and any(numbers) else None
                continue
            if not valid:
                raise ValueError(f"its {line.decode('latin-1').strip()[:80]} has not {_COUNTS[key]} finite numbers")
            red, green, blue = numbers if len(numbers) == 3 else numbers * 3
            exposure = exposure[0] * red, exposure[1] * green, exposure[2] * blue
    for factor in exposure:
        if not 0 < factor < np.inf:
            raise ValueError(f"its EXPOSURE times COLORCORR is {factor:g}")
    line = file.readline(80)
    found = _RESOLUTION.fullmatch(line)
    if found is None or found[1][1:] != b"Y" or found[3][1:] != b"X":
        raise ValueError(f"its size is {line.decode('latin-1').strip()!r}, expected rows as in '-Y 512 +X 1024'")
    width, height = int(found[4]), int(found[2])
    if not width * height:
        raise ValueError(f"it is {width} x {height} pixels")
    return Header((width, height), (found[3][:1] == b"-", found[1][:1] == b"+"), exposure, primaries)


def read_rgbe(path: Path) -> tuple[NDArray[np.float32], tuple[float, ...] | None]:
    """Read the colours of a file, and the primaries that its header states, as in `Header`. Raises ValueError.

    Colours are (h, w, 3) float32 linear RGB, row 0 at the top, divided by EXPOSURE and COLORCORR of the header.
    """
    with open_file(path) as file:
        header = read_header(file)
        data = file.read()
    width, height = header.size
    check_unfolded(4 * width * height, len(data), _PIXEL_BYTES * width * height)
    colours = np.empty((height, width, 3), np.float32)
    exposure = np.float32(header.exposure[0])
    balance = np.array(header.exposure, np.float32) / exposure
    rows = max(_ROWS, _BLOCK_PIXELS // width)
    pixels = np.empty((rows, width, 4), np.uint8)
    position = 0
    for top in range(0, height, rows):
        check_time()
        block = pixels[: height - top]
        if _is_plain(data, position, block.shape):
            block[:] = np.frombuffer(data, np.uint8, block.size, position).reshape(block.shape)
            position += block.size
        else:
            for row in block:
                position = _read_line(data, position, row)
        scale = np.ldexp(np.float32(1.0), block[..., 3].astype(np.int32) - 136) / exposure
        scale[block[..., 3] == 0] = 0.0
        np.multiply(block[..., :3], scale[..., None], out=colours[top : top + rows], dtype=np.float32)
    if (balance != 1).any():
        colours /= balance
    left, upwards = header.flips
    return np.ascontiguousarray(colours[:: -1 if upwards else 1, :: -1 if left else 1]), header.primaries


def _is_plain(data: bytes, position: int, shape: tuple[int, ...]) -> bool:
    """Return True if the next rows of a picture are four bytes a pixel, without run lengths and repeated pixels.

    shape : (rows, w, 4)
    """
    size, width = math.prod(shape), shape[1]
    if _is_encoded(data[position : position + 4], width) or len(data) - position < size:
        return False
    stored = np.frombuffer(data, np.uint8, size, position).reshape(shape)
    heads = stored[:, 0]
    encoded = (heads[:, 0] == 2) & (heads[:, 1] == 2) & (heads[:, 2] < 128)
    if _MIN_ENCODED <= width <= _MAX_ENCODED and encoded.any():
        return False
    ones = stored == 1
    return not (ones[..., 0] & ones[..., 1] & ones[..., 2]).any()


def _is_encoded(head: bytes, width: int) -> bool:
    """Return True if a line of `width` pixels that starts with the bytes `head` is run-length encoded."""
    return head[:2] == b"\2\2" and _MIN_ENCODED <= width <= _MAX_ENCODED and head[2] < 128


def _read_line(data: bytes, position: int, row: NDArray[np.uint8]) -> int:
    """Decode the line that starts at `position` into `row` (w, 4), and return the start of the next line."""
    width = len(row)
    head = data[position : position + 4]
    if not _is_encoded(head, width):
        return _read_flat_line(data, position, row)
    if int.from_bytes(head[2:]) != width:
        raise ValueError(f"a line is {int.from_bytes(head[2:])} pixels long, expected {width}")
    position += 4
    for channel in range(4):
        line = bytearray()
        while len(line) < width:
            count = data[position] if position < len(data) else 0
            if count > 128:
                line += data[position + 1 : position + 2] * (count - 128)
                position += 2
            elif count:
                line += data[position + 1 : position + 1 + count]
                position += 1 + count
            else:
                raise ValueError("it is cut off" if position >= len(data) else "a run has no length")
        if len(line) != width or position > len(data):
            raise ValueError("it is cut off" if position > len(data) else "a run goes beyond its line")
        row[:, channel] = np.frombuffer(line, np.uint8)
    return position


def _read_flat_line(data: bytes, position: int, row: NDArray[np.uint8]) -> int:
    """Decode a line of four-byte pixels from `position` into `row`, and return the start of the next line.

    A pixel (1, 1, 1, n) repeats the previous pixel n times. Each further such pixel directly after it counts 256
    times as much.
    """
    filled, shift, width = 0, 0, len(row)
    rest = np.frombuffer(data, np.uint8, offset=position)
    rest = rest[: len(rest) // 4 * 4].reshape(-1, 4)
    repeats = np.flatnonzero((rest[:width, :3] == 1).all(axis=1))
    consumed = 0
    for at in repeats:
        if consumed + (width - filled) <= at:
            break
        row[filled : filled + at - consumed] = rest[consumed:at]
        filled += int(at) - consumed
        shift = shift if consumed == at and consumed else 0
        count = int(rest[at, 3]) << shift
        if not filled or filled + count > width:
            raise ValueError("a run goes beyond its line" if filled else "a run repeats nothing")
        row[filled : filled + count] = row[filled - 1]
        filled, consumed, shift = filled + count, int(at) + 1, shift + 8
    if len(rest) - consumed < width - filled:
        raise ValueError("it is cut off")
    row[filled:] = rest[consumed : consumed + width - filled]
    return position + 4 * (consumed + width - filled)
