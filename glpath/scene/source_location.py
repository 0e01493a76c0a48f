"""Locations in scene files, with which error messages begin."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, time
from pathlib import Path

from glpath.errors import SceneError
from glpath.system.arguments import short_repr

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_LONGEST = 60
# Depth to which nested lists and tables are shown; lists may contain themselves.
_DEEPEST = 6
# Smallest integer that is too long to be shown whole.
_LONGEST_INTEGER = 10**_LONGEST


@dataclass(frozen=True)
class SourceLocation:
    """File and path inside the file, written as `rooms/hall.toml: shapes[3].material`.

    source : scene file, or the name of a scene that comes from no file
    path   : for example `shapes[3].material`; empty for the file as a whole
    """

    source: str
    path: str = ""

    def __str__(self) -> str:
        return f"{self.source}: {self.path}" if self.path else f"{self.source}:"

    def field(self, name: str) -> SourceLocation:
        """Return the location of a key in the table at this location."""
        key = name if _BARE_KEY.fullmatch(name) else json.dumps(name, ensure_ascii=False)
        return type(self)(self.source, f"{self.path}.{key}" if self.path else key)

    def item(self, index: int) -> SourceLocation:
        """Return the location of an element of the list at this location, counted from 0."""
        return type(self)(self.source, f"{self.path}[{index}]")

    def written(self, value: object) -> str:
        """Return `value` in the syntax of the file."""
        return shown(value)

    def setting(self, value: object) -> str:
        """Return an assignment of `value` to this key, such as `up = [0, 1, 0]`."""
        return f"{self.path.rpartition('.')[2]} = {self.written(value)}"

    def error(self, text: str, remedy: str = "") -> SceneError:
        """Return an error at this location; `text` follows the location ("names vertex 9, but ...")."""
        return SceneError(f"{self} {text}", remedy)

    def wrong(self, found: object, allowed: str, remedy: str = "") -> SceneError:
        """Return an error about the value at this location, with the value found and the values allowed."""
        return self.error(f"is {self.written(found)}, but must be {allowed}.", remedy)


class PythonLocation(SourceLocation):
    """Location in a dictionary, written in Python syntax: `scene["shapes"][3]["material"]`."""

    def __str__(self) -> str:
        return f"{self.source}{self.path}"

    def field(self, name: str) -> SourceLocation:
        return type(self)(self.source, f"{self.path}[{json.dumps(name, ensure_ascii=False)}]")

    def setting(self, value: object) -> str:
        """Return the Python statement that assigns `value` to this key."""
        return f"{self} = {self.written(value)}"


def coordinates(point: Iterable[float]) -> str:
    """Return a point as text; each coordinate has six digits, or two decimals if it is at least 1e5 in size."""
    return "[" + ", ".join(f"{x:.6g}" if abs(x) < 1e5 else f"{x:.2f}" for x in point) + "]"


def shown(value: object, depth: int = 0) -> str:
    """Return `value` in the syntax of a scene file, shortened if it is long or nested deeply.

    depth : number of lists and tables that contain the value

    A value whose text raises an error is shown as an object of its type.
    """
    try:
        return _shown(value, depth)
    except Exception:  # methods of the value, such as `__str__` and `items`, may raise any error
        return short_repr(value)


def _shown(value: object, depth: int) -> str:
    import numpy as np

    if depth > _DEEPEST:
        return "..."
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        text = "{" + _joined(f"{key} = {shown(item, depth + 1)}" for key, item in value.items()) + "}"
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = json.dumps(value[: _LONGEST + 1], ensure_ascii=False)
    elif isinstance(value, Sequence):
        text = "[" + _joined(shown(item, depth + 1) for item in value) + "]"
    elif isinstance(value, float):
        text = f"{value:.9g}"
    elif isinstance(value, int) and abs(value) >= _LONGEST_INTEGER:
        text = hex(value)  # Python refuses to write long integers in decimal
    elif value is None or isinstance(value, int | Path | date | time):
        text = str(value)
    else:
        text = short_repr(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."


def _joined(parts: Iterable[str]) -> str:
    """Join the parts with commas, but stop when the text is longer than the `_LONGEST` that `shown` keeps."""
    found, length = [], 0
    for part in parts:
        found.append(part)
        length += len(part)
        if length > _LONGEST:
            break
    return ", ".join(found)
