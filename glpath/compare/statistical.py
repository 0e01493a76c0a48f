"""Whether two noisy pictures can have one expectation: tests on the variance between batches.

Three scales, as each sees what the others miss: every pixel (a wrong pixel), every block of 16 x 16 (an object
moved, a shadow gone) and the whole picture (a little darker all over). On each, every channel is a t-test, and the
level is divided among them all by Šidák's rule, so that `alpha` is the chance that noise alone fails the
comparison.

Two renders of other random numbers are compared by Welch's test. Of the same random numbers (seed and path sets
equal) blocks and the whole picture are compared batch by batch: noise that both share cancels, so that a bias of 1
% is seen after 64 path sets. Between pictures of other seeds it is seen when noise allows.

A test that could not see a bias of `sees` does not pass. The test of the whole picture rejects beyond `limit`
standard errors s, so a bias b of its mean m is counted as visible where

    b m - tolerance m >= (limit + z) s,   Phi(z) = 0.99

(batch by batch s grows by what a bias in proportion to the picture adds to it). Then a picture that is too bright
or too dark by `sees`, in all its pixels alike, passes in at most 1 of 100 cases, whatever its noise: where the true
error is at most m (sees - tolerance) / (limit + z), the t-test lets it pass with a chance below 1 - Phi(z); where
it is larger, s would have to be underrated first. `smallest_bias` says what each scale sees; of pixels and blocks
it is the median. The number of path sets in the message is enough in 9 of 10 cases, as s itself is an estimate.

The tests hold for independent batches. Batches of one Sobol sequence complement each other: their spread overstates
the error (see `Film.variance_of_mean`), and `smallest_bias` is larger than it could be. Pixels that err together
make Šidák's rule careful, never wrong. So false alarms are rarer than `alpha`: of 1000 pairs of renders of other
seeds (Cornell box, 32 x 32, 64 path sets, `sees` 1) none failed at alpha 0.001, the worst being at 0.76 of its
limit, and 1 failed at 0.05.

Poor at:  differences that cancel within a block and drown in the noise of each pixel. Render more path sets.

Sources: Welch 1947, "The generalization of Student's problem"; Šidák 1967, "Rectangular confidence regions";
Guenther 1981, "Sample size formulas for normal theory t tests"; Stein 1945, "A two-sample test for a linear
hypothesis whose power is independent of the variance"; Subr & Arvo 2007, "Statistical hypothesis testing for
assessing Monte Carlo estimators"; the tests of Mitsuba 3 do alike.
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
from glpath.film.image import luminance

Float64 = NDArray[np.float64]

#: Chance that two pictures that differ by noise alone fail; the share of the radiance that is let pass as rounding
#: of another device; and the bias of the whole picture that a test must be able to see.
ALPHA = 1e-3
TOLERANCE = 0.002
SEES = 0.05

#: Below this many batches a spread says too little.
MIN_BATCHES = 4

# A bias is called visible when it is found in 99 of 100 pairs, and path sets are called enough when they are in 9
# of 10 cases.
_MARGIN = float(ndtri(0.99))
_ENOUGH = 0.9

# Stands for infinity, which JSON does not have.
_ENDLESS = 1e6


@dataclass(frozen=True)
class _Scale:
    """The tests of one scale; all but the name are (..., 3) float64.

    difference : picture - reference
    error      : standard error of the difference
    dof        : degrees of freedom of that error
    level      : radiance that the tolerance refers to
    reference  : radiance of the reference
    spread     : what a bias of 1 would add to the error; 0 where pictures are compared as independent
    per_set    : variance of the difference, times path sets, if both had as many
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
    """Compare two pictures with noise.

    alpha     : chance of a false alarm
    tolerance : relative difference that never fails, of a pixel's radiance or of the picture's mean, the larger one
    sees      : share by which the whole picture could be too bright or too dark and would be found out in 99 of 100
                cases; where noise hides more than that, the comparison fails and says how many path sets it needs

    Raises UsageError for a picture without noise or of too few batches, and for limits out of range; ImageError for
    noise that cannot be.
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
    from scipy import stats  # slow to import

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
        severity = float(np.maximum(severity, ratio[worst]))  # a NaN stays one, and fails
        failing = int(np.count_nonzero(~(ratio <= 1)))
        # Relative to what is there, not to the picture's mean: this number is for people.
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
    """What the engines' own bias may have to do with a difference, where they are not one engine."""
    name = "glpath.integrator"
    if picture.provenance.get(name) == reference.provenance.get(name):
        return ""
    pairs = (("picture", picture), ("reference", reference))
    given = [f"the {which}, of a {made.provenance[name]}, {made.bias}" for which, made in pairs if made.bias]
    return "; " * bool(given) + "; ".join(given)


def _scales(
    picture: Picture, reference: Picture, ours: Noise, theirs: Noise, paired: bool, typical: float
) -> list[_Scale]:
    """Pixels, blocks, the whole: in this order."""
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
    """Welch 1947: of each side its mean, the variance of that mean, and the batches that both come from."""
    (mean_a, va, ours), (mean_b, vb, theirs) = a, b
    na, nb = len(ours.batch_counts), len(theirs.batch_counts)
    total = va + vb
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = total**2 / (va**2 / (na - 1) + vb**2 / (nb - 1))
    # Without any noise on either side every difference is beyond chance, whatever the freedom.
    dof = np.where(total > 0, dof, na + nb - 2.0)
    level = np.maximum(np.abs(mean_b), typical)
    per_set = va * ours.batch_counts.sum() + vb * theirs.batch_counts.sum()
    return _Scale(name, mean_a - mean_b, np.sqrt(total), dof, level, mean_b, np.zeros_like(total), per_set)


def _mean_and_variance(batches: Float64, counts: NDArray[np.int64]) -> tuple[Float64, Float64]:
    """Mean (...) of (B, ...) batches of so many path sets, and its variance, as `Film.variance_of_mean` has it."""
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
    """The share by which a picture may be too bright or too dark and be found out, in the channel that sees most;
    the median over blocks."""
    errors = limit + _MARGIN
    hidden = tolerance * scale.level + errors * scale.error
    room = np.abs(scale.reference) - errors * scale.spread
    with np.errstate(divide="ignore", invalid="ignore"):
        bias = np.where(hidden == 0, 0.0, np.where(room > 0, hidden / room, np.inf))
    return float(np.median(bias.min(axis=-1)))


def _path_sets_needed(image: _Scale, noise: Noise, alpha_test: float, tolerance: float, sees: float) -> int | None:
    """How many path sets show a bias of `sees`, in whole rounds of all batches; None if no number does.

    The error of the picture to come is an estimate like the one at hand, so that their squares differ by an F.
    """
    from scipy import stats  # slow to import

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
    """[x, y] of the pixel, or of the block's upper left one."""
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
