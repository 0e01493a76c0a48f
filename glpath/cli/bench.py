"""`glpath bench`: a measurement, beside other programs where they are installed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from glpath.errors import UsageError

BENCHES = {"path-buffer": "path tracing: milliseconds by stage, and Mitsuba 3 at equal error"}


def bench(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help=", ".join(BENCHES))] = None,
    list_all: Annotated[bool, typer.Option("--list", help="Name all benches.")] = False,
    seeds: Annotated[int, typer.Option(metavar="N", help="Independent renders to take errors over.")] = 3,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A converged picture to take errors against.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON; - for stdout.")
    ] = None,
) -> None:
    """Measure how fast an engine is.

    Times on shared machines drift; the ratios to other programs, taken in the same run, are what to go by. Install
    the reference extra (pip install 'glpath[reference]') for these.
    """
    from rich.console import Console

    if list_all:
        for key, what in BENCHES.items():
            typer.echo(f"{key:<14} {what}")
        return
    if name not in BENCHES:
        raise UsageError(
            f"bench: {'no name' if name is None else repr(name)}; allowed are {', '.join(BENCHES)}",
            "`glpath bench --list` says what they measure.",
        )
    if seeds < 1:
        raise UsageError(f"--seeds {seeds}: must be at least 1")
    from glpath.bench.path_buffer import bench_path_buffer

    report = bench_path_buffer(seeds, reference, say=lambda text: typer.echo(text, err=True))
    text = json.dumps(report.as_dict(), indent=2)
    if output is not None and str(output) == "-":
        typer.echo(text)
        return
    if output is not None:
        from glpath.image import whole_file

        with whole_file(output) as part:
            part.write_text(text + "\n")
    console = Console(soft_wrap=True, highlight=False)
    _print(console, report.measured, report.rows)
    if report.holds is not None:
        console.print(f"{report.claim}: {'holds' if report.holds else 'DOES NOT HOLD'}", markup=False)
    for note in report.notes:
        console.print(note, markup=False)
    console.print(", ".join(f"{k} {v}" for k, v in {**report.machine, **report.versions}.items()), markup=False)


def _print(console: object, measured: dict[str, float], rows: list[dict[str, object]]) -> None:
    from rich.console import Console
    from rich.table import Table

    assert isinstance(console, Console)
    table = Table("measured", "", box=None)
    for key, value in measured.items():
        table.add_row(key, f"{value:.4g}")
    console.print(table)
    if rows:
        columns = list(rows[0])
        table = Table(*columns, box=None)
        for row in rows:
            table.add_row(*(f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()))
        console.print(table)


def register(app: typer.Typer) -> None:
    """Put the command on the main program."""
    app.command("bench")(bench)
