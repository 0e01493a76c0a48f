"""Mean, minimum, maximum and uniformities of values measured at points, each with its standard error.

The minimum of noisy values is too low, because it favours points with negative errors. With a thousand points and
an error of 10 %, it is too low by a third of their mean. Instead, one half of the batches of path sets can choose
the point, and the other half gives its value. That value does not have this bias. It belongs to a point that is
nearly the darkest, so its expected value is the minimum or higher. The true minimum lies between the expected
values of both estimates. The final estimate lies three quarters of the distance towards the second. In simulations
of uniform, sloped, lamp-like and random fields, the bias is least there. Its error combines the point's error with
the uncertainty between the two estimates.

Batches of a Sobol sequence are negatively correlated: if one is too bright, the others are too dark. The
correlation is estimated from all points together (`_gain`). The half that gives the value is mixed with a part of
the choosing half, so that both become independent.

Cost:     a pass over the points for each of the 70 halves of eight batches; a second for four million points.
Poor at:  noise above the contrast, for which only bounds are known and the error is large; `Spread.asks_for` gives
          the number of path sets that helps. Rare bright light that most points have not sampled, which is missing
          from the errors, too.

Source: Hado van Hasselt, "Double Q-learning", 2010, for the choice by one half and the value from the other;
"Estimating the maximum expected value", 2013, for the signs of both biases.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from glpath.film.noise import standard_error

Float64 = NDArray[np.float64]

# Position of the estimate between the minimum of all noisy values (0) and the minimum estimated by halves (1).
_TOWARDS_HALVES = 0.75
# Minimum number of batches to estimate the correlation of a sequence's batches.
_MIN_BATCHES = 4
#: A minimum or maximum counts as decided if its bounds are at most this far apart, as a fraction of its value.
UNDECIDED = 0.1


@dataclass(frozen=True)
class Estimate:
    """Number with its standard error; NaN with too few batches: under two for a mean, under four for an extreme."""

    value: float
    error: float


@dataclass(frozen=True)
class Extreme(Estimate):
    """Estimate of a minimum or maximum.

    plain   : minimum or maximum of the noisy values
    bounds  : distance between the two estimates that enclose the true value
    """

    plain: float = np.nan
    bounds: float = np.nan


@dataclass(frozen=True)
class Spread:
    """Mean, minimum and maximum of values at points, in lux or any other unit; see the module.

    u0 : minimum divided by mean, the uniformity of EN 12464-1
    ud : minimum divided by maximum, the diversity of EN 12464-1
    """

    mean: Estimate
    minimum: Extreme
    maximum: Extreme

    @property
    def u0(self) -> Estimate:
        return _ratio(self.minimum, self.mean)

    @property
    def ud(self) -> Estimate:
        return _ratio(self.minimum, self.maximum)

    @property
    def undecided(self) -> float:
        """Larger distance between the bounds, of the minimum or the maximum, as a fraction of its value."""
        shares = [x.bounds / x.value if x.value > 0 else 0.0 for x in (self.minimum, self.maximum)]
        return max((share for share in shares if np.isfinite(share)), default=0.0)

    def asks_for(self, path_sets: int) -> int | None:
        """Return the number of path sets, a power of two, to decide both extremes; None if `path_sets` suffice."""
        if not self.undecided > UNDECIDED:
            return None
        return int(2 ** np.ceil(np.log2(path_sets * (self.undecided / UNDECIDED) ** 2)))


def spread_of(sums: Float64, counts: NDArray[np.int64]) -> Spread:
    """Return the mean, minimum and maximum of N points.

    sums   : (8, N) float64 sums over the path sets of each of a film's batches, N from 1
    counts : (8,) path sets of each batch; 0 for an empty batch

    The error of the mean is the spread of the batches' means, which includes correlations between points.
    """
    means = sums.mean(axis=1)
    mean = Estimate(float(means.sum() / counts.sum()), float(standard_error(means, counts)))
    lowest, highest = _minimum(sums, counts), _minimum(-sums, counts)
    return Spread(mean, lowest, Extreme(0.0 - highest.value, highest.error, 0.0 - highest.plain, highest.bounds))


def _minimum(sums: Float64, counts: NDArray[np.int64]) -> Extreme:
    there = counts > 0
    gain = _gain(sums, counts)
    sums, counts = sums[there], counts[there]
    batches, total = len(counts), sums.sum(axis=0)
    means = total / counts.sum()
    plain = float(means.min())
    if batches < _MIN_BATCHES:
        return Extreme(plain, np.nan, plain)
    # The correlation of errors is -k between two batches, and -c between the two halves of the batches.
    k = (1 - gain) / (batches - 1 + gain)
    c = 0.5 * batches * k / (1 - (0.5 * batches - 1) * k)
    values, weights = [], []
    for half in _halves(batches):
        by = sums[half].sum(axis=0)
        point, chose = int(by.argmin()), int(counts[half].sum())
        rest = int(counts.sum()) - chose
        values.append((float(total[point] - by[point]) / rest + c * float(by[point]) / chose) / (1 + c))
        weights.append(rest)
    other = min(float(np.average(values, weights=weights)), float(means.mean()))
    bounds = max(other - plain, 0.0)
    value = plain + _TOWARDS_HALVES * bounds
    # With skewed noise, a point whose value is too low also has too small a spread. Therefore use the errors of all
    # points that may be the lowest.
    own = standard_error(sums, counts)
    own = own[means - 2 * own <= (means + 2 * own).min()]
    # The variance of a uniform distribution between two bounds is a twelfth of their squared distance.
    return Extreme(value, float(np.sqrt(np.median(own**2) + bounds**2 / 12)), plain, bounds)


def _gain(sums: Float64, counts: NDArray[np.int64]) -> float:
    """Return the variance of the mean over all batches, relative to that of independent batches.

    The index of a batch is three bits of the indices of its path sets. If the variance of n path sets falls as
    n^-(1 + a), batches that differ in the lowest bit differ most. With each further bit, the variance falls by
    2^-a, down to the variance of the mean over all batches.
    """
    variances: list[float] = []
    weights: list[int] = []
    groups: list[tuple[Float64, int] | None] = [
        (batch, int(n)) if n > 0 else None for batch, n in zip(sums, counts, strict=True)
    ]
    while len(groups) > 1:
        found: list[Float64] = []
        joined: list[tuple[Float64, int] | None] = []
        for one, other in zip(groups[::2], groups[1::2], strict=True):
            if one is not None and other is not None:
                difference = one[0] / one[1] - other[0] / other[1]
                found.append(difference**2 / (1 / one[1] + 1 / other[1]))
                joined.append((one[0] + other[0], one[1] + other[1]))
            else:
                joined.append(one if other is None else other)
        if not found:
            break
        variances.append(float(np.mean(found)))
        weights.append(len(found))
        groups = joined
    if len(variances) < 2 or not variances[0] > 0:
        return 1.0
    levels = np.arange(1, len(variances))
    ratios = (np.array(variances[1:]) / variances[0]) ** (1 / levels)
    ratio = float(np.clip(np.average(ratios, weights=weights[1:]), 0.0, 1.0))
    alone = float(np.average(variances, weights=weights))
    return float(min(1.0, variances[0] / (2 - ratio) * ratio ** len(variances) / alone))


def _halves(batches: int) -> Iterator[list[int]]:
    """Yield the batch indices of every half of the batches, in both sizes if the count of batches is odd."""
    for size in sorted({batches // 2, batches - batches // 2}):
        yield from (list(each) for each in combinations(range(batches), size))


def _ratio(one: Estimate, other: Estimate) -> Estimate:
    if not other.value > 0:
        return Estimate(np.nan, np.nan)
    value = one.value / other.value
    return Estimate(value, float(np.hypot(one.error, value * other.error) / other.value))
