"""How far an image may be from the converged one, told from the spread of its batches, with a stated confidence.

The mean squared error of an image is sigma² on average; between B batches we see an estimate s² of it. What the
error of this one image is beside what this estimate says depends on how many independent errors the image is made
of: where pixels err independently there are thousands of them, and both are sigma² but for a percent. Where path
sets share their directions all pixels err together, as a single number would. With k independent errors of equal
size, the squared error over s² has the distribution F(k, (B - 1) k), whose quantile is the bound.

k follows from the batches, too: they differ by vectors of covariance S, and k = tr(S)² / tr(S²). Both traces come
from the B x B products between batches (Srivastava 2005); the pixels' own matrix is never made.

Cost:     reads the batches' sums once or twice: 0.1 s for 512 x 512.
Poor at:  few batches, as k is then a guess; rare, bright events that no path set has met: what was never seen has
          no spread. Sobol samples converge faster than batches tell, so the bound is wide for them rather than
          narrow.

M. Srivastava, "Some tests concerning the covariance matrix in high dimensional data", 2005.
F. Satterthwaite, "An approximate distribution of estimates of variance components", 1946.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Squared radiance that relative errors of dark pixels are held against, as in `compare.relative_mse`.
_FLOOR = 0.01


def error_bound(sums: NDArray[np.float64], counts: NDArray[np.int64], confidence: float) -> float:
    """The bound of sqrt(mean of e² / (mean² + 0.01)) of an image.

    sums   : (B, H, W, 3) float64, radiance summed over the path sets of each batch, W sr^-1 m^-2; B at least 2
    counts : (B,) path sets of each
    """
    from scipy.special import fdtri  # slow to import

    batches, total = len(counts), int(counts.sum())
    mean = sums.sum(axis=0) / total
    weight = np.sqrt(mean * mean + _FLOOR)
    # (B, P): of each the same variance, that of a single path set.
    spread = np.stack(
        [np.sqrt(n) * ((one / n - mean) / weight).ravel() for one, n in zip(sums, counts, strict=True)]
    )
    gram = spread @ spread.T
    freedom = batches - 1
    trace = float(np.trace(gram)) / freedom
    if trace <= 0:
        return 0.0
    squares = float((gram * gram).sum()) / freedom**2
    # Of one difference alone k cannot be seen; that all pixels err together is the safe guess.
    unbiased = (squares - trace**2 / freedom) * freedom**2 / max((freedom - 1) * (freedom + 2), 1)
    independent = spread.shape[1]
    k = float(np.clip(trace**2 / unbiased, 1, independent)) if freedom > 1 and unbiased > 0 else float(independent)
    k = 1.0 if freedom == 1 else k
    estimate = trace / total / independent
    return float(np.sqrt(estimate * fdtri(k, freedom * k, confidence)))
