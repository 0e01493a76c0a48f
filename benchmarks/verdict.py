"""The result of a bench or a figure, as an object for screen and scripts, and the rule that judges its claim."""

from __future__ import annotations

import datetime
import json
import math
import platform
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from glpath.system.machine import core_count

# A list of numbers, or of words without brackets.
_SHORT_LIST = re.compile(r'\[\s+(?:(?:-?[\d.eE+-]+|null|"[\w\' ]*"),?\s+)+\]')


@dataclass(frozen=True)
class Condition:
    """One line of a claim's rule: a measured number and its bound.

    left  : name of a measured number
    right : a number, or the name of another measured number
    """

    left: str
    relation: Literal[">=", "<=", ">", "<"]
    right: float | str

    def holds(self, measured: Mapping[str, float]) -> bool:
        """Return whether the line is true; False if a number is NaN."""
        a = measured[self.left]
        b = measured[self.right] if isinstance(self.right, str) else self.right
        return {">=": a >= b, "<=": a <= b, ">": a > b, "<": a < b}[self.relation]

    def __str__(self) -> str:
        right = self.right if isinstance(self.right, str) else f"{self.right:g}"
        return f"{self.left} {self.relation} {right}"


@dataclass(frozen=True)
class Report:
    """The result of a measurement.

    name     : name of the bench or the figure
    claim    : claim in words, with the rule that judges it
    measured : numbers, by name
    holds    : whether the claim is true by its rule; None if the peer for the comparison was missing; always False
               if there are faults
    rows     : one dict per line of the table or point of the plot
    faults   : evidence that the programs did not do the same work, so that their times are not comparable
    date     : date of the measurement, YYYY-MM-DD
    """

    name: str
    claim: str
    measured: dict[str, float]
    holds: bool | None
    rows: list[dict[str, Any]]
    machine: dict[str, Any]
    versions: dict[str, str]
    notes: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    date: str = field(default_factory=lambda: datetime.date.today().isoformat())

    @property
    def verdict(self) -> str:
        """Return the claim and its verdict."""
        return f"{self.claim}: { ({True: 'holds', False: 'DOES NOT HOLD', None: 'not measured'}[self.holds]) }"

    def __post_init__(self) -> None:
        if self.faults:
            object.__setattr__(self, "holds", False)

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)

    def as_json(self) -> str:
        """Return strict JSON: NaN and infinity become null. A list of numbers or words is on one line."""
        text = json.dumps(_plain(self.as_dict()), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        return _SHORT_LIST.sub(lambda found: " ".join(found[0].split()).replace("[ ", "[").replace(" ]", "]"), text)


def _plain(value: Any) -> Any:
    """Convert to values of JSON: numpy scalars become Python's, NaN and infinity become None."""
    if isinstance(value, dict):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def judge(claim: str, rule: tuple[Condition, ...], measured: Mapping[str, float]) -> tuple[str, bool]:
    """Return the claim with its rule in brackets, and whether all lines of the rule are true."""
    return f"{claim} ({', '.join(map(str, rule))})", all(condition.holds(measured) for condition in rule)


def faults(agreement: tuple[Condition, ...], measured: Mapping[str, float]) -> list[str]:
    """Return a line for each measured condition of the programs' agreement that is false."""
    return [
        f"{condition} is not so: {measured[condition.left]:.6g}"
        for condition in agreement
        if condition.left in measured and not condition.holds(measured)
    ]


def machine(renderer: str) -> dict[str, Any]:
    """Return the device that rendered, and the CPU."""
    return {"renderer": renderer, "cpu": _cpu_name(), "cores": core_count()}


def _cpu_name() -> str:
    """Return the model of the processor and its widest vectors: other renderers use these, llvmpipe 256 bits."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    said = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    flags = said.get("flags", "").split()
    vectors = next((name for flag, name in (("avx512f", "AVX-512"), ("avx2", "AVX2")) if flag in flags), "")
    return ", ".join(filter(None, (said.get("model name", ""), vectors)))
