"""Statements and numbers of text formats: OBJ, MTL, OFF, STL and PLY.

Statements are indented, separated by tabs, continued on the next line after a backslash, followed by comments.
Names, such as `Material #25`, are as they are written: only a backslash between blanks continues their line, as a
letter of Shift-JIS may end in that byte. The text is UTF-8, UTF-16 or, in old files, Latin-1.
"""

from __future__ import annotations

import codecs
import re
import warnings
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from glpath.scene.source_location import SourceLocation
from glpath.system.numerals import real

# `1.#QNAN` and `1.#INF` of Microsoft's old C library, in which # begins no comment, and `nan(ind)` of its new one.
_NAN = re.compile(r"\b1\.#(?:QNAN|SNAN|IND)\d*|(?<![^\s+-])nan\([^)\s]*\)(?!\S)", re.IGNORECASE)
_INFINITE = re.compile(r"\b1\.#(?:INF|J)\d*", re.IGNORECASE)
# Statements of names, which may look like numbers and have # in them.
_OF_NAMES = re.compile(
    r"\s*(map_\w+|bump|norm|disp|decal|refl|usemtl|newmtl|mtllib|usemap|maplib|[og])[ \t]", re.IGNORECASE
)
# Others than these, such as U+0085, may be halves of letters in files of unknown encoding.
_BLANKS = " \t"
_CONTINUED = tuple(f"{blank}\\" for blank in _BLANKS)
# How most lines begin, which are never of names.
_OF_NUMBERS = frozenset("vf")


def statements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Return the words of each statement, and the number of the line on which it begins, from 1.

    A statement of names has two words: its keyword, and all that follows.
    """
    for number, line in _lines(text):
        if words := line.split() if line[:1] in _OF_NUMBERS else _words(line):
            yield number, words


def _words(line: str) -> list[str]:
    if (match := _OF_NAMES.match(line)) is None:
        return line.split()
    return [match[1], line[match.end() :].strip(_BLANKS)]


def decoded(content: bytes) -> str:
    """Return the text, whose geometry is ASCII in any case, without the Ctrl-Z by which old programs end it."""
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
    """Return text with NaN and infinity as `nan` and `inf`, however a C library wrote them."""
    if "#" in text or "(" in text:
        return _INFINITE.sub("inf", _NAN.sub("nan", text))
    return text


def parse_numbers(text: str) -> NDArray[np.float64]:
    """Return the numbers of a text, with blanks between them. Raises ValueError, which names another word."""
    if not text:
        return np.zeros(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # older releases of numpy warn
            return np.fromstring(text, sep=" ")
    except (ValueError, DeprecationWarning):
        return np.array([_number(word) for word in text.split()])


def parse_lines(texts: Iterable[str], lines: Iterable[int], source: str) -> NDArray[np.float64]:
    """Return the numbers of texts, one text after the other. Raises SceneError, with the line, for other words.

    lines  : of the file, from 1, for each text
    source : the file
    """
    texts = list(texts)
    try:
        return parse_numbers(" ".join(texts))
    except ValueError:
        for text, line in zip(texts, lines, strict=True):
            try:
                parse_numbers(text)
            except ValueError as error:
                raise SourceLocation(source, f"line {line}").error(
                    f"has {error}.", "Numbers are of plain digits, such as 12, -0.5 or 1.5e-3."
                ) from error
        raise


def _number(word: str) -> float:
    try:
        return real(word)
    except ValueError:
        raise ValueError(f'"{word[:40]}", which is not a number') from None


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Statements without comments, and the number of the line on which each begins, from 1."""
    begun, before = 0, ""
    # Not splitlines, which knows ends of lines that are letters in Latin-1.
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        begun, line = begun or number, line.rstrip(_BLANKS)
        if "#" in line or "(" in line or line.endswith("\\"):
            is_name = _OF_NAMES.match(before or line) is not None
            if not is_name:
                line = with_plain_nan(line).partition("#")[0].rstrip()
            if line.endswith(_CONTINUED if is_name else "\\"):
                before += line[:-1] + " "
                continue
        yield begun, before + line
        begun, before = 0, ""
    if before:
        yield begun, before
