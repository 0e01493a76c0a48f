"""Options of commands that set parameters of scenes. Each is declared once, and a command lists the ones it uses.

`with_scene_options` adds the options to a command, before its `-D`. Their values are appended to the list of `-D`,
so `--background plain` is the same as `-D background=plain`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from glpath.cli.completion import words
from glpath.errors import UsageError
from glpath.scene.choices import BACKGROUNDS

#: Help panel of the options for environment and background.
SURROUNDINGS_PANEL = "Surroundings"
MODEL_PANEL = "Model"


@dataclass(frozen=True)
class SceneOptions:
    """Values of the options as typed; None for an option that is not given."""

    environment: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.hdr|FILE.exr",
            help="Light the scene by an environment map, instead of its sky.",
            rich_help_panel=SURROUNDINGS_PANEL,
        ),
    ] = None
    environment_rotation: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Turn the environment, counter-clockwise seen from above.",
            rich_help_panel=SURROUNDINGS_PANEL,
        ),
    ] = None
    environment_exposure: Annotated[
        float | None,
        typer.Option(
            metavar="STOPS",
            help="Brightness of the environment: 1 doubles it.",
            rich_help_panel=SURROUNDINGS_PANEL,
        ),
    ] = None
    background: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(BACKGROUNDS),
            help="Behind all shapes: the sky; a grey, as bright as a white ground in its light; or nothing, which "
            "is an alpha channel in .png and .exr.",
            rich_help_panel=SURROUNDINGS_PANEL,
            autocompletion=words(BACKGROUNDS),
        ),
    ] = None
    animation: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The animation of a glTF file that runs, by name or number (`glpath info`), or all; default the "
            "first, where --time or --frames asks for motion.",
            rich_help_panel=MODEL_PANEL,
        ),
    ] = None
    variant: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="A variant of a glTF file's materials, by name or number (`glpath info`).",
            rich_help_panel=MODEL_PANEL,
        ),
    ] = None
    time: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="A moment of what moves; default as a glTF file is at rest, or as a scene file's shutter opens.",
            rich_help_panel=MODEL_PANEL,
        ),
    ] = None


#: Options of commands that make pictures.
OF_PICTURES = tuple(field.name for field in fields(SceneOptions))
#: Options of commands that compute light without a picture.
OF_LIGHT = tuple(name for name in OF_PICTURES if name != "background")
#: Options of commands that read the shapes of a scene.
OF_SHAPES = ("animation", "variant", "time")


def with_scene_options(function: Callable[..., Any], names: Collection[str]) -> Callable[..., Any]:
    """Return a command that calls `function` and has the scene options `names` besides its own.

    Given values are appended as KEY=VALUE to the function's parameter `parameters`, the list of -D.
    """
    signature = inspect.signature(function, eval_str=True)
    before = list(signature.parameters.values())
    at = next(i for i, p in enumerate(before) if p.name == "parameters")
    more = [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=annotation)
        for name, (annotation, default) in _declarations().items()
        if name in names
    ]

    @functools.wraps(function)
    def command(**values: Any) -> Any:
        given = {p.name: values.pop(p.name) for p in more}
        values["parameters"] = _joined(values.get("parameters") or [], given)
        return function(**values)

    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*before[:at], *more, *before[at:]]
    )
    return command


def flag(name: str) -> str:
    """Return the option as typed, such as --environment-rotation for environment_rotation."""
    return "--" + name.replace("_", "-")


def _joined(parameters: list[str], given: dict[str, Any]) -> list[str]:
    """Return the texts of -D and of the given options. Raises UsageError if both set the same parameter."""
    typed = {text.partition("=")[0].strip(): text for text in parameters}
    for name, value in given.items():
        if value is not None and name in typed:
            raise UsageError(f"{flag(name)} beside -D {typed[name]}: they are the same.", "Give one of them.")
    return [*parameters, *(f"{name}={value}" for name, value in given.items() if value is not None)]


@cache
def _declarations() -> dict[str, tuple[Any, Any]]:
    hints = get_type_hints(SceneOptions, include_extras=True)
    return {field.name: (hints[field.name], field.default) for field in fields(SceneOptions)}
