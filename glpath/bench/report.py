"""What a bench says: one shape for the table on the screen and the JSON that a script reads."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Report:
    """The outcome of one measurement.

    name     : of the bench
    claim    : what is measured against, in words
    measured : numbers, by name
    holds    : whether the claim does, by the rule in `claim`; None where the peer was not there to compare with
    rows     : one object per line of the table
    """

    name: str
    claim: str
    measured: dict[str, float]
    holds: bool | None
    rows: list[dict[str, Any]]
    machine: dict[str, Any]
    versions: dict[str, str]
    notes: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def machine(renderer: str) -> dict[str, Any]:
    """The device that rendered, and the CPU beside it."""
    return {"renderer": renderer, "cpu": _cpu_name(), "cores": len(os.sched_getaffinity(0))}


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
