"""Values of the command line as Python has them, or a UsageError that names the option."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

from glpath.errors import UsageError

Vector = tuple[float, float, float]


def check_choice(option: str, found: str, allowed: Sequence[str]) -> None:
    """One of the words, or a UsageError that names them."""
    if found not in allowed:
        raise UsageError(f"{option} {found}: there is no such choice. Allowed: {', '.join(allowed)}.")


def numbers(
    option: str, text: str, form: str, counts: Sequence[int], kind: Callable[[str], float], separator: str = ","
) -> list[Any]:
    """The numbers of a text, which must be one of `counts` many; else a UsageError that shows `form`."""
    try:
        found = [kind(part) for part in text.split(separator)]
    except ValueError:
        found = []
    if len(found) not in counts or not all(map(math.isfinite, found)):
        raise UsageError(f"{option} {text}: expected {form} in finite numbers.")
    return found


def vector(option: str, text: str | None) -> Vector | None:
    """X,Y,Z."""
    if text is None:
        return None
    x, y, z = numbers(option, text, "X,Y,Z", [3], float)
    return x, y, z


def shutter(text: str) -> tuple[float, float]:
    """T,T of --camera-shutter."""
    opened, closed = numbers("--camera-shutter", text, "T,T", [2], float)
    return opened, closed


def colour(option: str, text: str) -> Vector:
    """R,G,B or one number for all three, not negative."""
    found = numbers(option, text, "R,G,B or one number,", [1, 3], float)
    if min(found) < 0:
        raise UsageError(f"{option} {text}: radiance cannot be negative.")
    r, g, b = found if len(found) == 3 else found * 3
    return r, g, b


def resolution(text: str) -> tuple[int, int]:
    """WxH of --resolution."""
    width, height = numbers("--resolution", text.lower(), "WxH", [2], int, "x")
    if width < 1 or height < 1:
        raise UsageError(f"--resolution {text}: both sides must be at least 1 pixel.")
    return width, height


def crop(text: str) -> tuple[int, int, int, int]:
    """X,Y,W,H of --crop."""
    x, y, width, height = numbers("--crop", text, "X,Y,W,H", [4], int)
    if width < 1 or height < 1:
        raise UsageError(f"--crop {text}: both sides must be at least 1 pixel.")
    return x, y, width, height


def exposure(text: str | None) -> float | Literal["auto"] | None:
    """STOPS of --exposure, or the word auto."""
    if text is None or text == "auto":
        return text  # type: ignore[return-value]
    try:
        stops = float(text)
    except ValueError:
        stops = math.nan
    if not abs(stops) <= 100:
        raise UsageError(f"--exposure {text}: must be a number of stops from -100 to 100, or auto.")
    return stops


def check_inside(window: tuple[int, int, int, int], resolution: tuple[int, int]) -> None:
    """Refuse a crop that reaches out of the image."""
    x, y, width, height = window
    full_width, full_height = resolution
    if x < 0 or y < 0 or x + width > full_width or y + height > full_height:
        raise UsageError(
            f"--crop {x},{y},{width},{height}: reaches out of the picture of {full_width} x {full_height}.",
            "X and Y are the top left pixel, W and H the size, all in pixels of the whole picture.",
        )
