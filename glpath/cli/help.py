"""What --help shows of a command: what it is for, three examples and the options of every day.

`--help-all` shows all of its options. A command says which at its registration: `app.command(**command_help(...))`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

from typer.core import TyperCommand

#: Of every command.
MAX_EVERYDAY = 25
#: The panel of options that say what is printed.
OUTPUT_PANEL = "What is printed"
#: How the paragraph of examples begins, whose lines stay as they are.
EXAMPLE = "# "
_ALL = "--help-all"
_SHOWS_ALL = "glpath.help_all"


class HelpfulCommand(TyperCommand):
    """A command with examples, most of whose options are shown by --help-all alone.

    examples : what is typed, and what it does
    everyday : parameters that --help shows; none: all of them
    """

    examples: ClassVar[Sequence[tuple[str, str]]] = ()
    everyday: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, *given: Any, **more: Any) -> None:
        super().__init__(*given, **more)
        if self.examples:
            first, *rest = (self.help or "").split("\n\n")
            lines = [f"{EXAMPLE}{what}\n{command}" for command, what in self.examples]
            self.help = "\n\n".join([first, "\n".join(lines), *rest])

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if _ALL in args:
            ctx.meta[_SHOWS_ALL] = True
            args = ["--help"]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        shown = [param for param in self.params if not getattr(param, "hidden", False)]
        rare = [
            param for param in shown if self.everyday and param.name not in self.everyday and not param.required
        ]
        if ctx.meta.get(_SHOWS_ALL):
            rare = []
        before = self.epilog
        if rare:
            more = f"{len(rare)} more options: {ctx.command_path} {_ALL}."
            self.epilog = f"{more} {before}" if before else more
        try:
            with _hidden(rare), flags_without_a_type(self.get_params(ctx)):
                super().format_help(ctx, formatter)
        finally:
            self.epilog = before


def command_help(*examples: tuple[str, str], everyday: str = "") -> dict[str, Any]:
    """What `app.command` takes for a command with examples and the parameters that --help shows."""
    given = {"examples": examples, "everyday": frozenset(everyday.split())}
    return {"cls": type("Command", (HelpfulCommand,), given)}


@contextmanager
def _hidden(params: Sequence[Any]) -> Iterator[None]:
    for param in params:
        param.hidden = True
    try:
        yield
    finally:
        for param in params:
            param.hidden = False


@contextmanager
def flags_without_a_type(params: Sequence[Any]) -> Iterator[None]:
    """Typer shows <bool> for what takes no value."""
    flags = [param for param in params if getattr(param, "is_flag", False)]
    for param in flags:
        param.display_type_rich = lambda **_: None
    try:
        yield
    finally:
        for param in flags:
            del param.display_type_rich
