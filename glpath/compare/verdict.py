"""Result of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Verdict:
    """Result of comparing an image with its reference.

    mode     : "exact", "fuzzy", "stat" or "flip"
    passed   : True if the two images count as the same
    severity : size of the difference relative to the limit; above 1 the comparison fails. Reports list the most
               severe comparison first
    summary  : one sentence with numbers, for display
    measured : measured numbers, plain JSON values
    limits   : limits that they were compared with, plain JSON values
    """

    mode: str
    passed: bool
    severity: float
    summary: str
    measured: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, Any] = field(default_factory=dict)
