"""The seconds of pictures without an option, and whether each is soon enough."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.look_page import Rendered
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.gl.context import get_context
from glpath.system.versions import versions

#: Of the whole process, at 512 x 512 on two quiet cores.
ENOUGH_SECONDS = 8.0
RULE = (Condition("not_rendered", "<=", 0), Condition("seconds_max", "<=", ENOUGH_SECONDS))


def seconds_report(models: Sequence[Path], rendered: Sequence[Rendered], side: int) -> Report:
    """Of models and their pictures, in the same order. No path of this machine is in it.

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
