"""What a user can cause, as errors that say where, what was found, what is allowed and what to do.

Everything derives from `GlpathError`; the command line prints its text as one block without a traceback.
"""

from __future__ import annotations


class GlpathError(Exception):
    """A mistake in the input or the machine, explained to the person who can mend it.

    Parameters
    ----------
    message : what was found and what is allowed; its first words name the place
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


class SceneError(GlpathError):
    """A scene file or a scene value that cannot be rendered."""


class ContextError(GlpathError):
    """No usable OpenGL context, or one used where it must not be."""


class ShaderError(GlpathError):
    """A shader that does not compile or link; the place is its own file and line."""


class ImageError(GlpathError):
    """A picture, a film or a solution whose file cannot be read or written, or a picture that can't be compared."""


class UsageError(GlpathError):
    """Options that contradict each other or are out of range (exit code 2)."""


class SceneWarning(UserWarning):
    """A scene that renders, but hardly as meant (no light, nothing in view, a degenerate triangle)."""
