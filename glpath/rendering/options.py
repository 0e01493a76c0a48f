"""The options of a render, checked: words, numbers, cameras and windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError
from glpath.scene import Scene, check_camera

Window = tuple[int, int, int, int]


def check_count(name: str, value: object, least: int, most: int) -> None:
    """A whole number from `least` to `most`, or a UsageError that names the option."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or not least <= value <= most:
        raise UsageError(f"{name}: {value!r} where a whole number from {least} to {most} is needed")


def check_word(name: str, word: object, allowed: Sequence[str]) -> None:
    """One of the words, or a UsageError that names them."""
    if word not in allowed:
        raise UsageError(f"{name}: {word!r}; allowed are {', '.join(allowed)}")


def numbers(name: str, value: Any, count: int) -> NDArray[np.float64]:
    """So many finite numbers, or a UsageError that names the option."""
    try:
        found = np.atleast_1d(np.asarray(value, np.float64))
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != (count,) or not np.all(np.isfinite(found)) or isinstance(value, str):
        needed = "a finite number is" if count == 1 else f"{count} finite numbers are"
        raise UsageError(f"{name}: {value!r} where {needed} needed")
    return found


def colour(value: float | Sequence[float]) -> tuple[float, float, float]:
    r, g, b = numbers("ambient", [value] * 3 if isinstance(value, int | float) else value, 3)
    if min(r, g, b) < 0:
        raise UsageError(f"ambient: {value!r} where radiance, one or three numbers >= 0, is needed")
    return float(r), float(g), float(b)


def _whole_numbers(name: str, value: Any, count: int) -> list[int]:
    found = numbers(name, value, count)
    if np.any(found != np.floor(found)):
        raise UsageError(f"{name}: {value!r} where {count} whole numbers of pixels are needed")
    return [int(n) for n in found]


def with_overrides(scene: Scene, resolution: tuple[int, int] | None, camera: Mapping[str, Any] | None) -> Scene:
    changes: dict[str, Any] = {}
    for name, value in (camera or {}).items():
        if name not in ("position", "target", "up", "fov"):
            raise UsageError(f"camera: no field is named {name!r}; allowed are position, target, up, fov")
        found = numbers(f"camera {name}", value, 1 if name == "fov" else 3)
        changes[name] = float(found[0]) if name == "fov" else found
    if resolution is not None:
        width, height = _whole_numbers("resolution", resolution, 2)
        changes["resolution"] = (width, height)
    if not changes:
        return scene
    changed = scene.with_camera(**changes)
    check_camera(changed.camera, scene.source or scene.name)
    return changed


def window_of(scene: Scene, crop: tuple[int, int, int, int] | None) -> tuple[int, int, int, int]:
    width, height = scene.camera.resolution
    if crop is None:
        return 0, 0, width, height
    x, y, w, h = _whole_numbers("crop", crop, 4)
    if w < 1 or h < 1 or x < 0 or y < 0 or x + w > width or y + h > height:
        raise UsageError(
            f"crop: {w} x {h} pixels from ({x}, {y}) of a picture of {width} x {height}",
            "The crop is x, y, width, height in pixels, from the top left, and lies inside the picture.",
        )
    return x, y, w, h
