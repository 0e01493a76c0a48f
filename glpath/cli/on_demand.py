"""Commands that are imported when they are called, so that a command does not wait for imports of others."""

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
    """Entry of a command in the list of a program.

    module : module whose `register(app)` adds the command
    group  : heading of the command in the program's help
    about  : one line of description
    """

    module: str
    group: str
    about: str


class CommandsOnDemand(Mapping[str, Any]):
    """Commands by name; a command of `parts` is imported when it is first looked up.

    made : commands that exist already

    Help texts are escaped, because rich would read `glpath[figures]` as a style.
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
        """Return name, group and description of all commands without importing them."""
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
    """Declare the option --strict, which is added to each command."""


def _strict_option() -> Any:
    carrier = typer.Typer(add_completion=False)
    carrier.command()(_carry_strict_option)
    return get_command(carrier).params[0]


def as_written(part: Any) -> None:
    """In the help texts of a command or parameter, join the lines of each paragraph and escape rich's markup."""
    for name in ("help", "short_help", "epilog"):
        if text := getattr(part, name, None):
            setattr(part, name, escape(_unwrapped(text)))


def _as_written(command: Any) -> Any:
    for part in (command, *command.params):
        as_written(part)
    return command


def _unwrapped(text: str) -> str:
    """Return the text with each paragraph on one line, for Typer to wrap; lines of examples are kept."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(each if each.startswith(EXAMPLE) else " ".join(each.split("\n")) for each in paragraphs)
