"""JSON objects of a glTF file, each with its location; values are checked when they are read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from glpath.io.gltf.limits import MAX_NAME
from glpath.io.values import LARGEST
from glpath.scene.model import Float64
from glpath.scene.source_location import SourceLocation

Choice = TypeVar("Choice")


@dataclass(frozen=True)
class Table:
    """JSON object with its location. All methods raise SceneError for a value of the wrong type."""

    values: dict[str, Any]
    location: SourceLocation

    @classmethod
    def of(cls, value: object, location: SourceLocation) -> Table:
        if not isinstance(value, dict):
            raise location.wrong(value, "an object", "Export the file anew.")
        return cls(value, location)

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def table(self, name: str) -> Table:
        """Return the object in field `name`; an empty object if the field is missing."""
        return Table.of(self.values.get(name, {}), self.location.field(name))

    def tables(self, name: str) -> Tables:
        """Return the list of objects in field `name`; an empty list if the field is missing."""
        return Tables(self._list(name), self.location.field(name))

    def extension(self, name: str) -> Table | None:
        if "extensions" not in self.values:
            return None
        extensions = self.table("extensions")
        return extensions.table(name) if name in extensions else None

    def text(self, name: str) -> str | None:
        value = self.values.get(name)
        if value is not None and not isinstance(value, str):
            raise self.location.field(name).wrong(value, "a text")
        return value

    def texts(self, name: str) -> list[str]:
        values = self._list(name)
        for i, value in enumerate(values):
            if not isinstance(value, str):
                raise self.location.field(name).item(i).wrong(value, "a text")
        return values

    def name(self, otherwise: str) -> str:
        """Return the printable characters of the object's `name`; `otherwise` if there are none."""
        return printable(self.text("name") or "") or otherwise

    def flag(self, name: str, default: bool = False) -> bool:
        value = self.values.get(name, default)
        if not isinstance(value, bool):
            raise self.location.field(name).wrong(value, "true or false")
        return value

    @overload
    def integer(self, name: str, default: int, low: int = 0, high: int = 2**53) -> int: ...
    @overload
    def integer(self, name: str, default: None = None, low: int = 0, high: int = 2**53) -> int | None: ...
    def integer(self, name: str, default: int | None = None, low: int = 0, high: int = 2**53) -> int | None:
        """Return the integer in field `name`; `default` if the field is missing.

        Raises SceneError for an integer below `low` or above `high`.
        """
        if name not in self.values:
            return default
        return _integer(self.values[name], self.location.field(name), low, high)

    def required(self, name: str, low: int = 0, high: int = 2**53) -> int:
        """Return the integer in field `name`.

        Raises SceneError if the field is missing, or if the integer is below `low` or above `high`.
        """
        return _integer(self._present(name), self.location.field(name), low, high)

    def choice(self, name: str, allowed: Mapping[Any, Choice], default: Choice) -> Choice:
        """Return the entry of `allowed` whose key is the stored value; `default` if the value is missing."""
        return self.required_choice(name, allowed) if name in self.values else default

    def required_choice(self, name: str, allowed: Mapping[Any, Choice]) -> Choice:
        """Return the entry of `allowed` whose key is the stored value. Raises SceneError if there is no value."""
        value = self._present(name)
        if isinstance(value, bool) or not isinstance(value, str | int | float) or value not in allowed:
            raise self.location.field(name).wrong(value, f"one of {', '.join(str(key) for key in allowed)}")
        return allowed[value]

    def index(self, name: str, of: Sequence[Any], what: str) -> int | None:
        """Return the index in field `name`; None if the field is missing.

        Raises SceneError for a number that is no index of `of`.

        what : plural noun of the elements of `of`, for messages
        """
        if name not in self.values:
            return None
        value = self.values[name]
        if type(value) is int and 0 <= value < len(of):
            return value
        return _index(value, self.location.field(name), len(of), what)

    def required_index(self, name: str, of: Sequence[Any], what: str) -> int:
        return _index(self._present(name), self.location.field(name), len(of), what)

    def indices(self, name: str, of: Sequence[Any], what: str) -> list[int]:
        values = self._list(name)
        if set(map(type, values)) <= {int} and min(values, default=0) >= 0 and max(values, default=-1) < len(of):
            return list(values)
        location = self.location.field(name)
        return [_index(value, location.item(i), len(of), what) for i, value in enumerate(values)]

    def number(self, name: str, default: float, low: float = -LARGEST, high: float = LARGEST) -> float:
        if name not in self.values:
            return default
        return _number(self.values[name], self.location.field(name), low, high)

    def numbers(self, name: str, default: Sequence[float], low: float = -LARGEST, high: float = LARGEST) -> Float64:
        """Return (n,) float64, the list in field `name`; `default` if the field is missing.

        Raises SceneError for a list of another length than `default`, or a number below `low` or above `high`.
        """
        if name not in self.values:
            return np.array(default, np.float64)
        value, location = self.values[name], self.location.field(name)
        if not isinstance(value, list) or len(value) != len(default):
            raise location.wrong(value, f"a list of {len(default)} numbers")
        return np.array([_number(each, location.item(i), low, high) for i, each in enumerate(value)])

    def any_numbers(self, name: str) -> Float64:
        """Return (n,) float64, the list in field `name`, of any length; empty if the field is missing."""
        value, location = self._list(name), self.location.field(name)
        return np.array(
            [_number(each, location.item(i), -LARGEST, LARGEST) for i, each in enumerate(value)], np.float64
        )

    def _present(self, name: str) -> Any:
        if name not in self.values:
            raise self.location.error(f"has no `{name}`, which it needs.", "Export the file anew.")
        return self.values[name]

    def _list(self, name: str) -> list[Any]:
        value = self.values.get(name, [])
        if not isinstance(value, list):
            raise self.location.field(name).wrong(value, "a list")
        return value


@dataclass(frozen=True)
class Tables(Sequence[Table]):
    """List of JSON objects with its location."""

    values: list[Any]
    location: SourceLocation

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, index: Any) -> Any:  # typed like Sequence; no caller uses slices
        return Table.of(self.values[index], self.location.item(index))

    def __iter__(self) -> Iterator[Table]:
        return (self[i] for i in range(len(self)))

    def having(self, name: str) -> NDArray[np.int64]:
        """Return the indices of the objects that have a field. Raises SceneError for a value that is no object."""
        for i, value in enumerate(self.values):
            if type(value) is not dict:
                Table.of(value, self.location.item(i))
        return np.array([i for i, value in enumerate(self.values) if name in value], np.int64)

    def numbers(self, name: str, rows: NDArray[np.int64], count: int) -> Float64:
        """Return `Table.numbers` of one field for the objects at indices `rows`, (len(rows), count) float64."""
        values = [self.values[i][name] for i in rows.tolist()]
        if set(map(type, values)) <= {list} and set(map(len, values)) <= {count}:
            flat = [*chain.from_iterable(values)]
            # An integer of JSON may be larger than any float.
            if set(map(type, flat)) <= {int, float} and all(-LARGEST <= value <= LARGEST for value in flat):
                return np.array(flat, np.float64).reshape(-1, count)
        return np.array([self[i].numbers(name, [0.0] * count) for i in rows.tolist()]).reshape(-1, count)


def printable(text: str) -> str:
    """Return a name without unprintable characters, such as line ends and terminal codes, of limited length."""
    return "".join(c for c in text[: 4 * MAX_NAME] if c.isprintable())[:MAX_NAME].strip()


def _integer(value: object, location: SourceLocation, low: int, high: int) -> int:
    if isinstance(value, float) and value.is_integer():
        value = int(value)  # JSON has only one type of number
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise location.wrong(
            value, f"a whole number from {low} to {high}" if high < 2**53 else f"a whole number, at least {low}"
        )
    return value


def _index(value: object, location: SourceLocation, count: int, what: str) -> int:
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise location.wrong(value, f"a number of one of the {what}")
    if not 0 <= value < count:
        among = f"{count} {what} (0 to {count - 1})" if count else f"no {what}"
        raise location.error(f"is {value}, but the file has {among}.", "Export the file anew.")
    return value


def _number(value: object, location: SourceLocation, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        allowed = "a finite number" if (low, high) == (-LARGEST, LARGEST) else f"a number from {low:g} to {high:g}"
        if high == math.inf or (high == LARGEST and low > -LARGEST):
            allowed = f"a number, at least {low:g}"
        raise location.wrong(value, allowed)
    return float(value)
