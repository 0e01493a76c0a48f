"""Checks that the arguments of public functions and methods have the annotated types.

`checked` wraps a function, or all public methods of a class. A wrong argument raises UsageError before the call.
The checks read annotations as text, so that no type is imported for them. Values of the right type, such as numbers
out of range and unknown words, are checked by the functions themselves.

Cost:     about 2 microseconds per call, and 0.3 microseconds per argument. Long lists are searched for large
          integers at 50 ns per element.
"""

from __future__ import annotations

import ast
import builtins
import functools
import inspect
import math
import os
import reprlib
import typing
from collections import ChainMap
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from numbers import Integral, Real
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin

from glpath.errors import UsageError

Function = TypeVar("Function", bound=Callable[..., Any])
Kind = TypeVar("Kind", bound=type)
_Accepts = Callable[[Any], bool]

# Smallest and largest integer of 64 bits, signed or unsigned. Python refuses to write integers of more than 4,300
# digits, and numpy refuses to convert integers of more than 64 bits.
_SMALLEST, _LARGEST = -(1 << 63), (1 << 64) - 1
# Depth to which lists, tuples, sets and dictionaries are searched for large integers; lists may contain themselves.
_DEPTH = 16
# Types whose values contain no large integer, and types whose elements are searched.
_LEAVES, _LISTS = {bool, float, str, type(None)}, (list, tuple, set, frozenset)
# Maximum length of a value in a message.
_LONGEST = 60


class _Shortened(reprlib.Repr):
    """`repr` that shortens long values, and integers that Python refuses to write in decimal."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = _LONGEST

    def repr_int(self, x: int, level: int) -> str:
        return repr(x) if _SMALLEST <= x <= _LARGEST else f"an integer of {int(math.log10(abs(x))) + 1:,} digits"


def short_repr(value: object) -> str:
    """Return the value's `repr` for a message, on one line and shortened if it is long."""
    try:
        text = _Shortened().repr(value)
    except Exception:  # `repr` of an element may raise any error
        text = f"an object of the type {type(value).__name__}"
    return " ".join(text.split())


def check_count(name: str, value: object, low: int, high: int) -> None:
    """Raise UsageError with the argument's name unless `value` is a whole number from `low` to `high`."""
    if not _is_whole(value) or not low <= value <= high:  # type: ignore[operator]
        raise UsageError(f"{name}: {short_repr(value)} where a whole number from {low} to {high} is needed")


def check_word(name: str, word: object, allowed: Sequence[str]) -> None:
    """Raise UsageError with the allowed words unless `word` is one of them."""
    if not isinstance(word, str) or word not in allowed:
        raise UsageError(f"{name}: {short_repr(word)}; allowed are {', '.join(allowed)}")


def checked(function: Function, namespace: Mapping[str, Any] | None = None) -> Function:
    """Return the function with checks of its arguments; for a class, check all public methods and return the class.

    namespace : objects by name, for names in annotations that the function's module does not have

    The wrapper raises UsageError for an argument whose type the annotation does not allow, and for an integer of
    more than 64 bits in any argument. NumPy's integers and bools are passed on as int and bool, and other real
    numbers as float.
    """
    if isinstance(function, type):
        for name, member in list(vars(function).items()):
            if name.startswith("_"):
                continue
            if inspect.isfunction(member):
                setattr(function, name, checked(member))
            elif isinstance(member, classmethod):
                setattr(function, name, classmethod(checked(member.__func__)))
        return typing.cast("Function", function)

    @functools.cache  # evaluated at the first call, when all names of the module exist
    def parameters() -> _Parameters:
        names = ChainMap(inspect.unwrap(function).__globals__, dict(namespace or {}))
        return _Parameters.of(inspect.signature(function), names)

    @functools.wraps(function)
    def call(*given: Any, **by_name: Any) -> Any:
        names = parameters().positional
        converted = parameters().check({**dict(zip(names, given, strict=False)), **by_name})
        if converted:
            given = (*map(converted.get, names[: len(given)], given), *given[len(names) :])
            by_name |= {name: value for name, value in converted.items() if name in by_name}
        return function(*given, **by_name)

    return typing.cast("Function", call)


def checked_fields(kind: Kind) -> Kind:
    """Return the dataclass with checks of its fields' types when an object is made; see `checked`."""
    kind.__init__ = checked(kind.__init__)  # type: ignore[misc]
    return kind


class _Type(NamedTuple):
    """One type of an annotation's union.

    accepts : function that returns True for allowed values
    needed  : description of allowed values for messages
    """

    accepts: _Accepts
    needed: str


class _Parameters(NamedTuple):
    """Parameters of a function.

    positional : names of the parameters that may be given by position
    types      : allowed types by parameter name; parameters that allow any type are left out
    plain      : (parameter name, class) pairs; an argument of exactly this class needs no further check
    """

    positional: tuple[str, ...]
    types: Mapping[str, tuple[_Type, ...]]
    plain: frozenset[tuple[str, type]]

    @classmethod
    def of(cls, signature: inspect.Signature, namespace: Mapping[str, Any]) -> _Parameters:
        positional, types = [], {}
        for name, parameter in signature.parameters.items():
            if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD):
                positional.append(name)
            if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                found = types_of(parameter.annotation, namespace)
                if found is not None:
                    types[name] = found
        samples = (None, True, 0, 0.0)
        plain = {(n, type(v)) for n, all_of in types.items() for v in samples if any(t.accepts(v) for t in all_of)}
        return cls(tuple(positional), types, frozenset(plain))

    def check(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Raise UsageError for wrong arguments; return arguments that must be converted, by name.

        NumPy's bools and integers are converted to bool and int, other real numbers to float.
        """
        if _large_integer(given.values()) is not None:
            for name, value in given.items():
                if (large := _large_integer([value])) is not None:
                    raise UsageError(
                        f"{name}: {short_repr(large)} where integers have at most 64 bits",
                        "Take a smaller number.",
                    )
        converted: dict[str, Any] = {}
        for name, value in given.items():
            if (name, type(value)) in self.plain or name not in self.types:
                continue
            for each in self.types[name]:
                if each.accepts(value):
                    break
            else:
                raise _wrong(name, value, [each.needed for each in self.types[name]])
            if type(value).__module__ == "numpy" and (_is_flag(value) or _is_whole(value)):
                converted[name] = value.item()
            elif not isinstance(value, int | float) and isinstance(value, Real):
                try:
                    converted[name] = float(value)
                except OverflowError:
                    raise _wrong(name, value, ["a number that fits into 64 bits"]) from None
        return converted


def _wrong(name: str, value: object, needed: Sequence[str]) -> UsageError:
    """Return the error for an argument of a wrong type."""
    remedy = ""
    if isinstance(value, str) and "a Film" in needed:
        remedy = "glpath.Film.load reads a film from its file."
    elif isinstance(value, str) and any("number" in each for each in needed):
        remedy = "Write numbers without quotation marks."
    elif isinstance(value, dict) and "a Camera" in needed:
        remedy = "Fields of a camera are arguments of their own: with_camera(position=(0, 1, 5))."
    elif isinstance(value, bytes) and _PATH in needed:
        remedy = "os.fsdecode makes text of bytes."
    first = [each for each in dict.fromkeys(needed) if each != "None"]
    allowed = " or ".join([*first, *["None"] * ("None" in needed)])
    return UsageError(f"{name}: {short_repr(value)} where {allowed} is needed", remedy)


def _large_integer(values: Iterable[Any]) -> int | None:
    """Return an integer of more than 64 bits in nested values; None if there is none.

    The search goes level by level, so that built-in functions such as `map` visit the elements of long lists, which
    is fast.
    """
    level = list(values)
    for _ in range(_DEPTH):
        kinds = set(map(type, level)) - _LEAVES
        nested: list[Iterable[Any]] = []
        for kind in kinds:
            if issubclass(kind, int):
                integers = [each for each in level if type(each) is kind]
                for extreme in (min(integers), max(integers)):
                    if not _SMALLEST <= extreme <= _LARGEST:
                        return int(extreme)
            elif issubclass(kind, _LISTS):
                nested += [each for each in level if type(each) is kind]
            elif issubclass(kind, dict):
                nested += [part for each in level if type(each) is kind for part in (each, each.values())]
            elif kind.__name__ == "ndarray":
                nested += [each.ravel() for each in level if _is_array(each) and each.dtype.kind == "O"]
        if not nested:
            return None
        level = list(chain.from_iterable(nested))
    return None


# Predicates of types.


def _is_flag(value: object) -> bool:
    return isinstance(value, bool) or type(value).__name__ in ("bool", "bool_")  # NumPy 2 and NumPy 1


def _is_whole(value: object) -> bool:
    return isinstance(value, Integral) and not _is_flag_or_duration(value)


def _is_number(value: object) -> bool:
    return type(value) in (int, float) or (isinstance(value, Real) and not _is_flag_or_duration(value))


def _is_flag_or_duration(value: object) -> bool:
    """Return True for a bool, and for numpy's timedelta64.

    numpy registers timedelta64 as an integer, but it cannot be converted to float.
    """
    return isinstance(value, bool) or type(value).__name__ == "timedelta64"


def _is_path(value: object) -> bool:
    try:
        text = os.fspath(value) if isinstance(value, str | os.PathLike) else b""
        return isinstance(text, str) and b"\0" not in os.fsencode(text)
    except Exception:  # a lone surrogate; `__fspath__` of an object may raise any error
        return False


def _is_names(value: Any) -> bool:
    """Return True for a dictionary, or another object like a dictionary, whose keys are text."""
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


def _is_array(value: object) -> bool:
    return type(value).__name__ == "ndarray"


def _is_list(value: Any) -> bool:
    if isinstance(value, (*_LISTS, Sequence)):
        return not isinstance(value, str | bytes)
    return _is_array(value) and value.ndim > 0


def _is_numbers(value: Any) -> bool:
    """Return True for a number, an array of numbers, nested lists of numbers, or an object that numpy converts."""
    if _is_array(value) and value.dtype.kind in "fiub":  # most arrays
        return True
    if isinstance(value, list | tuple) or _is_array(value):
        import numpy as np

        try:
            value = np.asarray(value)
            if value.dtype.kind == "O":
                value = value.astype(np.float64)
        except Exception:  # elements may raise any error
            return False
    if hasattr(value, "dtype") and hasattr(value.dtype, "kind"):
        return value.dtype.kind not in "SUVmMc"
    return _is_number(value) or hasattr(value, "__array__") or hasattr(value, "__array_interface__")


def _has_class_name(name: str, value: object) -> bool:
    return any(kind.__name__ == name for kind in type(value).__mro__)


def _is_iterable(value: object) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, str | bytes) and getattr(value, "ndim", 1) != 0


_PATH = "a path without NUL characters and lone surrogates"
_NAMED: Mapping[str, _Type] = {
    "None": _Type(lambda value: value is None, "None"),
    "bool": _Type(_is_flag, "True or False"),
    "int": _Type(_is_whole, "a whole number"),
    "float": _Type(_is_number, "a number"),
    "str": _Type(lambda value: isinstance(value, str), "text"),
    "Path": _Type(_is_path, _PATH),
    "Callable": _Type(callable, "a function"),
    "Mapping": _Type(_is_names, "a dictionary whose keys are text"),
    "Iterable": _Type(_is_iterable, "a list"),
    "labels": _Type(lambda value: _is_list(value) or hasattr(value, "__array__"), "an array of labels"),
    "ArrayLike": _Type(_is_numbers, "an array of numbers"),
}


def types_of(annotation: Any, namespace: Mapping[str, Any]) -> tuple[_Type, ...] | None:
    """Return the types that an annotation allows; None if it allows any type or is not a str.

    namespace : objects that the annotation's names refer to; any other name is taken as the name of a class
    """
    if not isinstance(annotation, str):
        return None
    words = _split(annotation, "|")
    if "Path" in words:
        words = [word for word in words if word != "str"]
    if {"str", "ArrayLike"} <= set(words):
        words = ["str", "labels", *(word for word in words if word not in ("str", "ArrayLike"))]
    found = [_type_of(word, namespace) for word in words]
    return tuple(each for each in found if each is not None) if None not in found else None


def _type_of(text: str, namespace: Mapping[str, Any]) -> _Type | None:
    """Return the type for one member of an annotation's union; None if it allows any value."""
    head, _, inner = text.removesuffix("]").partition("[")
    if head == "Literal":
        return _words_type(ast.literal_eval(f"({inner},)"))
    if head == "tuple":
        return _tuple_type(_split(inner, ","), namespace)
    if head == "Sequence":
        return _sequence_type(inner, namespace)
    if head == "NDArray":
        head = "ArrayLike"
    if head in _NAMED:
        return _NAMED[head]
    value = namespace.get(head, getattr(builtins, head, None))
    if value is None:
        return _Type(functools.partial(_has_class_name, head), _with_article(head))
    if get_origin(value) is Literal:
        return _words_type(get_args(value))
    if getattr(get_origin(value), "__name__", "") == "ndarray":
        return _NAMED["ArrayLike"]
    if get_origin(value) is Callable:
        return _NAMED["Callable"]
    if not isinstance(value, type) or value in (Any, object):
        return None
    if getattr(value, "_is_protocol", False):
        methods = [name for name in vars(value) if not name.startswith("_")]
        return _Type(lambda value: all(hasattr(value, name) for name in methods), _with_article(head))
    return _Type(lambda given: isinstance(given, value), _with_article(head))


def _words_type(words: tuple[str | int, ...]) -> _Type:
    """Return the type for a Literal of words or whole numbers.

    It accepts any text or any whole number, because functions check the words themselves.
    """
    if all(isinstance(word, int) for word in words):
        return _Type(_is_whole, " or ".join(map(str, words)))
    return _Type(lambda value: isinstance(value, str), " or ".join(f'"{word}"' for word in words))


def _tuple_type(parts: Sequence[str], namespace: Mapping[str, Any]) -> _Type | None:
    """Return the type for a tuple annotation, which accepts tuples, lists and arrays of numbers.

    Whole numbers may be floats, such as 64.0. None if the annotation has elements other than int and float.
    """
    of_any_length = parts[-1] == "..."
    if not {"int", "float"}.issuperset(parts[:1] if of_any_length else parts):
        return None
    length = "" if of_any_length else f"{len(parts)} "

    def accepts(value: Any) -> bool:
        return _is_list(value) and all(map(_is_number, value)) and (of_any_length or len(value) == len(parts))

    return _Type(accepts, f"a tuple of {length}numbers")


def _sequence_type(inner: str, namespace: Mapping[str, Any]) -> _Type:
    types = None if "[" in inner else types_of(inner, namespace)

    def accepts(value: Any) -> bool:
        if not isinstance(value, str) and not _is_list(value):
            return False
        return types is None or all(types[0].accepts(each) for each in value)

    return _Type(accepts, "a list" + ("" if types is None else f" of which each is {types[0].needed}"))


def _with_article(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _split(text: str, separator: str) -> list[str]:
    """Split an annotation at separators outside of brackets and quotation marks."""
    parts, depth, quoted = [""], 0, False
    for letter in text:
        quoted ^= letter in "'\""
        depth += (letter == "[") - (letter == "]")
        if letter == separator and not depth and not quoted:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]
