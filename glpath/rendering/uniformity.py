"""Mean, minimum, maximum and uniformities of what was measured at points, each with its standard error.

The least of noisy values is too low: the chosen point is the one whose error happened to go down. Of a thousand
points with an error of 10 %, it is low by a third of their mean. A minimum that one half of the batches of path
sets chooses, and that is read off the other half, does not have this bias. It is the value of a point that is
nearly the darkest, and so too high, if at all. The expected values of the two have the minimum between them. The
estimate lies three quarters of the distance to the second. There, simulations have the least bias of fields that
are even, sloped, lamp-like or without any order. Its error has that of the point, and that the minimum may be
anywhere between.

Batches of a Sobol sequence are not independent: where one is too bright, the others are too dark. All points
together tell how much so (`_gain`). The half that is read then gets as much of the half that chose as makes the two
independent.

Cost:     all halves of eight batches, 70, each a pass over the points: a second for four million.
Poor at:  noise above the contrast: only bounds are known then, and the error is large; `Spread.asks_for` has a
          remedy. Rare bright light, which most points have not hit: it is not in the errors either.

Hado van Hasselt, "Double Q-learning", 2010, for choosing by one half and reading off the other; "Estimating the
maximum expected value", 2013, for the signs of both biases.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from glpath.film.noise import standard_error

Float64 = NDArray[np.float64]

# Of the distance from the minimum of all values to that of the halves.
_TOWARDS_HALVES = 0.75
# Below, the correlation of a sequence's batches is unknown.
_MIN_BATCHES = 4
#: Share of an extreme by which its two bounds may differ before noise counts as dominating it.
UNDECIDED = 0.1


@dataclass(frozen=True)
class Estimate:
    """A number and its standard error; NaN where too few batches tell it: two for a mean, four for an extreme."""

    value: float
    error: float


@dataclass(frozen=True)
class Extreme(Estimate):
    """A minimum or maximum.

    plain   : of the noisy values, as they are
    bounds  : how far apart the two estimates are that have the true one between them
    """

    plain: float = np.nan
    bounds: float = np.nan


@dataclass(frozen=True)
class Spread:
    """Mean, minimum and maximum of points, lux or any other unit; see the module.

    u0 : minimum over mean, EN 12464-1's uniformity
    ud : minimum over maximum, its diversity
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
        """By what share of itself the minimum or the maximum may be anywhere, for the noise of points."""
        shares = [x.bounds / x.value if x.value > 0 else 0.0 for x in (self.minimum, self.maximum)]
        return max((share for share in shares if np.isfinite(share)), default=0.0)

    def asks_for(self, path_sets: int) -> int | None:
        """So many path sets, a power of two, instead of these, that noise leaves both decided; None: it does."""
        if not self.undecided > UNDECIDED:
            return None
        return int(2 ** np.ceil(np.log2(path_sets * (self.undecided / UNDECIDED) ** 2)))


def spread_of(sums: Float64, counts: NDArray[np.int64]) -> Spread:
    """The mean, minimum and maximum of N points.

    sums   : (8, N) float64 over the path sets of each of a film's batches, N from 1
    counts : (8,) path sets of each; 0 where there are none

    The error of the mean is the spread of the batches' means, whatever points have in common.
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
    # Batches whose errors have the correlation -k; of halves of them it is -c.
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
    # Where noise is skewed, a point whose noise makes it low has a small spread, too: all that may be lowest count.
    own = standard_error(sums, counts)
    own = own[means - 2 * own <= (means + 2 * own).min()]
    # The variance of a number that may be anywhere between two is a twelfth of the square of their distance.
    return Extreme(value, float(np.sqrt(np.median(own**2) + bounds**2 / 12)), plain, bounds)


def _gain(sums: Float64, counts: NDArray[np.int64]) -> float:
    """The variance of means over all batches, as a share of what independent batches would have.

    A batch's number is three bits of the numbers of its path sets. Where the variance of n path sets falls as
    n^-(1 + a), batches that differ in the lowest bit differ most. With each further bit the variance falls by 2^-a,
    down to that of the mean over all of them.
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
    """Numbers of the batches that choose: all halves, of an odd number the smaller and the larger."""
    for size in sorted({batches // 2, batches - batches // 2}):
        yield from (list(each) for each in combinations(range(batches), size))


def _ratio(one: Estimate, other: Estimate) -> Estimate:
    if not other.value > 0:
        return Estimate(np.nan, np.nan)
    value = one.value / other.value
    return Estimate(value, float(np.hypot(one.error, value * other.error) / other.value))
