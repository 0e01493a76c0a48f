"""Parsers of numbers in texts from users or files, which accept only ASCII digits.

Python's `int` and `float` also accept underscores and digits of other scripts. They accept integers of thousands of
digits, which no array and no formula here can hold.
"""

from __future__ import annotations

# Maximum number of digits that always fits in 64 bits.
_MAX_DIGITS = 18


def whole(text: str) -> int:
    """Return a whole number of at most 18 digits. Raises ValueError."""
    if len(text.strip().lstrip("+-")) > _MAX_DIGITS:
        raise ValueError(f"a number of more than {_MAX_DIGITS} digits")
    return int(_plain(text))


def real(text: str) -> float:
    """Return a number, which may be infinite or NaN. Raises ValueError."""
    return float(_plain(text))


def _plain(text: str) -> str:
    if not text.isascii() or "_" in text:
        raise ValueError(f"{text[:20]!r} is no number of plain digits")
    return text
