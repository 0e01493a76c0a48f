"""Every figure by name: the function that makes it and a line on what it shows."""

from __future__ import annotations

from collections.abc import Callable

from glpath.figures import path_buffer, shaft, t_buffer
from glpath.figures.outcome import Outcome, Say

Make = Callable[[float, Say], Outcome]

FIGURES: dict[str, tuple[Make, str]] = {}
FIGURES |= t_buffer.FIGURES
FIGURES |= shaft.FIGURES
FIGURES |= path_buffer.FIGURES
