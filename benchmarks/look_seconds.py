"""The seconds of pictures without options, and a limit for each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.look_page import Rendered
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.gl.context import get_context
from glpath.system.versions import versions

#: Limit of the seconds of the whole process, at 512 x 512 on two idle cores.
ENOUGH_SECONDS = 8.0
RULE = (Condition("not_rendered", "<=", 0), Condition("seconds_max", "<=", ENOUGH_SECONDS))


def seconds_report(models: Sequence[Path], rendered: Sequence[Rendered], side: int) -> Report:
    """Return the report of models and their pictures, given in the same order. It has no path of this machine.

    measured : models, not_rendered, seconds_max, processor_seconds_max
    """
    rows = [
        {"model": path.stem, "seconds": each.seconds, "processor_seconds": each.processor_seconds}
        for path, each in zip(models, rendered, strict=True)
    ]
    measured = {
        "models": float(len(rows)),
        "not_rendered": float(sum(not each.png for each in rendered)),
        "seconds_max": max(each.seconds for each in rendered),
        "processor_seconds_max": max(each.processor_seconds for each in rendered),
    }
    claim, holds = judge(f"a picture of {side} x {side} without an option, the whole process", RULE, measured)
    return Report(
        "look",
        claim,
        measured,
        holds if side == 512 else None,
        rows=rows,
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "pyoidn"),
    )
