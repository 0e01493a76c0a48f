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
        text = f"an object of the type {_class_name(type(value))}"
    return " ".join(text.split())


def _class_name(kind: type) -> str:
    """Return the name of a class, even if its metaclass defines another `__name__`, which may raise any error."""
    return str(type.__dict__["__name__"].__get__(kind))


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
    numbers as float. Objects of subclasses of int, float and str are passed on as int, float and str; dictionaries,
    paths and arrays of other types as dict, str and numpy array. So a method that raises an error raises it here.
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
    convert : function that converts an allowed value to a built-in type or to numpy's array
    """

    accepts: _Accepts
    needed: str
    convert: Callable[[Any], Any] = lambda value: value


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
        """Raise UsageError for wrong arguments; return converted arguments by name."""
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
            failure = None
            for each in self.types[name]:
                try:
                    if each.accepts(value):
                        plain = each.convert(value)
                        break
                except Exception as error:  # methods of an object may raise any error
                    failure = error
            else:
                raise _wrong(name, value, [each.needed for each in self.types[name]], failure) from failure
            if plain is not value:
                converted[name] = plain
        return converted


def path_text(name: str, value: object) -> str:
    """Return the text of a path. Raises UsageError, also if its methods raise an error."""
    return str(_converted(name, value, _NAMED["Path"]))


def plain_dictionary(name: str, value: object) -> dict[str, Any]:
    """Return a copy of a dictionary-like object. Raises UsageError, also if its methods raise an error."""
    return dict(_converted(name, value, _NAMED["Mapping"]))


def _converted(name: str, value: object, kind: _Type) -> Any:
    return _Parameters((), {name: (kind,)}, frozenset()).check({name: value}).get(name, value)


def check_texts(metadata: Mapping[str, str] | None) -> None:
    """Raise UsageError unless all metadata are text that UTF-8 can encode, with keys in Latin-1 as in a PNG."""
    for key, value in (metadata or {}).items():
        try:
            key.encode("latin-1")
            value.encode()
        except (AttributeError, UnicodeEncodeError):
            raise UsageError(
                f"metadata[{short_repr(key)}]: {short_repr(value)} where text is needed, with a key in Latin-1"
            ) from None


def real_array(
    name: str, value: Any, allowed: str = "", fits: Callable[[tuple[int, ...]], bool] = lambda shape: True
) -> Any:
    """Return the value as a float64 array. The shape is checked before values are copied.

    allowed : allowed shapes, for messages
    fits    : function that returns True for allowed shapes

    Raises UsageError.
    """
    import numpy as np

    shape = None
    try:
        found = np.asarray(value)
        shape = found.shape
        if not is_numbers(found):
            raise TypeError
        if fits(shape):
            return np.asarray(found, np.float64)
    except MemoryError:
        raise UsageError(f"{name}: of shape {shape} does not fit into memory", "Divide it into parts.") from None
    except Exception:  # elements may raise any error
        raise UsageError(f"{name}: {short_repr(value)} where an array of numbers is needed") from None
    raise UsageError(f"{name}: of shape {shape} where {allowed} is needed")


def check_array(
    name: str,
    values: Any,
    shape: tuple[int | None, ...],
    allowed: tuple[float, float],
    *,
    may_lack: bool = False,
    whole: bool = False,
) -> Any:
    """Return an array as float64, or int64 if `whole`. Raises UsageError that names the first wrong number.

    name     : name of the argument
    shape    : needed shape; None stands for any length
    allowed  : smallest and largest number
    may_lack : True if numbers may be NaN
    whole    : True if the numbers must be integers
    """
    import numpy as np

    def fits(found: tuple[int, ...]) -> bool:
        return len(found) == len(shape) and all(n in (None, size) for n, size in zip(shape, found, strict=True))

    needed = ", ".join("N" if n is None else str(n) for n in shape) + "," * (len(shape) == 1)
    found = real_array(name, values, f"({needed})", fits)
    if whole:
        if np.asarray(values).dtype.kind not in "iu":
            raise UsageError(f"{name}: {short_repr(values)} where an array of whole numbers is needed")
        found = np.asarray(values, np.int64)
    low, high = allowed
    right = (found >= low) & (found <= high)
    if may_lack:
        right |= np.isnan(found)
    if not right.all():
        at = np.unravel_index(int(np.argmin(right)), found.shape)
        position = ", ".join(map(str, map(int, at)))
        numbers = "whole numbers" if whole else "NaN and numbers" if may_lack else "finite numbers"
        raise UsageError(
            f"{name}[{position}]: {found[at]:g} where {numbers} from {low:g} to {high:g} are allowed",
            "Correct the number, or leave its row out.",
        )
    return found


def _wrong(name: str, value: object, needed: Sequence[str], failure: Exception | None = None) -> UsageError:
    """Return the error for an argument of a wrong type.

    failure : error that a method of the value raised
    """
    remedy, kind = "", type(value)
    if isinstance(failure, OverflowError):
        remedy = "Numbers must fit into 64 bits."
    elif failure is not None:
        remedy = f"A method of the {_class_name(kind)} raised {short_repr(failure)}."
    elif _is_masked(value):
        remedy = "Masked values are no numbers: leave them out, or replace them with filled()."
    elif issubclass(kind, str) and "a Film" in needed:
        remedy = "glpath.Film.load reads a film from its file."
    elif issubclass(kind, str) and any("number" in each for each in needed):
        remedy = "Write numbers without quotation marks."
    elif issubclass(kind, dict) and "a Camera" in needed:
        remedy = "Fields of a camera are arguments of their own: with_camera(position=(0, 1, 5))."
    elif issubclass(kind, bytes) and _PATH in needed:
        remedy = "os.fsdecode makes text of bytes."
    first = [each for each in dict.fromkeys(needed) if each != "None"]
    allowed = " or ".join([*first, *["None"] * ("None" in needed)])
    return UsageError(f"{name}: {short_repr(value)} where {allowed} is needed", remedy)


def _large_integer(values: Iterable[Any]) -> int | None:
    """Return an integer of more than 64 bits in nested values; None if there is none.

    The search goes level by level, so that built-in functions such as `map` visit the elements of long lists, which
    is fast. Methods of derived classes are not called, because they may raise errors.
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
                plain: Any = next(base for base in _LISTS if issubclass(kind, base))
                nested += [plain.__iter__(each) for each in level if type(each) is kind]
            elif issubclass(kind, dict):
                of_kind = [each for each in level if type(each) is kind]
                nested += [part for each in of_kind for part in (dict.keys(each), dict.values(each))]
            elif _class_name(kind) == "ndarray":
                arrays: list[Any] = [each for each in level if type(each) is kind]
                nested += [each.ravel() for each in arrays if each.dtype.kind == "O"]
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


def _is_time(value: object) -> bool:
    """Return True for numpy's timedelta64 and datetime64, which numpy converts to numbers."""
    return type(value).__name__ in ("timedelta64", "datetime64")


def _is_path(value: object) -> bool:
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else b""
    try:
        return isinstance(text, str) and b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:  # a lone surrogate
        return False


def _is_names(value: Any) -> bool:
    """Return True for a dictionary, or another object like a dictionary, whose keys are text."""
    return isinstance(value, Mapping) and all(isinstance(key, str) for key in value)


def _is_array(value: object) -> bool:
    return type(value).__name__ == "ndarray"


def _is_masked(value: Any) -> bool:
    """Return True for an array with masked values."""
    return _has_class_name("MaskedArray", value) and bool(value.mask.any())


def _is_list(value: Any) -> bool:
    if isinstance(value, (*_LISTS, Sequence)):
        return not isinstance(value, str | bytes)
    return _is_array(value) and value.ndim > 0


def is_numbers(value: Any) -> bool:
    """Return True for a number, an array of numbers, nested lists of numbers, or an object that numpy converts.

    Masked values are not numbers.
    """
    if _is_array(value) and value.dtype.kind in "fiub":  # most arrays
        return True
    if _is_masked(value):
        return False
    if isinstance(value, list | tuple) or _is_array(value):
        import numpy as np

        try:
            value = np.asarray(value)
            if value.dtype.kind == "O":
                if any(each is None or isinstance(each, str | bytes) or _is_time(each) for each in value.flat):
                    return False
                value = value.astype(np.float64)
        except Exception:  # elements may raise any error
            return False
    if hasattr(value, "dtype") and hasattr(value.dtype, "kind"):
        return value.dtype.kind not in "SUVmMc"
    return _is_number(value) or hasattr(value, "__array__") or hasattr(value, "__array_interface__")


def _is_labels(value: Any) -> bool:
    return not _is_masked(value) and (_is_list(value) or hasattr(value, "__array__"))


def _has_class_name(name: str, value: object) -> bool:
    return any(_class_name(kind) == name for kind in type(value).__mro__)


def _is_iterable(value: object) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, str | bytes) and getattr(value, "ndim", 1) != 0


# Converters of allowed values.


def _without_subclass(value: Any) -> Any:
    """Return an object of a subclass of int, float or str as int, float or str; other objects are unchanged.

    NumPy's classes are unchanged.
    """
    if type(value).__module__ != "numpy":
        for kind, convert in ((str, str.__str__), (int, int.__int__), (float, float.__float__)):
            if issubclass(type(value), kind) and type(value) not in (kind, bool):
                return convert(value)
    return value


def _plain_number(value: Any) -> Any:
    """Return NumPy's bools and integers as bool and int, and other real numbers as float."""
    value = _without_subclass(value)
    if isinstance(value, int | float):
        return value
    if type(value).__module__ == "numpy" and (_is_flag(value) or _is_whole(value)):
        return value.item()
    return float(value) if _is_number(value) else value


def _plain_numbers(value: Any) -> Any:
    return value if _is_array(value) or {*map(type, value)} <= {int, float} else tuple(map(_plain_number, value))


def _plain_names(value: Mapping[str, Any]) -> dict[str, Any]:
    return value if type(value) is dict else dict(value)


def _plain_path(value: Any) -> Any:
    from pathlib import Path

    return value if isinstance(value, Path) else _without_subclass(os.fspath(value))


def _plain_array(value: Any) -> Any:
    """Return an object that numpy converts as numpy's array, lists and arrays as they are."""
    import numpy as np

    if isinstance(value, (*_LISTS, np.ndarray)):
        return value
    plain = _plain_number(value)
    return np.asarray(value) if plain is value and not isinstance(value, int | float | np.generic) else plain


def _plain_real_array(value: Any) -> Any:
    found = _plain_array(value)
    if found is not value and not is_numbers(found):
        raise TypeError(f"its values are of the type {found.dtype}")
    return found


_PATH = "a path without NUL characters and lone surrogates"
_NAMED: Mapping[str, _Type] = {
    "None": _Type(lambda value: value is None, "None"),
    "bool": _Type(_is_flag, "True or False", _plain_number),
    "int": _Type(_is_whole, "a whole number", _plain_number),
    "float": _Type(_is_number, "a number", _plain_number),
    "str": _Type(lambda value: isinstance(value, str), "text", _without_subclass),
    "Path": _Type(_is_path, _PATH, _plain_path),
    "Callable": _Type(callable, "a function"),
    "Mapping": _Type(_is_names, "a dictionary whose keys are text", _plain_names),
    "Iterable": _Type(_is_iterable, "a list"),
    "labels": _Type(_is_labels, "an array of labels", _plain_array),
    "ArrayLike": _Type(is_numbers, "an array of numbers", _plain_real_array),
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
        return _Type(_is_whole, " or ".join(map(str, words)), _plain_number)
    allowed = " or ".join(f'"{word}"' for word in words)
    return _Type(lambda value: isinstance(value, str), allowed, _without_subclass)


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

    return _Type(accepts, f"a tuple of {length}numbers", _plain_numbers)


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
