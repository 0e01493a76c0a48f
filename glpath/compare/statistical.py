"""Whether two noisy pictures can have one expectation: tests on the variance between batches.

Three scales, as each sees what the others miss: every pixel (a wrong pixel), every block of 16 x 16 (an object
moved, a shadow gone) and the whole picture (a little darker all over). On each, every channel is a t-test, and the
level is divided among them all by Šidák's rule, so that `alpha` is the chance that noise alone fails the
comparison.

Two renders of other random numbers are compared by Welch's test. Of the same random numbers (seed and path sets
equal) blocks and the whole picture are compared batch by batch: noise that both share cancels, so that a bias of 1
% is seen after 64 path sets. Between pictures of other seeds it is seen when noise allows; `smallest_bias` says
what was.

The tests hold for independent batches. Batches of one Sobol sequence complement each other: their spread overstates
the error (see `Film.variance_of_mean`), so that false alarms are rarer than `alpha`, and `smallest_bias` is larger
than it could be. Pixels that err together make Šidák's rule careful, never wrong.

Sources: Welch 1947, "The generalization of Student's problem"; Šidák 1967, "Rectangular confidence regions"; Subr &
Arvo 2007, "Statistical hypothesis testing for assessing Monte Carlo estimators"; the tests of Mitsuba 3 do alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from glpath.compare.picture import BLOCK_SIDE, Noise, Picture, block_pixels
from glpath.compare.verdict import Verdict
from glpath.errors import UsageError
from glpath.film import BLOCK
from glpath.image import luminance

Float64 = NDArray[np.float64]

#: Chance that two pictures that differ by noise alone fail, and the share of the radiance that is let pass as
#: rounding of another device.
ALPHA = 1e-4
TOLERANCE = 0.002

#: Below this many batches a spread says too little.
LEAST_BATCHES = 4

# A bias is called found when it would be in 99 of 100 pairs: so many standard errors above the limit.
_MARGIN = 2.33

# Stands for infinity, which JSON does not have.
_ENDLESS = 1e6


@dataclass(frozen=True)
class _Scale:
    """The tests of one scale.

    difference : (..., 3) picture - reference
    error      : (..., 3) standard error of the difference
    dof        : (..., 3) degrees of freedom of that error
    level      : (..., 3) radiance that relative numbers refer to
    """

    name: str
    difference: Float64
    error: Float64
    dof: Float64
    level: Float64


def stat(picture: Picture, reference: Picture, *, alpha: float = ALPHA, tolerance: float = TOLERANCE) -> Verdict:
    """Compare two pictures with noise.

    alpha     : chance of a false alarm
    tolerance : relative difference that never fails, of a pixel's radiance or of the picture's mean, the larger one

    Raises UsageError for a picture without noise, or of too few batches.
    """
    if not 0 < alpha < 1:
        raise UsageError(f"alpha: found {alpha}, expected a probability between 0 and 1.")
    if not 0 <= tolerance < math.inf:
        raise UsageError(f"tolerance: found {tolerance}, expected a number of at least 0.")
    ours, theirs = _noise(picture, "picture"), _noise(reference, "reference")
    paired = picture.shares_samples_with(reference)
    typical = luminance(reference.mean).mean()
    scales = _scales(picture, reference, ours, theirs, paired, typical)
    alpha_scale = -math.expm1(math.log1p(-alpha) / len(scales))
    found: dict[str, object] = {"paired": paired}
    severity, sentences = 0.0, []
    for scale in scales:
        alpha_test = -math.expm1(math.log1p(-alpha_scale) / scale.difference.size)
        limit = stats.t.isf(alpha_test / 2, scale.dof)
        excess = np.maximum(np.abs(scale.difference) - tolerance * scale.level, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.where(excess > 0, excess / scale.error, 0.0)
        ratio = np.minimum(errors / limit, _ENDLESS)
        worst = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        severity = max(severity, float(ratio[worst]))
        failing = int(np.count_nonzero(ratio > 1))
        # Relative to what is there, not to the picture's mean: this number is for people.
        there = float(max(abs(_radiance(scale, worst, reference)), 1e-3 * scale.level[worst]))
        relative = float(scale.difference[worst]) / there if there else 0.0
        found[scale.name] = {
            "tests": scale.difference.size,
            "failing": failing,
            "worst_at": _pixel(scale.name, worst),
            "channel": "RGB"[int(worst[-1])],
            "relative_difference": relative,
            "standard_errors": min(float(errors[worst]), _ENDLESS),
            "limit": float(limit[worst]),
        }
        if failing:
            sentences.append(_sentence(scale.name, found[scale.name], scale.difference.size))
    smallest = _smallest_bias(scales[-1], ours, picture, paired, alpha_scale, tolerance)
    found["smallest_bias"] = smallest
    passed = severity <= 1
    way = "batch by batch" if paired else "as independent renders"
    if passed:
        sees = "no bias, however large" if smallest is None else f"a bias of {100 * smallest:.2g} %"
        summary = f"the difference is within noise (compared {way}, which sees {sees})"
    else:
        summary = f"more than noise ({way}): " + "; ".join(sentences)
    return Verdict("stat", passed, severity, summary, found, {"alpha": alpha, "tolerance": tolerance})


def _scales(
    picture: Picture, reference: Picture, ours: Noise, theirs: Noise, paired: bool, typical: float
) -> list[_Scale]:
    """Pixels, blocks, the whole: in this order."""
    scales = [
        _welch(
            "pixel",
            picture.mean - reference.mean,
            ours.variance,
            theirs.variance,
            len(ours.batch_counts),
            len(theirs.batch_counts),
            np.maximum(np.abs(reference.mean), typical),
        )
    ]
    weights = block_pixels(reference.mean.shape)
    weights /= weights.sum()
    for name in ("block", "image"):
        a, b = ours.block_batches, theirs.block_batches
        if name == "image":
            a, b = (np.einsum("bhwc,hw->bc", batches, weights) for batches in (a, b))
        mean_a, variance_a = _mean_and_variance(a, ours.batch_counts)
        mean_b, variance_b = _mean_and_variance(b, theirs.batch_counts)
        level = np.maximum(np.abs(mean_b), typical)
        if paired:
            difference, variance = _mean_and_variance(a - b, ours.batch_counts)
            dof = np.full(difference.shape, len(ours.batch_counts) - 1.0)
            scales.append(_Scale(name, difference, np.sqrt(variance), dof, level))
        else:
            counts = len(ours.batch_counts), len(theirs.batch_counts)
            scales.append(_welch(name, mean_a - mean_b, variance_a, variance_b, *counts, level))
    return scales


def _welch(name: str, difference: Float64, va: Float64, vb: Float64, na: int, nb: int, level: Float64) -> _Scale:
    """Welch 1947: `va` and `vb` are variances of the means, from `na` and `nb` batches."""
    total = va + vb
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = total**2 / (va**2 / (na - 1) + vb**2 / (nb - 1))
    # Without any noise on either side every difference is beyond chance, whatever the freedom.
    return _Scale(name, difference, np.sqrt(total), np.where(total > 0, dof, na + nb - 2.0), level)


def _mean_and_variance(batches: Float64, counts: NDArray[np.int64]) -> tuple[Float64, Float64]:
    """Mean (...) of (B, ...) batches of so many path sets, and its variance, as `Film.variance_of_mean` has it."""
    share = counts / counts.sum()
    mean: Float64 = np.tensordot(share, batches, axes=1)
    variance: Float64 = np.tensordot(share, (batches - mean) ** 2, axes=1) / (len(counts) - 1)
    return mean, variance


def _noise(picture: Picture, which: str) -> Noise:
    if picture.noise is None or len(picture.noise.batch_counts) < LEAST_BATCHES:
        sets = picture.provenance.get("glpath.path_sets")
        found = "has no path sets" if sets is None else f"has {sets} path sets"
        raise UsageError(
            f"stat: the {which} {found}; noise is told from a change with {LEAST_BATCHES * BLOCK} or more.",
            "Render more of them, and compare films (.npz) or baselines (.exr); or take the mode fuzzy.",
        )
    return picture.noise


def _smallest_bias(
    image: _Scale, ours: Noise, picture: Picture, paired: bool, alpha_scale: float, tolerance: float
) -> float | None:
    """The share by which all of the picture may be darker and be found out, in the channel that sees most; None
    where there is no such share below 1."""
    alpha_test = -math.expm1(math.log1p(-alpha_scale) / image.difference.size)
    reach = (stats.t.isf(alpha_test / 2, image.dof) + _MARGIN) * image.error
    brightness = picture.mean.mean(axis=(0, 1))
    room = brightness.copy()
    if paired:
        # A bias in proportion to the picture is as noisy as the picture itself.
        weights = block_pixels(picture.mean.shape)
        batches = np.einsum("bhwc,hw->bc", ours.block_batches, weights / weights.sum())
        _, variance = _mean_and_variance(batches, ours.batch_counts)
        room -= reach / np.maximum(image.error, 1e-300) * np.sqrt(variance) if np.any(image.error > 0) else 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        bias = np.where(room > 0, (tolerance * image.level + reach) / room, np.inf)
    smallest = float(bias.min())
    return smallest if smallest < 1 else None


def _radiance(scale: _Scale, where: tuple[np.intp, ...], reference: Picture) -> float:
    channel = where[-1]
    if scale.name == "pixel":
        return float(reference.mean[where])
    if scale.name == "image":
        return float(reference.mean[..., channel].mean())
    y, x = (int(i) * BLOCK_SIDE for i in where[:2])
    return float(reference.mean[y : y + BLOCK_SIDE, x : x + BLOCK_SIDE, channel].mean())


def _pixel(name: str, where: tuple[np.intp, ...]) -> list[int] | None:
    """[x, y] of the pixel, or of the block's upper left one."""
    if name == "image":
        return None
    side = BLOCK_SIDE if name == "block" else 1
    return [int(where[1]) * side, int(where[0]) * side]


def _sentence(name: str, found: object, tests: int) -> str:
    assert isinstance(found, dict)
    relative = found["relative_difference"]
    way = "brighter" if relative > 0 else "darker"
    by = f"{way} by {100 * abs(relative):.2g} % in {found['channel']}" if abs(relative) < 10 else f"much {way}"
    errors = found["standard_errors"]
    strength = (
        f"{errors:.1f} standard errors, {found['limit']:.1f} allowed" if errors < _ENDLESS else "without noise"
    )
    if name == "image":
        return f"the whole picture is {by} ({strength})"
    kind = "16 x 16 blocks" if name == "block" else "pixels"
    x, y = found["worst_at"]
    of = tests // 3
    return f"{found['failing']} channels of {of} {kind}, the worst at ({x}, {y}), {by} ({strength})"
