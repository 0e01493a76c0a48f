"""`python -m benchmarks figure`: reproduces a figure or table of the papers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from glpath.cli.signals import result_of
from glpath.errors import UsageError
from glpath.system.terminal import say

FOLDER = Path("out/figures")


def figure(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="See --list.", show_default=False)] = None,
    list_all: Annotated[bool, typer.Option("--list", help="Name all figures.")] = False,
    scale: Annotated[
        float, typer.Option(metavar="S", help="Below 1: smaller pictures, buffers and scenes, for a quick look.")
    ] = 1.0,
    output: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Where NAME.png, .json and .csv go.")
    ] = FOLDER,
) -> None:
    """Make a figure of the papers again, with its data and whether the paper's claim holds here.

    Writes NAME.png, NAME.json and, where there is a table or a curve, NAME.csv. A claim that does not hold is
    reported as such and is no failure. Needs matplotlib (pip install -e '.[figures]').
    """
    from benchmarks.figures.catalogue import FIGURES

    if list_all:
        width = max(map(len, FIGURES))
        for key, (_, what) in FIGURES.items():
            say(f"{key:<{width}}  {what}")
        return
    if name not in FIGURES:
        raise UsageError(
            f"figure: {'no name' if name is None else repr(name)}; allowed are {', '.join(FIGURES)}",
            "`python -m benchmarks figure --list` says what they show.",
        )
    if not (math.isfinite(scale) and 0 < scale <= 1):
        raise UsageError(f"--scale {scale:g}: must be above 0 and at most 1")
    from benchmarks.figures.outcome import write
    from glpath.film.charts import require_matplotlib
    from glpath.system.files import check_writable

    require_matplotlib()
    check_writable(output / f"{name}.png")
    make, _ = FIGURES[name]
    outcome = result_of(lambda: make(scale, lambda text: say(text, err=True)))
    report = outcome.report
    for path in write(outcome, output):
        say(f"wrote {path}", err=True)
    for key, value in report.measured.items():
        say(f"{key:<28} {value:.4g}")
    say(report.verdict)
    for note in report.notes:
        say(note)


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("figure")(figure)
