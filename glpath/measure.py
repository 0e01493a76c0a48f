"""What a bench or a figure says, one shape for the screen and for scripts, and how both of them time.

Times on a shared machine drift by more than what is to be told apart. So the contestants take turns within one run,
and the median of their times counts.
"""

from __future__ import annotations

import json
import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class Condition:
    """One line of the rule by which a claim holds: a measured number against a bound.

    left  : name of a measured number
    right : a number, or the name of another measured number
    """

    left: str
    relation: Literal[">=", "<=", ">", "<"]
    right: float | str

    def holds(self, measured: Mapping[str, float]) -> bool:
        """False as well where a number is NaN."""
        a = measured[self.left]
        b = measured[self.right] if isinstance(self.right, str) else self.right
        return {">=": a >= b, "<=": a <= b, ">": a > b, "<": a < b}[self.relation]

    def __str__(self) -> str:
        right = self.right if isinstance(self.right, str) else f"{self.right:g}"
        return f"{self.left} {self.relation} {right}"


@dataclass(frozen=True)
class Report:
    """The outcome of one measurement.

    name     : of the bench or the figure
    claim    : what is measured against, in words, with the rule by which it holds
    measured : numbers, by name
    holds    : whether the claim does, by the rule in `claim`; None where the peer was not there to compare with
    rows     : one object per line of the table or point of the plot
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

    def as_json(self) -> str:
        """Strict JSON: what is no number (NaN, infinity) is null."""
        return json.dumps(_plain(self.as_dict()), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Of values that JSON has: numpy's scalars as Python's, NaN and infinity as None."""
    if isinstance(value, dict):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def judge(claim: str, rule: tuple[Condition, ...], measured: Mapping[str, float]) -> tuple[str, bool]:
    """The claim with its rule in brackets, and whether all of the rule is true of what was measured."""
    return f"{claim} ({', '.join(map(str, rule))})", all(condition.holds(measured) for condition in rule)


def machine(renderer: str) -> dict[str, Any]:
    """The device that rendered, and the CPU beside it."""
    return {"renderer": renderer, "cpu": _cpu_name(), "cores": cores()}


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")


def seconds_of(work: Callable[[], object], finish: Callable[[], object] = lambda: None) -> float:
    """Wall time of one call. `finish` (a context's, which draws later than it is told to) runs on both sides."""
    finish()
    start = time.perf_counter()
    work()
    finish()
    return time.perf_counter() - start


def in_turns(
    contestants: Mapping[str, Callable[[], float]], rounds: int, *, least: int = 1, enough_s: float = math.inf
) -> dict[str, float]:
    """Median of what each contestant returns, seconds of one run, when they take turns, `rounds` times.

    least, enough_s : from `least` rounds on, no further one starts when all so far took so long
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    started = time.perf_counter()
    for done in range(rounds):
        if done >= least and time.perf_counter() - started >= enough_s:
            break
        for name, contestant in contestants.items():
            times[name].append(contestant())
    return {name: statistics.median(each) for name, each in times.items()}
