"""`python -m benchmarks scene`: makes a shipped model, or one that only benches render."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.signals import result_of
from glpath.errors import UsageError
from glpath.system.files import check_writable
from glpath.system.terminal import say

FOLDER = Path("out/scenes")
NAMES = ("helmet", "parlour", "room")


def scene(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="helmet, parlour or room.", show_default=False)
    ] = None,
    detail: Annotated[
        float | None,
        typer.Option(
            metavar="D",
            help="How finely the room is divided, 0.25 to 16; 1 as it ships, 34,696 triangles at 4.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE.glb", help=f"Default: {FOLDER}/NAME.glb.", show_default=False),
    ] = None,
) -> None:
    """Make a model that ships, `scenes/NAME.glb`, the room of another fineness, or the helmet of the benches.

    `scenes/NAME.toml` has camera, resolution and unit; a copy of it beside the new file shows that instead.
    """
    from benchmarks.scenes.helmet import helmet
    from benchmarks.scenes.parlour import parlour
    from benchmarks.scenes.room import room
    from glpath import export

    if name not in NAMES:
        raise UsageError(f"scene: {'no name' if name is None else repr(name)}; allowed are {', '.join(NAMES)}")
    if detail is not None and name != "room":
        raise UsageError(f"--detail does not apply to {name}", "Leave it out, or make the room.")
    if detail is not None and not 0.25 <= detail <= 16:
        raise UsageError(f"--detail {detail:g}: must be from 0.25 to 16", "The default is 1.")
    path = output or FOLDER / f"{name}.glb"
    if path.suffix.lower() != ".glb":
        raise UsageError(f"-o {path}: a model is written as .glb")
    check_writable(path)
    makers = {"helmet": helmet, "parlour": parlour, "room": lambda: room(1.0 if detail is None else detail)}
    made = result_of(makers[name])
    export(made, path)
    say(f"wrote {path}, {len(made.triangles):,} triangles", err=True)


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("scene")(scene)
