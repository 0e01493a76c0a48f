"""Parsers of numbers in texts from users or files, which accept only ASCII digits.

Python's `int` and `float` also accept underscores, digits of other scripts, and integers of thousands of digits.
Arrays and formulas cannot hold such integers.
"""

from __future__ import annotations

# Maximum number of digits of an integer; 18 digits always fit into 64 bits.
_MAX_DIGITS = 18


def whole(text: str) -> int:
    """Return a whole number of at most 18 digits. Raises ValueError."""
    if len(text.strip().lstrip("+-")) > _MAX_DIGITS:
        raise ValueError(f"a number of more than {_MAX_DIGITS} digits")
    return int(_plain(text))


def unsigned(text: str) -> int | None:
    """Return a whole number of at most 18 digits and no other characters; None for any other text."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= _MAX_DIGITS else None


def real(text: str) -> float:
    """Return a number, which may be infinite or NaN. Raises ValueError."""
    return float(_plain(text))


def _plain(text: str) -> str:
    if not text.isascii() or "_" in text:
        raise ValueError(f"{text[:20]!r} is no number of plain digits")
    return text
