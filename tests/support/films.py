"""Compares films bit by bit."""

from __future__ import annotations

import numpy as np

from glpath.film.film import Film


def same(ours: Film, theirs: Film) -> bool:
    sums = np.array_equal(ours.radiance_sums, theirs.radiance_sums)
    aovs = all(np.array_equal(ours.aov_sums[name], theirs.aov_sums[name]) for name in theirs.aov_sums)
    return sums and aovs and ours.ranges == theirs.ranges and (ours.batch_counts == theirs.batch_counts).all()
