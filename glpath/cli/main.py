"""The `glpath` command: handling of errors, warnings and exit codes for all subcommands.

Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted; the help of some commands lists more. An error
that a user can cause is printed as one block without a traceback; a traceback is a bug in glpath.
"""

from __future__ import annotations

import atexit
import io
import logging
import os
import re
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import IO, Annotated, Any, ClassVar

import typer
from typer.core import TyperGroup

import glpath
from glpath.cli.commands import COMMANDS
from glpath.cli.help import flags_without_a_type
from glpath.cli.on_demand import CommandsOnDemand, Part, as_written
from glpath.cli.plain_values import spare_conversions
from glpath.cli.signals import (
    INTERRUPTED,
    RESUME_LATER,
    arrived,
    asks_to_resume,
    exit_code,
    forget,
    signals_wait_for_results,
)
from glpath.cli.typed import as_option, remember_words, typed_words
from glpath.errors import GlpathError, SceneWarning, UsageError, notation, shortened, warning_scope
from glpath.system.files import missing_current_folder, recorded_inputs
from glpath.system.log import compilations
from glpath.system.signals import is_interruption
from glpath.system.terminal import CleanHandler, has_no_reader, report_stream, say
from glpath.system.time_limit import command_clock

FAILED, WRONG_USAGE = 1, 2
_LESS = "Take a smaller scene or picture, or allow more memory (`ulimit -v`, the container's limit)."


class Commands(TyperGroup):
    """Command group that turns exceptions and warnings into lines on stderr and an exit code.

    parts : commands by name; the module of a command is imported when the command is used
    """

    parts: ClassVar[Mapping[str, Part]] = {}

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands: Any = CommandsOnDemand(self.parts, self.commands)
        for part in (self, *self.params):
            as_written(part)
        spare_conversions(self)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        commands = self.commands
        self.commands = commands.listed()
        try:
            with flags_without_a_type(self.get_params(ctx)):
                super().format_help(ctx, formatter)
        finally:
            self.commands = commands

    def make_context(self, info_name: str | None, args: list[str], *given: Any, **more: Any) -> Any:
        words = list(args)  # a copy, because the parser removes the words that it has read
        with _wrong_usage_as_lines():
            context = super().make_context(info_name, args, *given, **more)
        remember_words(context, words)
        return context

    def invoke(self, ctx: Any) -> Any:
        with _wrong_usage_as_lines():
            return self._invoke(ctx)

    def _invoke(self, ctx: Any) -> Any:
        signals = signals_wait_for_results(asks_to_resume(typed_words(ctx)))
        of_command = warning_scope(strict=False, of_command=True)
        with _warnings_and_logs_as_lines(), recorded_inputs(), signals, of_command as scope:
            try:
                done = super().invoke(ctx)
                scope.raise_late()
                if arrived() and exit_code() == RESUME_LATER:
                    forget()  # nothing is left to resume
                if arrived():
                    say("glpath: interrupted: all was done and is written", err=True)
                    raise typer.Exit(INTERRUPTED)
                return done
            except GlpathError as error:
                raise _reported(error) from error
            except FileNotFoundError as error:
                if _current_folder_exists():
                    raise
                say(f"glpath: error: {missing_current_folder()}", err=True)
                raise typer.Exit(FAILED) from error
            except MemoryError as error:
                reason = f": {error}" if str(error) else ""
                say(f"glpath: error: there is not enough memory{shortened(reason)}.\n  {_LESS}", err=True)
                raise typer.Exit(FAILED) from error
            except (KeyboardInterrupt, Exception) as stop:
                ended = not isinstance(stop, typer.Exit | typer.Abort) and arrived() and is_interruption(stop)
                if not (ended or isinstance(stop, KeyboardInterrupt)):
                    raise
                say("glpath: interrupted", err=True)
                raise typer.Exit(exit_code()) from stop


def _reported(error: GlpathError) -> typer.Exit:
    """Print an error, and return the exit of the command."""
    if has_no_reader(error):
        return typer.Exit(FAILED)
    say(f"glpath: error: {shortened(str(error))}", err=True)
    return typer.Exit(WRONG_USAGE if isinstance(error, UsageError) else FAILED)


@contextmanager
def _wrong_usage_as_lines() -> Iterator[None]:
    """Report errors of the parser and of option callbacks in the format of other errors, not in typer's box.

    Messages name arguments in the notation of the command line.
    """
    try:
        with notation(as_option):
            yield
    except GlpathError as error:  # of the callback of an option
        raise _reported(error) from error
    except Exception as error:
        # Errors of Click are recognized by a method, because Typer may bundle its own copy of Click.
        # NoArgsIsHelpError is not a mistake of the user. Typer raises it to show the help if a program is called
        # without arguments.
        if not hasattr(error, "format_message") or type(error).__name__ == "NoArgsIsHelpError":
            raise
        context = getattr(error, "ctx", None)
        command = "glpath" if context is None else context.command_path
        say(
            f"glpath: error: {shortened(error.format_message())}\n  `{command} --help` says what is allowed.",
            err=True,
        )
        raise typer.Exit(WRONG_USAGE) from error


@contextmanager
def _warnings_and_logs_as_lines() -> Iterator[None]:
    def show(message: Warning | str, category: type[Warning], *location: Any, **more: Any) -> None:
        if issubclass(category, SceneWarning):
            say(f"glpath: warning: {shortened(str(message))}", err=True)
        else:
            say(warnings.formatwarning(message, category, *location[:2]).rstrip(), err=True)

    logs = CleanHandler(logging.WARNING)
    # With --verbose, the logger "glpath" also passes messages below WARNING.
    own, details = logging.getLogger("glpath"), CleanHandler(logging.DEBUG)
    details.addFilter(lambda record: record.levelno < logging.WARNING)
    levels = [(each, each.level) for each in (own, compilations.logger)]
    with warnings.catch_warnings():
        warnings.simplefilter("always", SceneWarning)
        warnings.showwarning = show
        logging.getLogger().addHandler(logs)
        own.addHandler(details)
        try:
            yield
        finally:
            for each, level in levels:
                each.setLevel(level)
            own.removeHandler(details)
            logging.getLogger().removeHandler(logs)


def _traceback_as_lines(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    say("".join(traceback.format_exception(kind, error, trace)).rstrip(), err=True)


def program(name: str, about: str, parts: Mapping[str, Part]) -> typer.Typer:
    """Create a program whose commands report errors and warnings as lines and use this module's exit codes."""
    made = typer.Typer(
        name=name,
        cls=type("ProgramCommands", (Commands,), {"parts": parts}),
        help=about,
        epilog="Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted (what had been rendered is written); "
        "render has more.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback()(lambda: None)  # without a callback, Typer drops the name of a program's only command
    return made


app = program(
    "glpath",
    "Global illumination on OpenGL 4.3, on a graphics card or without one, and without a screen.",
    COMMANDS,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"glpath {glpath.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end."),
    ] = False,
) -> None:
    pass


def _current_folder_exists() -> bool:
    try:
        os.getcwd()
    except OSError:
        return False
    return True


def run(commands: typer.Typer = app, name: str = "glpath") -> None:
    """Run a program: the `glpath` script, `python -m glpath`, or another program made by `program`."""
    sys.excepthook = _traceback_as_lines
    for width in ("COLUMNS", "TERMINAL_WIDTH"):
        if not re.fullmatch("[1-9][0-9]{0,3}", os.environ.get(width, "")):
            os.environ.pop(width, None)  # rich would print nothing in 0 columns
    threads = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if not threads:
        os.environ.pop("NUMBA_NUM_THREADS", None)
    elif not re.fullmatch("0*[1-9][0-9]{0,5}", threads):  # numba cannot be imported with such a value
        found = shortened(threads)
        say(f"glpath: error: NUMBA_NUM_THREADS is {found!r}; must be a whole number from 1.\n  Unset it.", err=True)
        raise SystemExit(WRONG_USAGE)
    cursor = os.environ.get("COMP_CWORD", "") if os.environ.get("COMP_WORDS") is not None else ""
    if os.environ.get("_GLPATH_COMPLETE") == "complete_bash" and not re.fullmatch("[0-9]{1,9}", cursor):
        text = "_GLPATH_COMPLETE: needs COMP_WORDS and COMP_CWORD, which bash sets.\n  Unset it."
        say(f"glpath: error: {text}", err=True)
        raise SystemExit(WRONG_USAGE)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Characters that stdout cannot encode are written as escapes, because an error would end the command.
        # Standard error does this by default.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        with command_clock():
            commands(prog_name=name)
    except OSError as error:
        if _takes(sys.stdout, "\n"):
            raise
        say(f"glpath: error: standard output: cannot be written: {error.strerror}.", err=True)
        raise SystemExit(FAILED) from error
    except SystemExit as end:
        if isinstance(end.code, int) and arrived():
            _end_with(end.code)
        raise
    finally:
        # Replace stderr if it cannot be flushed, because Python would then end with exit code 120.
        if not _takes(sys.stderr):
            sys.stderr = io.StringIO()


def run_and_end() -> None:
    """Call `run`, then end the process without Python's shutdown, which takes 0.1 s."""
    sys.stderr = report_stream(sys.stderr)  # because other packages print to stderr, too
    try:
        run()
    except SystemExit as end:
        others = (thread for thread in threading.enumerate() if thread is not threading.main_thread())
        if not isinstance(end.code, int) or not all(thread.daemon for thread in others):
            raise
        if end.code == 0 and not _takes(sys.stdout):
            raise  # Python then prints an error about stdout and sets the exit code
        _end_with(end.code)


def _takes(stream: IO[str] | None, text: str = "") -> bool:
    """Write `text` and flush the stream. Return False if that fails.

    stream : output stream; None (closed when Python started) counts as written
    """
    try:
        if stream is not None:
            stream.write(text)
            stream.flush()
    except (OSError, ValueError):
        return False
    return True


def _end_with(code: int) -> None:
    """End the process with this exit code, without Python's shutdown.

    After a signal, `sys.exit` could not set the code of `python -m`. It ends as if killed by SIGINT if a caught
    KeyboardInterrupt has passed through generated code, such as a dataclass method.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        _takes(stream)
    os._exit(code)
