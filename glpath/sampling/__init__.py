"""Sample points of path sets, computed from counters."""

from __future__ import annotations

from typing import Literal

#: Kind of sample points: a Sobol sequence, or independent random points, see `points`.
Sampling = Literal["sobol", "random"]

#: Maximum number of path sets of a render. With `MAX_FIRST_PATH_SET`, their indices stay below 2**30, the end of a
#: Sobol sequence of 30 bits.
MAX_SPP = 2**29 - 256
#: Maximum index of the first path set.
MAX_FIRST_PATH_SET = 2**29
