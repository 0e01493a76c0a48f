"""Figures for tests of the command line."""

from __future__ import annotations

import numpy as np

from benchmarks.figures.outcome import Outcome
from benchmarks.verdict import Report


def outcome(holds: bool | None = True, **report: object) -> Outcome:
    fields: dict[str, object] = {
        "name": "t-buffer-0",
        "claim": "it is fast (gain > 1)",
        "measured": {"gain": 2.0},
        "holds": holds,
        "rows": [{"objects": 1, "s": 0.5}, {"objects": 2, "s": 0.25}],
        "machine": {"renderer": "none", "cpu": "none", "cores": 1},
        "versions": {"glpath": "0"},
    } | report
    return Outcome(Report(**fields), np.full((4, 6, 3), 200, np.uint8))  # type: ignore[arg-type]
