"""The report of a comparison, and the rule that confirms or rejects its claim."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from benchmarks.khronos.beside_cycles import ENOUGH_SECONDS, Beside
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.gl.context import get_context
from glpath.system.versions import versions

RULE = (Condition("not_rendered", "<=", 0), Condition("missed_marks", "<=", 0))


def report_of(compared: Sequence[Beside], side: int, notes: list[str]) -> Report:
    """Return the report of the results of `compare_models`, for pictures of this side."""
    rows = [each.row for each in compared]
    drawn = [row for row in rows if row["status"] == "rendered"]
    beside = [row for row in drawn if "difference" in row]
    marked = [row for row in beside if row["holds"] is not None]
    measured = {
        "models": float(len(rows)),
        "not_rendered": float(len(rows) - len(drawn)),
        "beside_cycles": float(len(beside)),
        "with_a_mark": float(len(marked)),
        "missed_marks": float(sum(not row["holds"] for row in marked)),
        "slower_than_the_aim": float(sum(row["processor_seconds"] > ENOUGH_SECONDS for row in drawn)),
    }
    if beside:
        measured["mean_difference"] = sum(row["difference"] for row in beside) / len(beside)
    if drawn:
        measured["processor_seconds_max"] = max(row["processor_seconds"] for row in drawn)
    claim = f"each model is rendered, at {side} x {side}, and as near to Cycles as its materials allow"
    claim, holds = judge(claim, RULE, measured)
    return Report(
        "khronos",
        claim,
        measured,
        holds if marked else None,
        rows=rows,
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "pyoidn") | {"python": sys.version.split()[0]},
        notes=notes,
    )
