"""The argument SCENE, of every command that takes a scene, with its parameters."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from glpath.errors import UsageError
from glpath.scene import Scene, load_scene, parameters_from_options
from glpath.scene.formats.load import scene_from_toml
from glpath.scene.place import Place

HELP = "A file, the name of a shipped scene, or - for TOML from stdin."

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help=HELP)]
Parameters = Annotated[
    list[str] | None,
    typer.Option("-D", metavar="KEY=VALUE", help="A parameter of a generated scene; may be repeated."),
]


def read_scene(scene: str, parameters: Sequence[str] | None) -> Scene:
    """The scene of the argument and the options `-D`. Raises SceneError and UsageError; warns as `load_scene`."""
    values = parameters_from_options(parameters or [])
    if scene != "-":
        return load_scene(scene, values)
    if values:
        raise UsageError("-D: belongs to a generated scene, not to one from standard input.", "Leave it out.")
    return scene_from_toml(sys.stdin.buffer.read(), Place("standard input"), Path(), "scene")
