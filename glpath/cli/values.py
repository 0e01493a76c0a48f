"""Conversion of command-line values to Python, with a UsageError that names the option."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, Literal

from glpath.errors import UsageError
from glpath.system.numerals import real, whole

Vector = tuple[float, float, float]

_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


def check_choice(option: str, found: str, allowed: Sequence[str]) -> None:
    """Raise UsageError unless `found` is one of `allowed`."""
    if found not in allowed:
        raise UsageError(f"{option} {found}: there is no such choice. Allowed: {', '.join(allowed)}.")


def check_spp(spp: int | None) -> None:
    """Raise UsageError if --spp is given and below 1."""
    if spp is not None and spp < 1:
        raise UsageError(f"--spp {spp}: must be at least 1.")


def numbers(
    option: str, text: str, form: str, counts: Sequence[int], kind: Callable[[str], float], separator: str = ","
) -> list[Any]:
    """Return the numbers in a text. Raises UsageError if one is not finite or their count is not in `counts`.

    form : expected form of the text, for the message, such as X,Y,Z
    kind : function that converts the text of one number
    """
    try:
        found = [kind(part) for part in text.split(separator)]
        finite = all(map(math.isfinite, found))
    except (ValueError, OverflowError):  # OverflowError for an integer that no float holds
        found, finite = [], False
    if len(found) not in counts or not finite:
        raise UsageError(f"{option} {text}: expected {form} in finite numbers.")
    return found


def vector(option: str, text: str | None) -> Vector | None:
    """Return the vector X,Y,Z; None if `text` is None. Raises UsageError."""
    if text is None:
        return None
    x, y, z = numbers(option, text, "X,Y,Z", [3], real)
    return x, y, z


def shutter(text: str) -> tuple[float, float]:
    """Return the two times T,T of --camera-shutter. Raises UsageError."""
    opened, closed = numbers("--camera-shutter", text, "T,T", [2], real)
    return opened, closed


def colour(option: str, text: str) -> Vector:
    """Return the colour R,G,B, or one number for all three. Raises UsageError for negative values."""
    found = numbers(option, text, "R,G,B or one number,", [1, 3], real)
    if min(found) < 0:
        raise UsageError(f"{option} {text}: radiance cannot be negative.")
    r, g, b = found if len(found) == 3 else found * 3
    return r, g, b


def resolution(text: str) -> tuple[int, int]:
    """Return width and height of --resolution WxH. Raises UsageError."""
    width, height = numbers("--resolution", text.lower(), "WxH", [2], whole, "x")
    if width < 1 or height < 1:
        raise UsageError(f"--resolution {text}: both sides must be at least 1 pixel.")
    return width, height


def crop(text: str) -> tuple[int, int, int, int]:
    """Return the window X,Y,W,H of --crop. Raises UsageError."""
    x, y, width, height = numbers("--crop", text, "X,Y,W,H", [4], whole)
    if width < 1 or height < 1:
        raise UsageError(f"--crop {text}: both sides must be at least 1 pixel.")
    return x, y, width, height


def exposure(text: str | None) -> float | Literal["auto"] | None:
    """Return the value of --exposure: stops, "auto" or None. Raises UsageError."""
    if text is None or text == "auto":
        return text  # type: ignore[return-value]
    try:
        stops = real(text)
    except ValueError:
        stops = math.nan
    if not abs(stops) <= 100:
        raise UsageError(f"--exposure {text}: must be a number of stops from -100 to 100, or auto.")
    return stops


def seconds(option: str, text: str, allow_zero: bool = False) -> float:
    """Return the seconds of a duration such as 90, 90s, 10m, 1.5h or 1d. Raises UsageError."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([a-z]*)", text.strip().lower())
    value = float(match[1]) * _UNITS[match[2]] if match and match[2] in _UNITS else -1.0
    if not (value > 0 or (allow_zero and value == 0)) or value > 1e9:
        raise UsageError(f"{option} {text}: expected a time above 0 such as 90s, 10m, 2h or 1d.")
    return value


def interval(option: str, text: str) -> tuple[float | None, int | None]:
    """Return (seconds, None) for a time such as 60s, or (None, steps) for steps such as 100i. Raises UsageError."""
    if match := re.fullmatch(r"([0-9]{1,18})i", text.strip().lower()):
        if int(match[1]) < 1:
            raise UsageError(f"{option} {text}: must be at least one step, 1i.")
        return None, int(match[1])
    try:
        return seconds(option, text), None
    except UsageError:
        raise UsageError(f"{option} {text}: expected a time such as 60s or 5m, or steps such as 100i.") from None


def shard_of(text: str | None) -> tuple[int, int] | None:
    """Return K and N of --shard K/N; None if `text` is None. Raises UsageError."""
    if text is None:
        return None
    found = re.fullmatch(r"([0-9]{1,18})/([0-9]{1,18})", text.strip())
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise UsageError(f"--shard {text}: expected K/N, whole numbers with K from 1 to N, e.g. 1/4.")
    return int(found[1]), int(found[2])


def sample_range(text: str) -> tuple[int, int]:
    """Return the first path set and the count of --sample-range A:B. Raises UsageError."""
    match = re.fullmatch(r"([0-9]{1,18}):([0-9]{1,18})", text.strip())
    if not match or int(match[1]) >= int(match[2]):
        raise UsageError(f"--sample-range {text}: expected A:B, whole numbers of which B is greater, e.g. 0:64.")
    return int(match[1]), int(match[2]) - int(match[1])


def check_inside(window: tuple[int, int, int, int], resolution: tuple[int, int]) -> None:
    """Raise UsageError if a crop extends beyond the image."""
    x, y, width, height = window
    full_width, full_height = resolution
    if x < 0 or y < 0 or x + width > full_width or y + height > full_height:
        raise UsageError(
            f"--crop {x},{y},{width},{height}: reaches out of the picture of {full_width} x {full_height}.",
            "X and Y are the top left pixel, W and H the size, all in pixels of the whole picture.",
        )
