"""Tests that two noisy images have the same expectation, based on the variance between batches.

There are three scales, because each detects differences that the others miss: every pixel (a wrong pixel), every
block of 16 x 16 pixels (a moved object, a missing shadow) and the whole image (slightly darker overall). At each
scale, there is a t-test for each channel. The significance level is divided among all tests by Šidák's rule, so
that `alpha` is the probability that noise alone fails the comparison.

Two renders with different random numbers are compared by Welch's test. With the same random numbers (equal seed and
path sets), blocks and the whole image are compared batch by batch. Common noise then cancels, so that a bias of 1 %
is detected after 64 path sets. With different seeds, detection depends on the noise.

A test that could not detect a bias of `sees` does not pass. The test of the whole image rejects beyond `limit`
standard errors s, so a bias b of its mean m counts as visible if

    b m - tolerance m >= (limit + z) s,   Phi(z) = 0.99

Batch by batch, s grows by the amount that a bias in proportion to the image adds to it. An image that is uniformly
too bright or too dark by `sees` then passes in at most 1 of 100 cases, whatever its noise. If the true error is at
most m (sees - tolerance) / (limit + z), the t-test passes it with a probability below 1 - Phi(z). If the true error
is larger, s would have to be underestimated first. `smallest_bias` is the smallest bias visible at each scale; for
pixels and blocks it is the median. The number of path sets in the message is sufficient in 9 of 10 cases, because s
itself is an estimate.

The tests assume independent batches. Batches of one Sobol sequence complement each other. Their spread
overestimates the error (see `Film.variance_of_mean`), and `smallest_bias` is larger than necessary. Pixels that err
together make Šidák's rule conservative, never wrong. So false alarms are rarer than `alpha`. They were counted in
1000 pairs of renders with different seeds (Cornell box, 32 x 32, 64 path sets, `sees` 1). None failed at alpha
0.001, where the worst reached 0.76 of its limit, and 1 failed at 0.05.

Poor at:  differences that cancel within a block and are hidden by the noise of each pixel. Render more path sets.

Sources: Welch 1947, "The generalization of Student's problem"; Šidák 1967, "Rectangular confidence regions";
         Guenther 1981, "Sample size formulas for normal theory t tests"; Stein 1945, "A two-sample test for a
         linear hypothesis whose power is independent of the variance"; Subr & Arvo 2007, "Statistical hypothesis
         testing for assessing Monte Carlo estimators"; the tests of Mitsuba 3 are similar.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from glpath.compare.picture import BLOCK_SIDE, Noise, Picture, block_pixels, unusable_noise
from glpath.compare.verdict import Verdict
from glpath.errors import ImageError, UsageError
from glpath.film.batches import BATCHES, BLOCK
from glpath.system.colour import luminance

Float64 = NDArray[np.float64]

#: Default probability that two images that differ only by noise fail.
ALPHA = 1e-3
#: Default relative difference that is ignored, because another device may cause it by rounding.
TOLERANCE = 0.002
#: Default relative bias of the whole image that a comparison must be able to detect; otherwise it fails.
SEES = 0.05

#: Minimum number of batches in an image; with fewer, the estimated error would be useless.
MIN_BATCHES = 4

# Number of standard errors above the limit at which a bias is detected in 99 of 100 pairs of images.
_MARGIN = float(ndtri(0.99))
# Probability that the number of path sets reported as sufficient is sufficient.
_ENOUGH = 0.9

# Substitute for infinity, which JSON does not have.
_ENDLESS = 1e6


@dataclass(frozen=True)
class _Scale:
    """Tests at one scale; all fields except the name are (..., 3) float64.

    difference : picture - reference
    error      : standard error of the difference
    dof        : degrees of freedom of that error
    level      : radiance to which the tolerance is relative
    reference  : radiance of the reference
    spread     : amount that a relative bias of 1 adds to the error, batch by batch; 0 for independent images
    per_set    : variance of the difference if both images had one path set
    """

    name: str
    difference: Float64
    error: Float64
    dof: Float64
    level: Float64
    reference: Float64
    spread: Float64
    per_set: Float64


def stat(
    picture: Picture,
    reference: Picture,
    *,
    alpha: float = ALPHA,
    tolerance: float = TOLERANCE,
    sees: float = SEES,
) -> Verdict:
    """Compare two images with noise; passed if noise explains their difference and could not hide a bias of `sees`.

    alpha     : probability of a false alarm, that is of failing because of noise alone
    tolerance : relative difference that never fails, relative to a pixel's radiance or the image's mean, the larger
                one
    sees      : relative brightness error of the whole image that would be detected in 99 of 100 cases. If noise
                hides more than that, the comparison fails and reports the number of path sets that it needs

    Raises UsageError for an image without noise or with too few batches, and for limits out of range; ImageError
    for impossible noise.
    """
    if not 0 < alpha < 1:
        raise UsageError(f"alpha: found {alpha}, expected a probability between 0 and 1.")
    if not 0 <= tolerance < math.inf:
        raise UsageError(f"tolerance: found {tolerance}, expected a number of at least 0.")
    if not tolerance < sees <= 1:
        raise UsageError(
            f"sees: found {sees}, expected a share above the tolerance ({tolerance:g}), at most 1.",
            "0.05 asks that a picture 5 % too dark would be found out.",
        )
    from scipy import stats  # late, because the import is slow

    ours, theirs = _noise(picture, "picture"), _noise(reference, "reference")
    paired = picture.shares_samples_with(reference)
    typical = luminance(reference.mean).mean()
    scales = _scales(picture, reference, ours, theirs, paired, typical)
    alpha_scale = -math.expm1(math.log1p(-alpha) / len(scales))
    found: dict[str, object] = {"paired": paired}
    severity, sentences, visible = 0.0, [], {}
    for scale in scales:
        alpha_test = -math.expm1(math.log1p(-alpha_scale) / scale.difference.size)
        limit = stats.t.isf(alpha_test / 2, scale.dof)
        excess = np.maximum(np.abs(scale.difference) - tolerance * scale.level, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.where(excess > 0, excess / scale.error, 0.0)
        ratio = np.minimum(errors / limit, _ENDLESS)
        worst = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        severity = float(np.maximum(severity, ratio[worst]))  # np.maximum keeps a NaN, so that the test fails
        failing = int(np.count_nonzero(~(ratio <= 1)))
        # For display, the difference is relative to the local value, not to the image's mean.
        there = float(max(abs(scale.reference[worst]), 1e-3 * scale.level[worst]))
        relative = float(scale.difference[worst]) / there if there else 0.0
        visible[scale.name] = _visible_bias(scale, limit, tolerance)
        found[scale.name] = {
            "tests": scale.difference.size,
            "failing": failing,
            "worst_at": _pixel(scale.name, worst),
            "channel": "RGB"[int(worst[-1])],
            "relative_difference": relative,
            "standard_errors": min(float(errors[worst]), _ENDLESS),
            "limit": float(limit[worst]),
            "smallest_bias": _below_one(visible[scale.name]),
        }
        if failing:
            sentences.append(_sentence(scale.name, found[scale.name], scale.difference.size))
    found["smallest_bias"] = _below_one(visible["image"])
    limits = {"alpha": alpha, "tolerance": tolerance, "sees": sees}
    pairing = "batch by batch" if paired else "as independent renders"
    if not severity <= 1:
        known = _known_bias(picture, reference)
        return Verdict(
            "stat", False, severity, f"more than noise ({pairing}): " + "; ".join(sentences) + known, found, limits
        )
    seen = _shown_bias(visible["image"])
    if visible["image"] > sees:
        found["path_sets_needed"] = needed = _path_sets_needed(scales[-1], ours, alpha_test, tolerance, sees)
        severity = min(visible["image"] / sees, _ENDLESS)
        remedy = "; no number of path sets would do" if needed is None else f"; render both with {needed} path sets"
        summary = (
            f"noise hides too much to compare ({pairing}): of the whole picture {seen}, {100 * sees:g} % asked"
        )
        return Verdict("stat", False, severity, summary + remedy, found, limits)
    block = _shown_bias(visible["block"])
    summary = (
        f"the difference is within noise (compared {pairing}; of the whole picture {seen}, of a block {block})"
    )
    return Verdict("stat", True, severity, summary, found, limits)


def _known_bias(picture: Picture, reference: Picture) -> str:
    """Return text on the bias of the two engines as a possible cause of a difference; "" for the same engine."""
    name = "glpath.integrator"
    if picture.provenance.get(name) == reference.provenance.get(name):
        return ""
    pairs = (("picture", picture), ("reference", reference))
    given = [
        f"the {which}, of a {made.provenance.get(name, 'nameless engine')}, {made.bias}"
        for which, made in pairs
        if made.bias
    ]
    return "; " * bool(given) + "; ".join(given)


def _scales(
    picture: Picture, reference: Picture, ours: Noise, theirs: Noise, paired: bool, typical: float
) -> list[_Scale]:
    """Return the tests of pixels, blocks and the whole image, in this order."""
    scales = [
        _welch("pixel", (picture.mean, ours.variance, ours), (reference.mean, theirs.variance, theirs), typical)
    ]
    weights = block_pixels(reference.mean.shape)
    weights /= weights.sum()
    for name in ("block", "image"):
        a, b = ours.block_batches, theirs.block_batches
        if name == "image":
            a, b = (np.einsum("bhwc,hw->bc", batches, weights) for batches in (a, b))
        mean, variance = _mean_and_variance(b, theirs.batch_counts)
        if paired:
            difference, squared_error = _mean_and_variance(a - b, ours.batch_counts)
            dof = np.full(difference.shape, len(ours.batch_counts) - 1.0)
            level = np.maximum(np.abs(mean), typical)
            per_set = squared_error * ours.batch_counts.sum()
            error, spread = np.sqrt(squared_error), np.sqrt(variance)
            scales.append(_Scale(name, difference, error, dof, level, mean, spread, per_set))
        else:
            here = _mean_and_variance(a, ours.batch_counts)
            scales.append(_welch(name, (*here, ours), (mean, variance, theirs), typical))
    return scales


def _welch(
    name: str, a: tuple[Float64, Float64, Noise], b: tuple[Float64, Float64, Noise], typical: float
) -> _Scale:
    """Return Welch's tests (1947) at a scale; `a` and `b` are each image's mean, its variance, and the noise."""
    (mean_a, va, ours), (mean_b, vb, theirs) = a, b
    na, nb = len(ours.batch_counts), len(theirs.batch_counts)
    total = va + vb
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = total**2 / (va**2 / (na - 1) + vb**2 / (nb - 1))
    # Without noise in both images, any difference is significant, whatever the degrees of freedom.
    dof = np.where(total > 0, dof, na + nb - 2.0)
    level = np.maximum(np.abs(mean_b), typical)
    per_set = va * ours.batch_counts.sum() + vb * theirs.batch_counts.sum()
    return _Scale(name, mean_a - mean_b, np.sqrt(total), dof, level, mean_b, np.zeros_like(total), per_set)


def _mean_and_variance(batches: Float64, counts: NDArray[np.int64]) -> tuple[Float64, Float64]:
    """Return the mean (...) of batches (B, ...), weighted by their numbers of path sets, and the mean's variance.

    The variance is computed as in `Film.variance_of_mean`.
    """
    share = counts / counts.sum()
    mean: Float64 = np.tensordot(share, batches, axes=1)
    variance: Float64 = np.tensordot(share, (batches - mean) ** 2, axes=1) / (len(counts) - 1)
    return mean, variance


def _noise(picture: Picture, which: str) -> Noise:
    if picture.noise is None or len(picture.noise.batch_counts) < MIN_BATCHES:
        if picture.denoised:
            raise UsageError(
                f"stat: the {which} is denoised: no noise is left to compare a change with.",
                "Compare the films (.npz), which are as they were rendered; or take the mode fuzzy or flip.",
            )
        sets = picture.provenance.get("glpath.path_sets")
        found = "has no path sets" if sets is None else f"has {sets} path sets"
        raise UsageError(
            f"stat: the {which} {found}; noise is separated from a change with {MIN_BATCHES * BLOCK} or more.",
            "Render more of them, and compare films (.npz) or baselines (.exr); or take the mode fuzzy.",
        )
    wrong = unusable_noise(picture.mean, picture.noise)
    if wrong:
        raise ImageError(f"stat: the noise of the {which} cannot be: {wrong}.", "Make it again.")
    return picture.noise


def _visible_bias(scale: _Scale, limit: Float64, tolerance: float) -> float:
    """Return the smallest relative brightness error that the tests at a scale detect.

    It is the error in the most sensitive channel. For several pixels or blocks, it is the median over them.
    """
    errors = limit + _MARGIN
    hidden = tolerance * scale.level + errors * scale.error
    room = np.abs(scale.reference) - errors * scale.spread
    with np.errstate(divide="ignore", invalid="ignore"):
        bias = np.where(hidden == 0, 0.0, np.where(room > 0, hidden / room, np.inf))
    return float(np.median(bias.min(axis=-1)))


def _path_sets_needed(image: _Scale, noise: Noise, alpha_test: float, tolerance: float, sees: float) -> int | None:
    """Return the number of path sets that suffices to detect a bias of `sees`, or None if no number does.

    It is a multiple of BLOCK * BATCHES. The error of the future image is an estimate like the present one, so the
    ratio of their squares follows an F distribution.
    """
    from scipy import stats  # late, because the import is slow

    dof = image.dof * (BATCHES - 1) / (len(noise.batch_counts) - 1)
    errors = stats.t.isf(alpha_test / 2, dof) + _MARGIN
    signal = sees * np.abs(image.reference) - tolerance * image.level
    one_set = np.sqrt(image.per_set) + sees * image.spread * math.sqrt(noise.batch_counts.sum())
    chance = stats.f.ppf(_ENOUGH, dof, image.dof)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(signal > 0, chance * (errors * one_set / signal) ** 2, np.inf).min()
    return math.ceil(needed / (BLOCK * BATCHES)) * BLOCK * BATCHES if needed < 2**31 else None


def _below_one(bias: float) -> float | None:
    return bias if bias < 1 else None


def _shown_bias(bias: float) -> str:
    return f"a bias of {100 * bias:.2g} % is seen" if bias < 1 else "no bias is seen, however large"


def _pixel(name: str, where: tuple[np.intp, ...]) -> list[int] | None:
    """Return [x, y] of the pixel, or of the block's upper left pixel; None for the whole image."""
    if name == "image":
        return None
    side = BLOCK_SIDE if name == "block" else 1
    return [int(where[1]) * side, int(where[0]) * side]


def _sentence(name: str, found: object, tests: int) -> str:
    assert isinstance(found, dict)
    relative = found["relative_difference"]
    sense = "brighter" if relative > 0 else "darker"
    by = f"{sense} by {100 * abs(relative):.2g} % in {found['channel']}" if abs(relative) < 10 else f"much {sense}"
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
