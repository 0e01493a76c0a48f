"""Commands that are imported when they are called, so that each starts in the time that it needs itself."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperCommand
from typer.main import get_command, get_group

from glpath.cli.help import EXAMPLE, OUTPUT_PANEL
from glpath.cli.plain_values import spare_conversions
from glpath.errors import current_warnings


@dataclass(frozen=True)
class Part:
    """One command of a program, as it is listed.

    module : has `register(app)`, which adds the command
    group  : under which the program's help lists it
    about  : what that list says of it
    """

    module: str
    group: str
    about: str


class CommandsOnDemand(Mapping[str, Any]):
    """Commands by name; those of `parts` are imported at the first look.

    Texts of help are shown as they are written: typer hands them to rich, to which `glpath[figures]` is a style.
    """

    def __init__(self, parts: Mapping[str, Part], made: Mapping[str, Any]) -> None:
        self._parts = parts
        self._made = {name: _as_written(command) for name, command in made.items()}

    def __getitem__(self, name: str) -> Any:
        if name not in self._made:
            app = typer.Typer()
            importlib.import_module(self._parts[name].module).register(app)
            command = get_group(app).commands[name]
            if all(param.name != "strict" for param in command.params):
                command.params.append(_strict_option())
            self._made[name] = _as_written(command)
            spare_conversions(command)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._parts, *self._made]))

    def __len__(self) -> int:
        return len({*self._parts, *self._made})

    def listed(self) -> dict[str, Any]:
        """All of them for a list: name, group and what it is. Nothing is imported."""
        listed = {
            name: TyperCommand(name, help=escape(part.about), rich_help_panel=part.group)
            for name, part in self._parts.items()
        }
        return listed | self._made


def _take_warnings_for_errors(strict: bool) -> None:
    current_warnings().strict |= strict


def _carry_strict_option(
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            expose_value=False,
            callback=_take_warnings_for_errors,
            help="Take warnings for errors: before the computation they end it; about a result, it is written and "
            "the exit code is 1.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = False,
) -> None:
    """Declare the option --strict, which each command gets."""


def _strict_option() -> Any:
    carrier = typer.Typer(add_completion=False)
    carrier.command()(_carry_strict_option)
    return get_command(carrier).params[0]


def as_written(part: Any) -> None:
    """Make texts of help of a command or of a parameter plain text: no markup, and no line breaks of ours."""
    for name in ("help", "short_help", "epilog"):
        if text := getattr(part, name, None):
            setattr(part, name, escape(_unwrapped(text)))


def _as_written(command: Any) -> Any:
    for part in (command, *command.params):
        as_written(part)
    return command


def _unwrapped(text: str) -> str:
    """Paragraphs as one line each, which Typer wraps to the terminal's width; examples stay lines."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(each if each.startswith(EXAMPLE) else " ".join(each.split("\n")) for each in paragraphs)
