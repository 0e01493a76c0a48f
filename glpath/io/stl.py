"""Read STL files as arrays, binary or ASCII, also files with wrong counts or ends.

A binary file has a header of 80 bytes, the number of facets, and 50 bytes for each facet. If its length does not
match that number, the complete facets are read, with a warning.

Source: 3D Systems, StereoLithography Interface Specification, 1989.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import warn
from glpath.io.polygons import split_finite
from glpath.io.text import decoded, parse_lines, parse_numbers, with_plain_nan
from glpath.io.values import MAX_PARTS, as_float64
from glpath.scene.geometry import Float64
from glpath.scene.source_location import SourceLocation
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]

_HEADER = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
# Maximum coordinate of facets beyond the announced count, as a multiple of the largest coordinate of counted
# facets. If a coordinate is above it, the bytes beyond the count are taken for other data.
_MAX_GROWTH = 100.0
# Number of bytes at the start of a file that show if it is ASCII. In an ASCII file they have no zero byte, and they
# contain "facet" or start with "solid".
_BEGINNING = 1024
# Number of facets between checks of the time limit.
_CHECKED_FACETS = 1 << 14
# solid or endsolid with the name behind it, up to the end of the line or to a facet in the same line. The name may
# contain words of the format.
_SOLID = re.compile(r"\b(?:end)?solid\b[^\n]*?(?=\bfacet\s+(?:normal\s+(?:[-+.\d]|nan|inf)|outer\s+loop)|\n|$)")


@dataclass(frozen=True)
class Facets:
    """Triangles of an STL file, or of a solid in an ASCII file.

    corners    : (F, 3, 3) positions
    attributes : (F,) uint16 at the end of each binary facet, which some programs use for colours; None in ASCII
    header     : first 80 bytes of a binary file
    """

    corners: Float64
    attributes: NDArray[np.uint16] | None = None
    header: bytes = b""


def read_stl(content: bytes, source: str) -> list[Facets]:
    """Return the solids of a file; a binary file has one. Warns of parts that are left out. Raises ValueError.

    source : name of the file, for warnings
    """
    count = int.from_bytes(content[80:_HEADER], "little")
    is_exact = len(content) >= _HEADER and len(content) == _HEADER + _FACET.itemsize * count
    beginning = decoded(content[:_BEGINNING]).lower()
    is_text = "\0" not in beginning and ("facet" in beginning or beginning.lstrip().startswith("solid"))
    if is_text and not is_exact:
        return _read_ascii(content, source)
    if len(content) < _HEADER:
        raise ValueError(f"it has {len(content)} bytes, but a binary file has {_HEADER} at least")
    if is_exact:
        rows: NDArray[Any] | None = np.frombuffer(content, _FACET, count, _HEADER)
    else:
        rows = _rows_with_payload(content, count, source)
    if rows is None:
        rows = _whole_rows(content, count, source)
    positions = as_float64(rows["corners"]).reshape(-1, 3)
    split = split_finite(source, positions, np.arange(len(positions)), np.full(len(rows), 3))
    return [Facets(positions[split.triangles], rows["attribute"][split.polygons], content[:80])]


def _whole_rows(content: bytes, count: int, source: str) -> NDArray[Any]:
    """Return the complete facets of a binary file whose header announces a wrong number of facets, and warn."""
    whole, rest = divmod(len(content) - _HEADER, _FACET.itemsize)
    rows = np.frombuffer(content, _FACET, whole, _HEADER)
    read = whole if count == 0 else min(count, whole)
    if read < whole and not rest:  # the bytes behind the counted facets are further facets or other data
        bounds = np.abs(rows["corners"][:read]).max(initial=0.0)
        if np.all(np.abs(rows["corners"][read:]) <= _MAX_GROWTH * bounds):
            read = whole
    behind = len(content) - _HEADER - read * _FACET.itemsize
    more = f", and {behind:,} bytes behind them are not" if behind else ""
    warn(f"{source}: its header announces {count:,} facets, but {read:,} whole ones are read{more}.")
    return rows[:read]


def _rows_with_payload(content: bytes, count: int, source: str) -> NDArray[Any] | None:
    """Return the facets of a binary file in which `attribute` counts bytes after a facet; None for other files."""
    if not 0 < count <= (len(content) - _HEADER) // _FACET.itemsize:
        return None
    starts, at, last = [], _HEADER, len(content) - _FACET.itemsize
    for facet in range(count):
        if facet % _CHECKED_FACETS == 0:
            check_time()
        if at > last:
            return None
        starts.append(at)
        at += _FACET.itemsize + int.from_bytes(content[at + 48 : at + 50], "little")
    if at != len(content):
        return None
    payload = len(content) - _HEADER - count * _FACET.itemsize
    warn(f"{source}: {payload:,} bytes of attributes behind its {count:,} facets are not used.")
    stored = np.frombuffer(content, np.uint8)
    bytes_of_rows = stored[np.array(starts)[:, None] + np.arange(_FACET.itemsize)]
    rows = bytes_of_rows.view(_FACET)[:, 0]
    rows["attribute"] = 0  # the 16-bit words were byte counts, not colours
    return rows


def _read_ascii(content: bytes, source: str) -> list[Facets]:
    text = with_plain_nan(decoded(content)).lower().replace("\r\n", "\n").replace("\r", "\n")
    check_time()
    solids, cut, facets = [], 0, 0
    for solid in _SOLID.split(text):
        check_time()
        parts = solid.split("vertex")[1:]
        ends = [index + 1 for index, part in enumerate(parts) if "endloop" in part]
        if not ends:  # some programs omit the loops
            ends = list(range(3, len(parts) + 1, 3))
        cut += len(parts) - max(ends, default=0)
        if not ends:
            continue
        sizes = np.diff(ends, prepend=0)
        facets += len(sizes)
        try:
            positions = parse_numbers(" ".join(_corner_texts(parts[: ends[-1]]))).reshape(ends[-1], 3)
        except ValueError:
            _check_lines(text, source)
            raise
        solids.append((positions, sizes))
        if len(solids) > MAX_PARTS:
            raise ValueError(f"it has more than {MAX_PARTS:,} solids, and no more are read")
    missing = len(solids) - text.count("endsolid")
    if missing > 0 or cut:
        left_out = f", and {cut:,} corners of one that is not whole are left out" if cut else ""
        warn(f"{source}: ends without endsolid: {facets:,} whole facets are read{left_out}.")
    if not solids:
        return []
    return _finite_facets([positions for positions, _ in solids], [sizes for _, sizes in solids], source)


def _corner_texts(parts: list[str]) -> Iterator[str]:
    """Yield the text of each corner's position; checks the time limit."""
    for corner, part in enumerate(parts):
        if corner % _CHECKED_FACETS == 0:
            check_time()
        yield _first_three(part)


def _first_three(text: str) -> str:
    return " ".join(text.split(None, 3)[:3])


def _check_lines(text: str, source: str) -> None:
    """Raise SceneError for the first line that has a vertex without three numbers."""
    texts, lines = [], []
    for number, line in enumerate(text.split("\n"), start=1):
        if number % _CHECKED_FACETS == 0:
            check_time()
        for part in _SOLID.sub("", line).split("vertex")[1:]:
            texts.append(_first_three(part))
            lines.append(number)
    start = 0
    for end in [*(end for end, words in enumerate(texts, start=1) if words.count(" ") < 2), len(texts)]:
        parse_lines(texts[start:end], lines[start:end], source)
        found = parse_numbers(texts[end - 1]) if end else ()
        if end and len(found) < 3:
            raise SourceLocation(source, f"line {lines[end - 1]}").error(
                f"has {len(found)} numbers, but a vertex has 3: x, y and z."
            )
        start = end


def _finite_facets(positions: list[Float64], sizes: list[Int64], source: str) -> list[Facets]:
    """Return a `Facets` for each solid, without facets whose vertices are not all finite."""
    joined, counts = np.concatenate(positions), np.concatenate(sizes)
    split = split_finite(source, joined, np.arange(len(joined)), counts)
    ends = np.cumsum([len(each) for each in sizes])
    # The triangles are in the order of the facets.
    starts_of_solids = np.searchsorted(split.polygons, ends[:-1])
    return [Facets(corners) for corners in np.split(joined[split.triangles], starts_of_solids)]
