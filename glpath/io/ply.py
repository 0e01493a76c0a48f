"""Read ASCII or binary PLY files. Each scalar or list property of an element becomes an array.

Source: Turk, The PLY Polygon File Format, 1994.
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.text import decoded, first_wrong, parse_numbers, with_plain_nan
from glpath.io.values import as_float64
from glpath.system.numerals import unsigned
from glpath.system.time_limit import check_time

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_TYPES |= {"float": "f4", "double": "f8", "float16": "f2", "float32": "f4", "float64": "f8"}
_TYPES |= {f"{sign}int{8 * size}": f"{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4, 8)}
# Format codes of the module `struct`, by kind and size in bytes of a numpy type.
_CODES = {("i", 1): "b", ("i", 2): "h", ("i", 4): "i", ("i", 8): "q", ("f", 2): "e", ("f", 4): "f", ("f", 8): "d"}
_CODES |= {("u", size): code.upper() for (kind, size), code in _CODES.items() if kind == "i"}
# Byte order of numbers in each format; ASCII numbers are parsed as native doubles.
_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"(?:^|[\r\n])[ \t]*end_header[ \t]*(?=[\r\n]|$)")
_LINE_END = re.compile(rb"\r\n|\n|\r")
_TEXTURE = re.compile(r"TextureFile\s(.*)")
#: Maximum number of properties of an element.
MAX_PROPERTIES = 4096
# Maximum length of lists in rows that are read together as a table. Rows with longer lists are read one by one.
_MAX_UNIFORM = 1 << 12
# Number of list values that are gathered at once; index arrays for more values do not fit into the CPU's cache.
_BLOCK = 1 << 18
# Number of rows with lists of different lengths between checks of the time limit.
_CHECKED_ROWS = 1 << 14


@dataclass(frozen=True)
class Ragged:
    """List property of all rows. Lists may differ in length; their values are stored one after the other.

    counts : (rows,) int64, length of each list
    values : (sum of counts,)
    """

    counts: Int64
    values: NDArray[Any]


@dataclass(frozen=True)
class Element:
    """Rows of one PLY element, such as the vertices. Property names are in lower case.

    count   : number of rows
    columns : (count,) array of each scalar property, by name; may be a view of a binary file's bytes
    lists   : list properties, by name
    types   : numpy codes of the scalar properties as the header declares them, such as "u2", by name
    """

    count: int = 0
    columns: dict[str, NDArray[Any]] = field(default_factory=dict)
    lists: dict[str, Ragged] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)

    def stacked(self, names: Sequence[str]) -> Float64:
        """Return the named scalar properties as the columns of a (count, len(names)) float64 array."""
        return np.stack([as_float64(self.columns[name]) for name in names], axis=1)

    def first_of(self, *choices: tuple[str, ...]) -> tuple[str, ...]:
        """Return the first of several tuples of names that are all scalar properties; () if there is none."""
        return next((names for names in choices if all(name in self.columns for name in names)), ())


@dataclass(frozen=True)
class _Property:
    """Declaration of a property.

    type       : numpy code of the values, such as "f4"
    count_type : numpy code of a list's length; empty for a scalar property
    """

    name: str
    type: str
    count_type: str = ""


@dataclass(frozen=True)
class Header:
    """Declarations at the beginning of a file.

    format   : ascii, binary_little_endian or binary_big_endian
    elements : (name, count, properties) in the order of the file
    textures : names of texture files, from comments of the form "TextureFile NAME"
    start    : offset of the data in bytes
    lines    : number of lines of the header
    """

    format: str
    elements: list[tuple[str, int, list[_Property]]]
    textures: list[str]
    start: int
    lines: int

    def count(self, *names: str) -> int:
        """Return the total number of rows of the elements with these names."""
        return sum(count for name, count, _ in self.elements if name in names)


def read_header(content: bytes) -> Header:
    """Return the header of a file. Raises ValueError if it is invalid."""
    end = _END.search(content)
    if not content.removeprefix(b"\xef\xbb\xbf").startswith(b"ply"):
        raise ValueError('it does not begin with "ply"')
    if end is None:
        raise ValueError("its header has no end_header")
    lines = _LINE_END.split(content[: end.end()])
    # Files of old Macs end lines with \r alone, so a \n after their header is the first byte of the data.
    line_end = _LINE_END.match(content, end.end())
    start = end.end()
    if line_end is not None:
        start = start + 1 if b"\n" not in content[: end.end()] else line_end.end()
    format_name = ""
    elements: list[tuple[str, int, list[_Property]]] = []
    textures = []
    for number, raw in enumerate(lines[1:-1], start=2):
        line = decoded(raw)
        match line.split():
            case ["comment" | "obj_info", *_]:
                if (named := _TEXTURE.search(line)) and (name := named[1].strip()):
                    textures.append(name)
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as name, *_]:
                format_name = name
            case ["element", name, text] if (count := unsigned(text)) is not None:
                elements.append((name.lower(), count, []))
            case ["property", kind, name] if kind in _TYPES and elements:
                elements[-1][2].append(_Property(name.lower(), _TYPES[kind]))
            case ["property", "list", length, kind, name] if length in _TYPES and kind in _TYPES and elements:
                elements[-1][2].append(_Property(name.lower(), _TYPES[kind], _TYPES[length]))
            case []:
                pass
            case _:
                raise ValueError(
                    f'line {number} of its header is "{line[:60]}", but must be comment, format (one of '
                    f"{', '.join(_ORDERS)}), element NAME COUNT, property TYPE NAME or "
                    f"property list TYPE TYPE NAME (types: {', '.join(_TYPES)})"
                )
        if elements and len(elements[-1][2]) > MAX_PROPERTIES:
            raise ValueError(f"its element {elements[-1][0]} has more than {MAX_PROPERTIES:,} properties")
    if not format_name:
        raise ValueError(f"its header has no line for the format, which is one of {', '.join(_ORDERS)}")
    return Header(format_name, elements, textures, start, len(lines))


def read_elements(content: bytes, header: Header) -> tuple[dict[str, Element], int]:
    """Return the elements by name, and the size of the data after the last element.

    The size is in bytes for a binary file, and in numbers for an ASCII file.

    Raises ValueError if the file holds fewer rows than the header announces.
    """
    order = _ORDERS[header.format]
    is_ascii = header.format == "ascii"
    if is_ascii:
        numbers = _parsed(content[header.start :], header.lines + 1)
        data: Bytes = numbers.view(np.uint8)
        at = 0
    else:
        data, at = np.frombuffer(content, np.uint8), header.start
    elements: dict[str, Element] = {}
    for name, count, properties in header.elements:
        typed = [
            _Property(
                each.name,
                "=f8" if is_ascii else order + each.type,
                each.count_type and ("=f8" if is_ascii else order + each.count_type),
            )
            for each in properties
        ]
        element, at = _read_rows(name, count, typed, data, at)
        element.types.update({each.name: each.type for each in properties if not each.count_type})
        elements.setdefault(name, element)
    if is_ascii:
        return elements, (len(data) - at) // 8
    return elements, len(content[at:].strip(b"\0\r\n\t "))


def _parsed(body: bytes, first_line: int) -> Float64:
    """Parse ASCII data that begin at line `first_line`. Raises ValueError for a word that is not a number."""
    text = with_plain_nan(decoded(body)).replace("\r\n", "\n").replace("\r", "\n")
    try:
        return parse_numbers(text.strip())
    except ValueError as error:
        number = first_line + first_wrong(text.split("\n"))
        raise ValueError(f"line {number} has {error}") from None


def _read_rows(name: str, count: int, properties: list[_Property], data: Bytes, at: int) -> tuple[Element, int]:
    """Return an element whose data begin at byte `at`, and the offset of the first byte after its data."""
    min_size = sum(np.dtype(each.count_type or each.type).itemsize for each in properties)
    if count * min_size > len(data) - at:
        raise _too_short(name, count, (len(data) - at) // min_size)
    if not count or not properties:
        return Element(count), at
    return _uniform_rows(count, properties, data, at) or _ragged_rows(name, count, properties, data, at)


def _uniform_rows(count: int, properties: list[_Property], data: Bytes, at: int) -> tuple[Element, int] | None:
    """Return an element whose lists have the same lengths in every row, and the offset of the byte after its data.

    Returns None if the lengths differ between rows, or exceed `_MAX_UNIFORM` or the data.
    """
    fields: list[Any] = []
    lengths: dict[int, int] = {}
    end = at
    for i, each in enumerate(properties):
        size = np.dtype(each.type).itemsize
        if each.count_type:
            length = _length_at(data, end, each.count_type)
            if not 0 <= length <= _MAX_UNIFORM:
                return None
            lengths[i] = int(length)
            fields += [(f"n{i}", each.count_type), (f"{i}", each.type, (lengths[i],))]
            size = np.dtype(each.count_type).itemsize + size * lengths[i]
        else:
            fields.append((f"{i}", each.type))
        end += size
    if at + count * (end - at) > len(data):
        return None
    table = np.ndarray((count,), np.dtype(fields), data.data, at)
    if not all((table[f"n{i}"] == length).all() for i, length in lengths.items()):
        return None
    element = Element(count)
    for i, each in enumerate(properties):
        values = table[f"{i}"]
        if i in lengths:
            element.lists.setdefault(each.name, Ragged(np.full(count, lengths[i]), values.ravel()))
        else:
            element.columns.setdefault(each.name, values)
    return element, at + count * (end - at)


def _length_at(data: Bytes, at: int, kind: str) -> float:
    """Return the length of a list that is stored at byte `at`; -1 if the data end before it."""
    if at + np.dtype(kind).itemsize > len(data):
        return -1
    return float(np.ndarray((), kind, data.data, at))


def _ragged_rows(name: str, count: int, properties: list[_Property], data: Bytes, at: int) -> tuple[Element, int]:
    """Read an element row by row, because its lists differ in length. Return it and the byte offset after it."""
    lists = [each for each in properties if each.count_type]
    # For each list: total size of the scalars before it, function that unpacks its length, size of the length, and
    # size of a value. Sizes are in bytes.
    steps: list[tuple[int, Any, int, int]] = []
    begins, counts = [array("q") for _ in lists], [array("q") for _ in lists]
    scalars: list[list[tuple[_Property, int]]] = [[]]  # scalars and offsets before each list, and after the last
    skip = 0
    for each in properties:
        size = np.dtype(each.type).itemsize
        if not each.count_type:
            scalars[-1].append((each, skip))
            skip += size
            continue
        length = np.dtype(each.count_type)
        order = "<" if length.newbyteorder("<") == length else ">"
        steps.append(
            (skip, struct.Struct(order + _CODES[length.kind, length.itemsize]).unpack_from, length.itemsize, size)
        )
        scalars.append([])
        skip = 0
    row = 0
    try:
        while row < count:
            if row % _CHECKED_ROWS == 0:
                check_time()
            for (before, unpack, length_size, size), starts, lengths in zip(steps, begins, counts, strict=True):
                at += before
                n = int(unpack(data, at)[0])
                if n < 0:
                    raise ValueError
                at += length_size
                starts.append(at)
                lengths.append(n)
                at += n * size
            at += skip
            if at > len(data):
                raise struct.error
            row += 1
    except (struct.error, OverflowError):
        raise _too_short(name, count, row) from None
    except ValueError:
        raise ValueError(f"row {row} of its element {name} has a list whose length is not 0 or more") from None
    element = Element(count)
    before, _, length_size, _ = steps[0]
    ends = np.frombuffer(begins[0], np.int64) - length_size - before
    for index, group in enumerate(scalars):
        for each, offset in group:
            values = _gathered(data, ends + offset, np.ones(count, np.int64), each.type)
            element.columns.setdefault(each.name, values)
        if index < len(lists):
            of_lists, lengths_of = (np.frombuffer(each[index], np.int64) for each in (begins, counts))
            values = _gathered(data, of_lists, lengths_of, lists[index].type)
            element.lists.setdefault(lists[index].name, Ragged(lengths_of, values))
            ends = of_lists + steps[index][3] * lengths_of
    return element, at


def _gathered(data: Bytes, starts: Int64, counts: Int64, kind: str) -> NDArray[Any]:
    """Concatenate runs of values of type `kind`. Run i has `counts[i]` values and begins at byte `starts[i]`."""
    size = np.dtype(kind).itemsize
    offsets = np.repeat(starts - size * (np.cumsum(counts) - counts), counts) + size * np.arange(counts.sum())
    blocks = [
        data[offsets[first : first + _BLOCK, None] + np.arange(size)].view(kind).ravel()
        for first in range(0, len(offsets), _BLOCK)
    ]
    return np.concatenate(blocks) if blocks else np.zeros(0, kind)


def _too_short(name: str, count: int, found: int) -> ValueError:
    return ValueError(
        f"its header announces {count:,} rows of the element {name}, but the file ends after {found:,}"
    )
