"""Parse the statements and numbers of the text formats OBJ, MTL, OFF, STL and PLY.

Statements may be indented, separated by tabs, continued on the next line after a backslash, and followed by
comments. Names, such as `Material #25`, are kept as written. Only a backslash after a blank continues the line of a
name, because a letter of Shift-JIS may end in that byte. The text is UTF-8, UTF-16 or, in old files, Latin-1.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from glpath.errors import warning_filter
from glpath.scene.source_location import SourceLocation
from glpath.system.numerals import real
from glpath.system.time_limit import check_time

# NaN as Microsoft's C libraries write it: `1.#QNAN` in the old library, where # begins no comment, and `nan(ind)`
# in the new one.
_NAN = re.compile(r"\b1\.#(?:QNAN|SNAN|IND)\d*|(?<![^\s+-])nan\(\w*\)(?!\S)", re.IGNORECASE)
# Infinity as the old library writes it, such as `1.#INF`.
_INFINITE = re.compile(r"\b1\.#(?:INF|J)\d*", re.IGNORECASE)
# Keywords of statements that hold a name. The name may look like a number or contain #.
_OF_NAMES = re.compile(
    r"\s*(map_\w+|bump|norm|disp|decal|refl|usemtl|newmtl|mtllib|usemap|maplib|[og])[ \t]", re.IGNORECASE
)
# Characters that separate words. Other blanks of Unicode, such as U+0085, are not among them, because in a text of
# unknown encoding they may be parts of letters.
_BLANKS = " \t"
_CONTINUED = tuple(f"{blank}\\" for blank in _BLANKS)
# First letters of the statements v, vt, vn and f, which make up most lines and never hold names.
_OF_NUMBERS = frozenset("vf")
# Number of lines between checks of the time limit.
_CHECKED_LINES = 1 << 13
# Minimum number of characters that are parsed between two checks of the time limit.
_PIECE = 1 << 22
_BLANK = re.compile(r"\s")


def statements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield each statement as the number of its first line, from 1, and its words.

    A statement with a name has two words: its keyword, and all that follows.
    """
    for number, line in _lines(text):
        if number % _CHECKED_LINES == 0:
            check_time()
        if words := line.split() if line[:1] in _OF_NUMBERS else _words(line):
            yield number, words


def _words(line: str) -> list[str]:
    if (match := _OF_NAMES.match(line)) is None:
        return line.split()
    return [match[1], line[match.end() :].strip(_BLANKS)]


def decoded(content: bytes) -> str:
    """Return the decoded text, without the Ctrl-Z that old programs write at the end.

    Geometry is ASCII in any encoding, so only names depend on the encoding.
    """
    text = _decoded(content)
    return text.rstrip("\x1a\r\n") if "\x1a" in text[-8:] else text


def _decoded(content: bytes) -> str:
    for mark, encoding in (
        (codecs.BOM_UTF8, "utf-8-sig"),
        (codecs.BOM_UTF16_LE, "utf-16"),
        (codecs.BOM_UTF16_BE, "utf-16"),
    ):
        if content.startswith(mark):
            return content.decode(encoding, errors="replace")
    if b"\0" in content[:2]:
        return content.decode("utf-16-be" if content[:1] == b"\0" else "utf-16-le", errors="replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def with_plain_nan(text: str) -> str:
    """Return the text with every NaN and infinity of Microsoft's C libraries spelt as `nan` and `inf`."""
    if "#" in text or "(" in text:
        return _INFINITE.sub("inf", _NAN.sub("nan", text))
    return text


def parse_numbers(text: str) -> NDArray[np.float64]:
    """Return the blank-separated numbers of a text. Raises ValueError with the first word that is no number."""
    if not text:
        return np.zeros(0)
    if len(text) <= _PIECE:
        return _parse_piece(text)
    return np.concatenate([_parse_piece(piece) for piece in _pieces(text)])


def _pieces(text: str) -> Iterator[str]:
    """Yield parts of a text that end at blanks, with a check of the time limit before each."""
    start = 0
    while start < len(text):
        check_time()
        blank = _BLANK.search(text, start + _PIECE)
        end = len(text) if blank is None else blank.end()
        yield text[start:end]
        start = end


def _parse_piece(text: str) -> NDArray[np.float64]:
    try:
        with warning_filter("error", DeprecationWarning):  # numpy before 2.3 only warns if a word is not a number
            return np.fromstring(text, sep=" ")
    except (ValueError, DeprecationWarning):
        return np.array([_number(word) for word in text.split()])


def parse_lines(texts: Iterable[str], lines: Iterable[int], source: str) -> NDArray[np.float64]:
    """Return the numbers of all texts in one array. Raises SceneError with the line of a word that is not a number.

    lines  : line number in the file, from 1, of each text
    source : name of the file
    """
    texts = list(texts)
    try:
        return parse_numbers(" ".join(texts))
    except ValueError as error:
        raise SourceLocation(source, f"line {list(lines)[first_wrong(texts)]}").error(
            f"has {error}.", "Numbers are of plain digits, such as 12, -0.5 or 1.5e-3."
        ) from error


def first_wrong(texts: Sequence[str]) -> int:
    """Return the index of the first text with a word that is not a number; one of the texts has such a word."""
    begin, end = 0, len(texts)
    while end - begin > 1:  # bisection, because many texts at once are parsed much faster than one by one
        check_time()
        middle = (begin + end) // 2
        try:
            parse_numbers(" ".join(texts[begin:middle]))
        except ValueError:
            end = middle
        else:
            begin = middle
    return begin


def _number(word: str) -> float:
    try:
        return real(word)
    except ValueError:
        raise ValueError(f'"{word[:40]}", which is not a number') from None


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield each statement as the number of its first line, from 1, and its text without comments."""
    begun, is_name = 0, False
    before: list[str] = []  # earlier lines of a statement that continues on this line
    # Not str.splitlines, which also splits at U+0085. In a text of unknown encoding it may be part of a letter.
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        begun, line = begun or number, line.rstrip(_BLANKS)
        if "#" in line or "(" in line or line.endswith("\\"):
            if len(before) < 2:  # the first line decides, so many further lines need no match
                is_name = _OF_NAMES.match(before[0] if before else line) is not None
            if not is_name:
                line = with_plain_nan(line).partition("#")[0].rstrip()
            if line.endswith(_CONTINUED if is_name else "\\"):
                if before or line[:-1].strip():
                    before.append(line[:-1] + " ")
                continue
        yield begun, "".join(before) + line
        begun, before = 0, []
    if before:
        yield begun, "".join(before)
