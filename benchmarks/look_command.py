"""`python -m benchmarks look`: the models of a folder without an option, and as a viewer on the web shows them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.signals import result_of
from glpath.errors import UsageError
from glpath.system.terminal import say


def look(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER", help="Of models: .glb, .gltf, .obj, .ply, .stl, .off.", show_default=False
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Where index.html and the pictures go.")
    ] = Path("out/look"),
    side: Annotated[int, typer.Option("--side", metavar="N", help="Pixels of the pictures' sides.")] = 512,
) -> None:
    """Render each model of a folder by `glpath render MODEL -o PNG`, and have <model-viewer> show it.

    Writes a page with each pair, its seconds and what glpath printed, and sheet.jpg with all pairs. Needs Chromium
    and npm's @google/model-viewer, which NODE_PATH=FOLDER/node_modules finds.
    """
    from benchmarks.look_page import models_in, write_page

    if folder is None or not folder.is_dir():
        raise UsageError(f"look: {'no folder' if folder is None else str(folder) + ' is no folder'}")
    if not 16 <= side <= 4096:
        raise UsageError(f"--side {side}: must be from 16 to 4096")
    models = models_in(folder)
    if not models:
        raise UsageError(f"look: {folder} has no model")
    page = result_of(lambda: write_page(models, output, side, lambda text: say(text, err=True)))
    say(f"wrote {page}, {len(models)} models", err=True)


def register(app: typer.Typer) -> None:
    """Put the command on the main program."""
    app.command("look")(look)
