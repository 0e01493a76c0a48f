"""The outcome of a figure, and its files: NAME.png, NAME.json and NAME.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict import Condition, Report, judge, machine
from glpath.film.image import encode_png
from glpath.gl.context import open_context
from glpath.system.files import write_bytes
from glpath.system.outputs import save_all
from glpath.system.versions import versions

Say = Callable[[str], None]
Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """A reproduced figure.

    report  : its claim, numbers and rows
    picture : (H, W, 3) uint8 sRGB, row 0 at the top
    """

    report: Report
    picture: NDArray[np.uint8]


def judged(
    name: str,
    claim: str,
    rule: tuple[Condition, ...],
    measured: dict[str, float],
    rows: Rows,
    picture: NDArray[np.uint8],
    notes: Sequence[str] = (),
    *,
    with_gl: bool,
) -> Outcome:
    """Apply `rule` to `measured` and return the outcome. with_gl: the device took part, so record it."""
    said, holds = judge(claim, rule, measured)
    where, programs = "none; on the CPU", versions("glpath", "numpy", "numba", "matplotlib")
    if with_gl:
        info = open_context().info
        where = info.renderer
        programs = versions("glpath", "moderngl", "numpy", "matplotlib") | {"driver": info.driver}
    return Outcome(Report(name, said, measured, holds, rows, machine(where), programs, list(notes)), picture)


def write(outcome: Outcome, folder: Path) -> list[Path]:
    """Write NAME.png and NAME.json into `folder`, and NAME.csv if the report has rows. Returns their paths.

    Raises ImageError if any of them cannot be written, after trying all. If none can be written there, they go to a
    temporary folder that the error names. Each file is complete or absent.
    """
    report = outcome.report
    text = {"Title": report.name, "Description": report.claim, "Software": "glpath"}
    contents = {".png": encode_png(outcome.picture, text), ".json": report.as_json().encode()}
    if report.rows:
        contents[".csv"] = as_csv(report.rows).encode()
    saves = {f"{report.name}{suffix}": partial(write_bytes, content) for suffix, content in contents.items()}
    written, failure = save_all({folder / name: save for name, save in saves.items()}, saves, "Kept in {}.")
    if failure is not None:
        raise failure
    return written


def as_csv(rows: list[dict[str, Any]]) -> str:
    """Return a line of column names and a line for each row; a row may lack some of the columns."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
