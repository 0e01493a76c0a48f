"""Short help of a command (--help): its purpose, three examples and the options of everyday use.

`--help-all` shows all options. Examples and everyday options are given when a command is registered:
`app.command(**command_help(...))`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

from typer.core import TyperCommand

#: Maximum number of parameters in the short help of a command. A test checks it.
MAX_EVERYDAY = 25
#: Help panel of the options that control printed output.
OUTPUT_PANEL = "What is printed"
#: Start of the line above each example. A paragraph of the help that starts so keeps its line breaks.
EXAMPLE = "# "
_ALL = "--help-all"
_SHOWS_ALL = "glpath.help_all"


class HelpfulCommand(TyperCommand):
    """Command with examples; options that are not for everyday use appear only in --help-all.

    examples : pairs of a command line and a description of its effect
    everyday : names of the parameters that --help shows, besides required ones; if empty, all
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
    """Return keyword arguments of `app.command` for a command with examples and everyday parameters.

    examples : pairs of a command line and a description of its effect
    everyday : parameter names separated by blanks
    """
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
    """Within the block, hide the type <bool> that Typer shows for flags."""
    flags = [param for param in params if getattr(param, "is_flag", False)]
    for param in flags:
        param.display_type_rich = lambda **_: None
    try:
        yield
    finally:
        for param in flags:
            del param.display_type_rich
