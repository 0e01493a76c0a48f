"""Sample points of path sets, from counters."""

from __future__ import annotations

from typing import Literal

#: Points of a Sobol sequence, or independent random ones, see `points`.
Sampling = Literal["sobol", "random"]

#: A Sobol sequence of 30 bits ends at 2**30.
MAX_SPP, MAX_FIRST_PATH_SET = 2**29 - 256, 2**29
