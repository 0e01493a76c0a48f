"""What a user can cause, as errors that say where, what was found, what is allowed and what to do.

Everything derives from `GlpathError`; the command line prints its text as one block without a traceback.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import warnings

_PACKAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "")
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


class SceneWarning(UserWarning):
    """A scene that renders, but hardly as meant (no light, nothing in view, a degenerate triangle)."""


def warn(text: str) -> None:
    """Warn `SceneWarning`, of the line that called glpath, however deep the reason is found."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and _is_ours(frame.f_code.co_filename):
        level, frame = level + 1, frame.f_back
    warnings.warn(SceneWarning(text), stacklevel=level)


def _is_ours(file: str) -> bool:
    """Of this package; or of Python's own library, by whose context managers and threads it calls itself."""
    if file.startswith(_PACKAGE):
        return True
    return file.startswith(_LIBRARY) and "-packages" not in file
