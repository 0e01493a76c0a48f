"""`python -m benchmarks khronos`: compares sample models of glTF with Cycles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glpath.cli.signals import result_of
from glpath.errors import UsageError
from glpath.system.files import check_writable, write_bytes
from glpath.system.terminal import say

if TYPE_CHECKING:
    from benchmarks.khronos.models import SampleModel
    from benchmarks.verdict import Report

FOLDER = Path("out/khronos")


def khronos(
    models: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER", help="Of glTF-Sample-Assets, or Models/NAME/glTF/NAME.gltf alike.", show_default=False
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Where index.html, khronos.json and pictures go.")
    ] = FOLDER,
    only: Annotated[
        list[str] | None, typer.Option("--model", metavar="NAME", help="This model alone; may be repeated.")
    ] = None,
    side: Annotated[int, typer.Option(metavar="N", help="Pixels of a picture's side, 16 to 4096.")] = 512,
) -> None:
    """Render Khronos' sample models with glpath's defaults, and with Cycles under the same sky.

    Nothing is fetched: name a folder that has them. Cycles needs the package bpy, of this Python or of the one that
    GLPATH_PEERS_PYTHON names. A mark that is missed is reported as such and is no failure.
    """
    from benchmarks.khronos.models import find_models

    if models is None:
        raise UsageError("khronos: no folder of models.", "Name one that has Models/NAME/glTF/NAME.gltf.")
    if not 16 <= side <= 4096:
        raise UsageError(f"--side {side}: must be from 16 to 4096")
    found = find_models(models, only or [])
    check_writable(output / "index.html")
    report = result_of(lambda: _measured(found, side, output))
    write_bytes(report.as_json().encode(), output / "khronos.json")
    say(f"wrote {output / 'index.html'} and khronos.json", err=True)
    for key, value in report.measured.items():
        say(f"{key:<28} {value:.4g}")
    say(report.verdict)
    for note in report.notes:
        say(note)


def _measured(found: list[SampleModel], side: int, output: Path) -> Report:
    from benchmarks.khronos.beside_cycles import compare_models
    from benchmarks.khronos.page import write_page
    from benchmarks.khronos.verdict import report_of

    compared, notes = compare_models(found, side, lambda text: say(text, err=True))
    report = report_of(compared, side, notes)
    write_page(compared, output, report.claim)
    return report


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("khronos")(khronos)
