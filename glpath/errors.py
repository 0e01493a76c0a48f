"""Errors that a user can cause; their texts give the location, the value found, allowed values and a remedy.

All errors derive from `GlpathError`. The command line prints the text as one block without a traceback.
"""

from __future__ import annotations

import os
import re
import sys
import sysconfig
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

_PACKAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "")
# Words of 300 letters or more are shortened. File names have at most 255 bytes, and a slash ends a word, so paths
# are not shortened.
_LONG_WORD = re.compile(r"[^\s/]{300,}")
# Number of characters that a shortened word keeps at each end.
_ENDS = 40
_SURROGATE = re.compile("[\ud800-\udfff]")
# Maximum number of locations that one warning lists.
_LISTED_LOCATIONS = 4
_LIBRARY = os.path.join(sysconfig.get_path("stdlib"), "")


#: Function that writes an argument: its name, and one value or several alternatives.
Notation = Callable[[str, Sequence[object]], str]


def _in_python(name: str, values: Sequence[object]) -> str:
    return f"{name}={' or '.join(map(_literal, values))}"


def _literal(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_literal, value))}{',' * (len(value) == 1)})"
    if isinstance(value, float):
        return f"{value:g}"
    return repr(value)


# Notation of arguments in messages. A process has one command at a time, so all its threads share it.
_notation: Notation = _in_python


def argument(name: str, *values: object) -> str:
    """Return an argument as the user writes it, for messages: integrator="path", or --integrator path in a command.

    values : its value; several are alternatives, joined by "or"
    """
    return _notation(name, values)


@contextmanager
def notation(write: Notation) -> Iterator[None]:
    """Context in which `argument` uses another notation, such as that of the command line."""
    global _notation
    before, _notation = _notation, write
    try:
        yield
    finally:
        _notation = before


class GlpathError(Exception):
    """Error in the input or the machine, explained to the user who can correct it.

    Parameters
    ----------
    message : value found and values allowed; the first words name the location
    remedy  : advice, printed on separate, indented lines
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        self.message = _printable(message)
        self.remedy = _printable(remedy)
        super().__init__(self.message)

    def __str__(self) -> str:
        if not self.remedy:
            return self.message
        return self.message + "".join(f"\n  {line}" for line in self.remedy.splitlines())


def _printable(text: str) -> str:
    """Return `text` with long words shortened and surrogates escaped, because UTF-8 cannot encode surrogates."""
    return shortened(encodable(text))


def encodable(text: str) -> str:
    """Return `text` with each surrogate replaced by an escape, so that UTF-8 can encode the text.

    Surrogates usually come from file names, because Python decodes each byte that is not valid UTF-8 as one.
    """

    def escape(code: int) -> str:
        return f"\\x{code - 0xDC00:02x}" if 0xDC80 <= code <= 0xDCFF else f"U+{code:04X}"

    return _SURROGATE.sub(lambda found: escape(ord(found[0])), text)


def shortened(text: str) -> str:
    """Return `text` with the middle cut out of each word of hundreds of letters, such as a 400-digit number."""
    return _LONG_WORD.sub(lambda word: f"{word[0][:_ENDS]}...{word[0][-_ENDS:]}", text)


def kept_in(exception: str, name: str, use: str) -> str:
    """Return the end of an interruption's message, which explains how to access the unfinished result.

    exception : name of the exception's class
    name      : name of the exception's attribute that has the result
    use       : call that resumes from the result
    """
    return (
        f".\n  What was done is in the exception's `{name}`, which {use} takes:\n"
        f"  try: ...\n  except glpath.{exception} as error: {name} = error.{name}\n"
        f"  In a notebook, and at Python's prompt, it is still at hand: import sys; {name} = sys.last_value.{name}"
    )


class SceneError(GlpathError):
    """Error for a scene file or a scene value that cannot be rendered."""


class ContextError(GlpathError):
    """Error if no OpenGL context can be created, or if a context is released, forked or out of memory."""


class ShaderError(GlpathError):
    """Error for a shader that does not compile or link; the message names its file and line."""


class ImageError(GlpathError):
    """Error for a file of an image, film or solution that cannot be read, written or compared."""


class UsageError(GlpathError):
    """Error for options that contradict each other or are out of range (exit code 2)."""


class TimeLimitError(GlpathError):
    """Error if the time limit ends before a result exists."""


class SceneWarning(UserWarning):
    """Warning about a scene that is not rendered as intended (no light, nothing in view, a degenerate triangle).

    result : result to which the warning applies, if a filter of `warnings` raises the warning; None if the warning
             came before a result existed
    """

    result: Any = None


class StrictError(GlpathError):
    """Error raised for a warning if `strict` is set.

    result : result to which the warnings apply; None if the warning came before a result existed
    """

    result: Any = None


@dataclass
class WarningScope:
    """Handling of warnings in one call or command.

    strict : True to raise warnings as errors
    of_command : True for the scope of a command
    late   : warnings about an existing result; `raise_late` raises them at the end, so that no result is lost
    raised : warnings about an existing result that a filter of `warnings` raises; `raise_late` raises the first
    """

    strict: bool = False
    of_command: bool = False
    late: list[str] = field(default_factory=list)
    raised: list[SceneWarning] = field(default_factory=list)

    def raise_late(self, result: Any = None) -> None:
        """Raise the first late warning (see `warn`), with `result` attached, if the scope or a filter raises it.

        The exception is a StrictError in a strict scope, and otherwise the SceneWarning that a filter raised.
        """
        if self.strict and self.late:
            first, *others = self.late
            more = f" {len(others)} more warnings came after it." if others else ""
            error = StrictError(
                first, f"strict takes this warning for an error; there is a result nevertheless.{more}"
            )
            error.result = result
            raise error
        if self.raised:
            self.raised[0].result = result
            raise self.raised[0]


_scope: ContextVar[WarningScope | None] = ContextVar("warnings", default=None)


@contextmanager
def warning_scope(strict: bool, of_command: bool = False) -> Iterator[WarningScope]:
    """Context in which warnings become errors if `strict` is True.

    In a strict context, `warn` raises StrictError, or records a late warning for `raise_late`. A strict context
    within that of a command makes the latter strict. Within a call that is not strict, such as in its `on_step`, it
    stands alone. In all other cases, late warnings of a nested context go to the outer context.

    of_command : True for the context of a command
    """
    outer = _scope.get()
    if outer is not None and (outer.of_command or outer.strict or not strict):
        outer.strict |= strict
        yield WarningScope()
        return
    token = _scope.set(scope := WarningScope(strict, of_command))
    try:
        yield scope
    finally:
        _scope.reset(token)


def current_warnings() -> WarningScope:
    """Return the scope of the current call or command, or an empty scope."""
    return _scope.get() or WarningScope()


def warn(text: str, late: bool = False) -> None:
    """Issue a SceneWarning that points at the user's line that called glpath, however deep the call stack is.

    late : True if the warning is about an existing result; a scope then keeps the result and raises later

    Raises StrictError within a strict `warning_scope`, unless the warning is late or filtered out. Raises the
    SceneWarning if a filter of `warnings` demands it, unless the warning is late and within a `warning_scope`.
    """
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and _is_ours(frame.f_code.co_filename):
        level, frame = level + 1, frame.f_back
    scope = current_warnings()
    if scope.strict and not _is_ignored(text, frame):
        if not late:
            raise StrictError(text, "strict takes this warning for an error.")
        scope.late.append(text)
    if (collected := _collected.get()) is not None:
        collected[text] = None
        return
    try:
        warnings.warn(SceneWarning(text), stacklevel=level)
    except SceneWarning as raised:  # by a filter of `warnings`
        if scope.strict:  # `scope.late` holds the text
            return
        if not late or _scope.get() is None:
            raise
        scope.raised.append(raised)
    except Exception:  # of the function or stream that shows warnings; reporting never ends the work
        return


# Texts of the warnings in `collected_warnings`, as an ordered set; None outside of it.
_collected: ContextVar[dict[str, None] | None] = ContextVar("_collected", default=None)


@contextmanager
def collected_warnings() -> Iterator[Mapping[str, None]]:
    """Context in which this thread collects the texts of its scene warnings, in order, instead of showing them."""
    texts: dict[str, None] = {}
    token = _collected.set(texts)
    try:
        yield texts
    finally:
        _collected.reset(token)


def _is_ignored(text: str, frame: FrameType) -> bool:
    """Return True if a filter of the module `warnings` ignores the warning `text` at the current line of a frame.

    Filters that ignore all warnings do not count, because code that is not about glpath sets them. Such a filter
    applies to all threads of the process, and for ever if threads leave `warnings.catch_warnings` out of order.
    """
    name = frame.f_globals.get("__name__", "")
    for action, message, category, module, line in _filters():
        is_general = action == "ignore" and message is module is None and category is not SceneWarning
        if (
            not is_general
            and issubclass(SceneWarning, category)
            and (message is None or message.match(text))
            and (module is None or module.match(name))
            and line in (0, frame.f_lineno)
        ):
            return bool(action == "ignore")
    return False


class _OneThread:
    """Text pattern of a filter of `warnings` that matches each text in the thread that made the pattern."""

    def __init__(self) -> None:
        self.thread: int | None = threading.get_ident()

    def match(self, text: str) -> bool:
        return self.thread == threading.get_ident()


@contextmanager
def warning_filter(action: str, category: type[Warning] = Warning) -> Iterator[None]:
    """Context with a filter of `warnings` that applies only to the current thread.

    `warnings.catch_warnings` saves and restores the filters of all threads. If two threads leave it in the order in
    which they entered it, the filters of the first stay for ever.

    action   : action of a filter, such as "ignore" or "error"
    category : class of the warnings
    """
    pattern = _OneThread()
    entry = action, pattern, category, None, 0
    _filters().insert(0, entry)
    if action == "error" and (forget := getattr(warnings, "_filters_mutated", None)) is not None:
        forget()  # because Python asks no filter about a warning that it has shown before
    try:
        yield
    finally:
        pattern.thread = None  # because a `catch_warnings` of another thread may restore the filter later
        with suppress(ValueError):  # another thread has exchanged the list
            _filters().remove(entry)


def _filters() -> list[Any]:
    filters: Any = warnings.filters
    return filters  # type: ignore[no-any-return]


# Location and count of each delayed warning, by cause and then by text; None outside of `one_warning_per_cause`.
_waiting: ContextVar[dict[str, dict[str, tuple[str, int]]] | None] = ContextVar("_waiting", default=None)


def warn_at(location: str, counts: Mapping[str, int], text: str) -> None:
    """Issue the warning `text`; inside `one_warning_per_cause`, merge it with warnings of the same cause.

    location : location in the merged warning, such as a file
    counts   : number of affected items by cause, such as "triangles without area were dropped"
    """
    waiting = _waiting.get()
    if waiting is None:
        warn(text)
        return
    for cause, count in counts.items():
        waiting.setdefault(cause, {})[text] = location, count


@contextmanager
def one_warning_per_cause() -> Iterator[None]:
    """Collect calls of `warn_at` inside this context; when it ends, issue one warning for each cause."""
    if _waiting.get() is not None:
        yield
        return
    waiting: dict[str, dict[str, tuple[str, int]]] = {}
    token = _waiting.set(waiting)
    try:
        yield
    finally:
        _waiting.reset(token)
    texts: dict[str, None] = {}  # an ordered set, because several causes may have the same text
    for cause, found in waiting.items():
        if len(found) == 1:
            texts |= dict.fromkeys(found)
            continue
        entries = list(found.values())
        total = sum(count for _, count in entries)
        listed = ", ".join(f"{location}: {count:,}" for location, count in entries[:_LISTED_LOCATIONS])
        more = ", ..." if len(entries) > _LISTED_LOCATIONS else ""
        texts[f"{total:,} {cause} in {len(entries):,} locations: {listed}{more}."] = None
    for text in texts:
        warn(text)


def _is_ours(file: str) -> bool:
    """Return True for files of this package, and of the standard library, which calls back into the package."""
    if file.startswith(_PACKAGE):
        return True
    return file.startswith(_LIBRARY) and "-packages" not in file
