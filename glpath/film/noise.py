"""Upper bound of an image's error against the converged image, at a given confidence, from its batches' spread.

The mean squared error of an image is sigma² on average; the spread between B batches gives an estimate s² of it.
The ratio of this image's error to s² depends on its number of independent errors. If pixels err independently,
there are hundreds, and both values are nearly sigma². If path sets share their directions, all pixels err together,
as a single number would. With k independent errors of equal size, the squared error over s² has the distribution
F(k, (B - 1) k), whose quantile is the bound.

k is also estimated from the batches. They differ by vectors of covariance S, and k = tr(S)² / tr(S²). Both traces
come from the B x B products between batches (Srivastava 2005); the covariance matrix of pixels is never computed.
Half of k is used, for two reasons. It is estimated from few batches, and errors of unequal size have a longer tail
than F. Measurements over seeds confirm the bound for any sampling (tests/rendering/test_stopping.py).

A pixel's error is relative to the mean of the other batches. Relative to its own mean, a bright sample would seem
small in the very pixel that it spoils.

Cost:     reads the batches' sums a few times: 0.1 s for 512 x 512.
Poor at:  rare, bright events that no path set has hit, because unobserved events have no spread. Sobol samples
          converge faster than batches show, so for them the bound is too wide.

M. Srivastava, "Some tests concerning the covariance matrix in high dimensional data", 2005.
F. Satterthwaite, "An approximate distribution of estimates of variance components", 1946.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Minimum number of batches for an error estimate.
MIN_BATCHES = 4
#: Squared radiance that is added to the divisor of each squared relative error, so that dark pixels do not
#: dominate. `compare.relative_mse` uses the same value.
FLOOR = 0.01


def error_bound(sums: NDArray[np.float64], counts: NDArray[np.int64], confidence: float) -> float:
    """Return the upper bound, at `confidence`, of the relative error of an image.

    The relative error is the root mean square of e / sqrt(L² + FLOOR) over all pixels and channels. L is the mean
    radiance, and e is its difference from the converged image.

    sums   : (B, H, W, 3) float64, radiance summed over the path sets of each batch, W sr^-1 m^-2; B must be at
             least MIN_BATCHES
    counts : (B,) number of path sets of each batch
    """
    from scipy.special import fdtri  # late, because the import is slow

    batches, total = len(counts), int(counts.sum())
    all_sums = sums.sum(axis=0)
    mean = all_sums / total
    # (B, P) relative deviation of each batch from the mean, for the P values of the image. The factor sqrt(count)
    # gives every row the variance of a single path set.
    spread = np.empty((batches, mean.size))
    for row, one, count in zip(spread, sums, counts, strict=True):
        others = (all_sums - one) / (total - count)
        row[:] = (np.sqrt(count) * (one / count - mean) / np.sqrt(others * others + FLOOR)).ravel()
    gram = spread @ spread.T
    freedom = batches - 1
    trace = float(np.trace(gram)) / freedom
    if trace <= 0:
        return 0.0
    squares = float((gram * gram).sum()) / freedom**2
    unbiased = (squares - trace**2 / freedom) * freedom**2 / ((freedom - 1) * (freedom + 2))
    independent = trace**2 / unbiased if unbiased > 0 else float(mean.size)
    k = max(1.0, min(independent, mean.size) / 2)
    return float(np.sqrt(trace / total / mean.size * fdtri(k, freedom * k, confidence)))


def standard_error(sums: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the (...) standard errors of the means over all path sets, from the differences between batches.

    sums   : (B, ...) float64 sums over the path sets of each batch
    counts : (B,) number of path sets of each batch; 0 for an empty batch

    For eight batches, the standard error itself is accurate to a quarter. It is NaN for fewer than two batches.
    With Sobol points, the true error is usually smaller, because the mean converges faster than these differences.
    """
    there = counts > 0
    sums, counts = sums[there], counts[there]
    batches, total = len(counts), int(counts.sum())
    if batches < 2:
        return np.full(sums.shape[1:], np.nan)
    n = counts.reshape(-1, *[1] * (sums.ndim - 1))
    spread = (n * (sums / n - sums.sum(axis=0) / total) ** 2).sum(axis=0) / (batches - 1)
    return np.asarray(np.sqrt(spread / total))
