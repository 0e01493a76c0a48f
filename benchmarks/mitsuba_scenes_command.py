"""`python -m benchmarks mitsuba-scenes`: loads Mitsuba's files, and compares the pictures of both programs."""

from __future__ import annotations

import fnmatch
import json
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from glpath.cli.signals import result_of
from glpath.errors import UsageError
from glpath.system.files import write_bytes
from glpath.system.terminal import say

RESULT = Path("benchmarks/results/mitsuba-scenes.json")


def mitsuba_scenes(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Of the repositories with Mitsuba's files.")],
    resume: Annotated[
        Path,
        typer.Option(metavar="FILE", help="Where the result goes, after each file. What it has is not done again."),
    ] = RESULT,
    again: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Files to examine again, such as '*plastic*'; '*' for all."),
    ] = None,
) -> None:
    """Load each .xml below FOLDER, and render those that load by `path` and by Mitsuba. Needs the reference extra.

    FOLDER holds checkouts from GitHub: mitsuba-renderer/mitsuba-data and mitsuba-tutorials, NVlabs/sionna-rt.
    """
    from benchmarks.benches.mitsuba_scenes import examine_all, report

    if not folder.is_dir():
        raise UsageError(f"mitsuba-scenes: {folder} is no folder")
    kept = {
        name: row
        for name, row in _rows(resume).items()
        if not any(fnmatch.fnmatchcase(name, pattern) for pattern in again or ())
    }

    def store(rows: list[dict[str, Any]]) -> None:
        write_bytes(report(rows).as_json().encode(), resume)

    found = result_of(lambda: examine_all(folder, kept, store, partial(say, err=True)))
    write_bytes(found.as_json().encode(), resume)
    say(", ".join(f"{name} {value:g}" for name, value in found.measured.items()))
    say(found.verdict)


def _rows(result: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a stored result by file; empty if there is none."""
    if not result.is_file():
        return {}
    return {row["file"]: row for row in json.loads(result.read_text("utf-8"))["rows"]}


def register(app: typer.Typer) -> None:
    """Add the command to the main program."""
    app.command("mitsuba-scenes")(mitsuba_scenes)
