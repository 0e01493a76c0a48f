"""`python -m benchmarks look`: renders the models of a folder without options, and shows them in a web viewer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glpath.cli.signals import result_of
from glpath.errors import UsageError
from glpath.system.files import check_writable, write_bytes
from glpath.system.terminal import say

if TYPE_CHECKING:
    from benchmarks.verdict import Report


def look(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="Of models (.glb, .gltf, .obj, .ply, .stl, .off), or of Models/NAME/glTF/NAME.gltf.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Where index.html and the pictures go.")
    ] = Path("out/look"),
    side: Annotated[int, typer.Option("--side", metavar="N", help="Pixels of the pictures' sides.")] = 512,
    viewer: Annotated[bool, typer.Option(help="Whether <model-viewer> shows them, too.")] = True,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the seconds as JSON; - for stdout.")
    ] = None,
) -> None:
    """Render each model of a folder by `glpath render MODEL -o PNG`, and have <model-viewer> show it.

    Writes a page with each pair, its seconds and what glpath printed, and sheet.jpg with all pairs. Needs Chromium
    and npm's @google/model-viewer, which NODE_PATH=FOLDER/node_modules finds. --no-viewer times glpath alone.
    A picture of 512 x 512 has 8 s of two cores. One that takes longer is reported as such and is no failure.
    """
    from benchmarks.look_page import models_in

    if folder is None or not folder.is_dir():
        raise UsageError(f"look: {'no folder' if folder is None else str(folder) + ' is no folder'}")
    if not 16 <= side <= 4096:
        raise UsageError(f"--side {side}: must be from 16 to 4096")
    models = models_in(folder)
    if not models:
        raise UsageError(f"look: {folder} has no model")
    if json_file is not None:
        check_writable(json_file)
    report = result_of(lambda: _rendered(models, output, side, viewer))
    say(f"wrote {output}, {len(models)} models", err=True)
    say(report.verdict, err=True)
    if json_file is not None:
        write_bytes(report.as_json().encode(), json_file)


def _rendered(models: list[Path], output: Path, side: int, viewer: bool) -> Report:
    from benchmarks.look_page import render_models, write_page
    from benchmarks.look_seconds import seconds_report

    if viewer:
        from benchmarks.peers.model_viewer import browser, package

        browser(), package()  # fail before minutes are spent
    ours = render_models(models, output, side, lambda text: say(text, err=True))
    if viewer:
        write_page(models, ours, output, side)
    return seconds_report(models, ours, side)


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("look")(look)
