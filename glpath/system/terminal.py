"""Output of text to a terminal or log, with control characters of the input shown as escapes.

Names in a scene, quoted lines of it, and file names can hold characters that control a terminal: they change its
title, clear the screen or overwrite text. Others hide text, such as bidirectional overrides and zero-width
characters. The command line prints only through `say`, `say_json` or a `clean_console`, which write such characters
as escapes.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import logging
import os
import sys
import unicodedata
from collections.abc import Iterable, Iterator
from typing import IO, Any, cast

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from glpath.errors import ImageError
from glpath.system.report_pipe import pipe_or_terminal, write_report

# Unicode's general categories of the characters that are escaped: controls, formats (bidirectional, zero width),
# halves of surrogates, unassigned, separators of lines and of paragraphs.
_ESCAPED = frozenset({"Cc", "Cf", "Cs", "Cn", "Zl", "Zp"})


def clean(text: str) -> str:
    """Return `text` with escapes instead of characters that control a terminal.

    Escapes look like `\\x1b` for characters below U+0100, and like `U+202E` for others. Line breaks, tabs and all
    visible characters are kept. A byte of a file name that is not UTF-8 becomes `\\xff`.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else _escape(c) for c in text)


def _escape(character: str) -> str:
    code = ord(character)
    if unicodedata.category(character) not in _ESCAPED:
        return character
    if 0xDC80 <= code <= 0xDCFF:  # surrogate escape of a byte that Python could not decode
        code -= 0xDC00
    return f"\\x{code:02x}" if code < 0x100 else f"U+{code:04X}"


class ReportStream:
    """Text stream for reports, which drops text that cannot be written: reports never end or stop the work.

    Text for a pipe, socket or terminal is buffered until the end of a line or a `flush`, and dropped if nobody
    reads it.

    stream : stream that gets the text; None drops all text
    """

    def __init__(self, stream: IO[str] | None) -> None:
        self._stream = stream
        self._descriptor = pipe_or_terminal(stream)
        self._line = ""
        self.encoding = getattr(stream, "encoding", None) or "utf-8"
        self.errors = getattr(stream, "errors", None) or "backslashreplace"

    def write(self, text: str) -> int:
        """Write text, or drop it if the stream is full, closed or disconnected. Returns the length of the text."""
        if self._descriptor is not None:
            self._line += text
            if "\n" in text:
                self.flush()
        elif self._stream is not None:
            with contextlib.suppress(Exception):  # streams of notebooks and other programs raise any error
                self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush the stream if that is possible."""
        with contextlib.suppress(Exception):
            if self._descriptor is not None:
                line, self._line = self._line, ""
                write_report(self._descriptor, line.encode(self.encoding, self.errors))
            elif self._stream is not None:
                self._stream.flush()

    def fileno(self) -> int:
        """Return the descriptor of the stream. Raises OSError if it has none."""
        try:
            if self._stream is not None:
                return self._stream.fileno()
        except Exception as error:
            raise io.UnsupportedOperation("fileno") from error
        raise io.UnsupportedOperation("fileno")

    def isatty(self) -> bool:
        """Return True if the stream is a terminal."""
        try:
            return self._stream is not None and self._stream.isatty()
        except Exception:  # for example ValueError, because the stream is closed
            return False


def report_stream(stream: IO[str] | None) -> IO[str]:
    """Return a stream that writes reports to `stream`. A failed write raises no error."""
    return cast("IO[str]", stream if isinstance(stream, ReportStream) else ReportStream(stream))


def say(text: str = "", err: bool = False) -> None:
    """Print one or more lines on standard output; with `err`, as a report on standard error.

    Raises ImageError if standard output cannot be written.
    """
    _print(clean(text), err)


def say_json(value: object, indent: int | None = None, err: bool = False) -> None:
    """Print a value as JSON, with JSON's own escapes instead of characters that control a terminal.

    Raises ImageError if standard output cannot be written.
    """
    text = json.dumps(value, indent=indent, ensure_ascii=False)
    if clean(text) != text:
        text = "".join(c if clean(c) == c else json.dumps(c)[1:-1] for c in text)
    _print(text, err)


def _print(text: str, err: bool) -> None:
    if err:
        print(text, file=report_stream(sys.stderr), flush=True)
        return
    with _standard_output() as stream:
        print(text, file=stream, flush=True)


@contextlib.contextmanager
def _standard_output() -> Iterator[IO[str]]:
    """Context in which text is written to standard output.

    Raises ImageError if that is closed, or if nobody reads it, because a result would be lost without a message.
    """
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, "it is closed")
        yield sys.stdout
    except (OSError, ValueError) as error:  # ValueError: the stream was closed by this program
        reason = getattr(error, "strerror", None) or str(error)
        raise ImageError(f"standard output: cannot be written: {reason.rstrip('.')}.") from error


def has_no_reader(error: BaseException) -> bool:
    """Return True for an error of `say` because the reader of standard output has ended, as after `| head`.

    Programs of Unix then end without a message.
    """
    return isinstance(error.__cause__, BrokenPipeError)


class _CleanConsole(Console):
    """Console that passes its own control sequences to the terminal, but escapes those in the text.

    Raises ImageError if it prints on standard output, and that cannot be written.
    """

    def print(self, *objects: Any, **how: Any) -> None:
        with contextlib.nullcontext() if self._file is not None else _standard_output():
            super().print(*objects, **how)

    def on_broken_pipe(self) -> None:
        # Without this method, rich would end the process without a message.
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    def render_str(self, text: str, **how: Any) -> Text:
        # Escape before lines are wrapped and columns measured, because an escape is longer than its character.
        return super().render_str(clean(text), **how)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=clean(segment.text))


def clean_console(stream: IO[str] | None = None, **how: Any) -> Console:
    """Return a console for tables and bars.

    stream : stream that gets the text; None: standard output
    how    : further arguments of rich's `Console`
    """
    return _CleanConsole(file=stream, emoji=False, **how)


class CleanHandler(logging.Handler):
    """Log handler that looks up `sys.stderr` anew for each record, so that replacing the stream takes effect."""

    def emit(self, record: logging.LogRecord) -> None:
        say(self.format(record), err=True)
