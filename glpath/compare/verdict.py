"""The result of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Verdict:
    """The outcome of comparing a picture with its reference.

    mode     : "exact", "fuzzy", "stat" or "flip"
    passed   : whether the two count as the same
    severity : how bad it is, 1 at the limit: what is above fails. It orders a report, worst first
    summary  : one sentence for people, with numbers
    measured : the numbers, plain JSON values
    limits   : what they were held against, plain JSON values
    """

    mode: str
    passed: bool
    severity: float
    summary: str
    measured: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, Any] = field(default_factory=dict)
