"""Commands that are imported when they are called, so that each starts in the time that it needs itself."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import typer
from rich.markup import escape
from typer.core import TyperCommand
from typer.main import get_group

from glpath.cli.help import EXAMPLE
from glpath.cli.plain_values import spare_conversions


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
            command = self._made[name] = _as_written(get_group(app).commands[name])
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
