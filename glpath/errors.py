"""What a user can cause, as errors that say where, what was found, what is allowed and what to do.

Everything derives from `GlpathError`; the command line prints its text as one block without a traceback.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

_PACKAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "")
# Number of locations that a warning of many lists.
_LISTED_LOCATIONS = 4
_LIBRARY = os.path.join(sysconfig.get_path("stdlib"), "")


class GlpathError(Exception):
    """A mistake in the input or the machine, explained to the person who can mend it.

    Parameters
    ----------
    message : what was found and what is allowed; its first words name the location
    remedy  : what to do about it; printed on lines of its own, indented
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        if not self.remedy:
            return self.message
        return self.message + "".join(f"\n  {line}" for line in self.remedy.splitlines())


def kept_in(exception: str, name: str, use: str) -> str:
    """What the text of an interruption ends with: how to get at what was done until then.

    exception, name : its class, and the attribute that holds it
    use             : the call that takes it
    """
    return (
        f".\n  What was done is in the exception's `{name}`, which {use} takes:\n"
        f"  try: ...\n  except glpath.{exception} as error: {name} = error.{name}\n"
        f"  In a notebook, and at Python's prompt, it is still at hand: import sys; {name} = sys.last_value.{name}"
    )


class SceneError(GlpathError):
    """A scene file or a scene value that cannot be rendered."""


class ContextError(GlpathError):
    """No usable OpenGL context, or one used where it must not be."""


class ShaderError(GlpathError):
    """A shader that does not compile or link; the message names its file and line."""


class ImageError(GlpathError):
    """A picture, a film or a solution whose file cannot be read or written, or a picture that can't be compared."""


class UsageError(GlpathError):
    """Options that contradict each other or are out of range (exit code 2)."""


class TimeLimitError(GlpathError):
    """The time limit was over before there was a result."""


class SceneWarning(UserWarning):
    """A scene that renders, but hardly as meant (no light, nothing in view, a degenerate triangle)."""


class StrictError(GlpathError):
    """A warning that `strict` takes for an error.

    result : the result that the warnings are about; None if the warning came before there was one
    """

    result: Any = None


@dataclass
class WarningScope:
    """Warnings of one call or one command.

    strict : takes warnings for errors
    late   : warnings about a result, which is to be saved before they become an error
    """

    strict: bool = False
    late: list[str] = field(default_factory=list)

    def raise_late(self, result: Any = None) -> None:
        """Raise StrictError for warnings about a result, which is then in the error's `result`."""
        if self.strict and self.late:
            first, *others = self.late
            more = f" {len(others)} more warnings came after it." if others else ""
            error = StrictError(
                first, f"strict takes this warning for an error; there is a result nevertheless.{more}"
            )
            error.result = result
            raise error


_scope: ContextVar[WarningScope | None] = ContextVar("warnings", default=None)


@contextmanager
def warning_scope(strict: bool) -> Iterator[WarningScope]:
    """Take warnings for errors within the block, if `strict`.

    Then `warn` raises StrictError, or notes a late warning for `raise_late`. Within another block nothing begins
    anew: the outer block becomes strict, and gets the late warnings.
    """
    outer = _scope.get()
    if outer is not None:
        outer.strict |= strict
        yield WarningScope()
        return
    token = _scope.set(scope := WarningScope(strict))
    try:
        yield scope
    finally:
        _scope.reset(token)


def current_warnings() -> WarningScope:
    """Return the scope of the call or command that runs, or an empty one."""
    return _scope.get() or WarningScope()


def warn(text: str, late: bool = False) -> None:
    """Warn `SceneWarning`, of the line that called glpath, however deep the reason is found.

    late : the warning is about a result that exists, which `strict` must not lose

    Raises StrictError within a strict `warning_scope`, unless the warning is late or filtered out.
    """
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and _is_ours(frame.f_code.co_filename):
        level, frame = level + 1, frame.f_back
    scope = current_warnings()
    if scope.strict:
        is_shown = _is_shown(text, level)
        if is_shown and not late:
            raise StrictError(text, "strict takes this warning for an error.")
        scope.late += [text] * is_shown
    with suppress(SceneWarning) if scope.strict else nullcontext():  # `late` has what a filter makes an error
        warnings.warn(SceneWarning(text), stacklevel=level)


def _is_shown(text: str, level: int) -> bool:
    """Return True unless a filter of the module `warnings` ignores the warning."""
    try:
        with warnings.catch_warnings(record=True) as shown:
            warnings.warn(SceneWarning(text), stacklevel=level + 1)
    except SceneWarning:
        return True
    return bool(shown)


#: Warnings that wait for others of the same cause, as (location, count, text) by cause; None if none are to wait.
# By cause: location and count of each warning, by its text.
_waiting: ContextVar[dict[str, dict[str, tuple[str, int]]] | None] = ContextVar("_waiting", default=None)


def warn_at(location: str, counts: Mapping[str, int], text: str) -> None:
    """Warn as `warn`, or within `one_warning_per_cause` once for all locations with the same cause.

    counts : numbers by cause, such as "triangles without area were dropped"
    """
    waiting = _waiting.get()
    if waiting is None:
        warn(text)
        return
    for cause, count in counts.items():
        waiting.setdefault(cause, {})[text] = location, count


@contextmanager
def one_warning_per_cause() -> Iterator[None]:
    """Context in which calls of `warn_at` become one warning for each cause, at its end."""
    if _waiting.get() is not None:
        yield
        return
    waiting: dict[str, dict[str, tuple[str, int]]] = {}
    token = _waiting.set(waiting)
    try:
        yield
    finally:
        _waiting.reset(token)
    texts: dict[str, None] = {}  # a text of several causes comes once
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
    """Of this package; or of Python's own library, by whose context managers and threads it calls itself."""
    if file.startswith(_PACKAGE):
        return True
    return file.startswith(_LIBRARY) and "-packages" not in file
