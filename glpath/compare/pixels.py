"""Comparisons of images without noise: bit by bit, or with visually negligible tolerances.

`exact` is only valid on one device with one seed, because other drivers round differently. `fuzzy` is for
deterministic engines on any device. Their images differ in rounding, and at edges, where a sample falls on one side
or the other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from glpath.compare.measures import matching_pair
from glpath.compare.picture import Picture
from glpath.compare.verdict import Verdict
from glpath.errors import UsageError
from glpath.system.colour import encode_srgb

Float64 = NDArray[np.float64]

#: Default allowance: difference of a pixel, in 8-bit levels (0 to 255), that passes.
THRESHOLD = 2.0
#: Default additional allowance at edges, as a fraction of the contrast around a pixel.
EDGE = 0.25
#: Default percentage of pixels that may differ by more than their allowance.
FAILPERCENT = 0.0

# Rounding error of the difference, in levels: 2 levels may be computed as 2.0000000000000004.
_ROUNDING = 1e-9


def exact(picture: Picture, reference: Picture) -> Verdict:
    """Return the verdict, passed if all values are equal as float32, the precision of a baseline."""
    a, b = matching_pair(picture.mean, reference.mean)
    differ = (a.astype(np.float32) != b.astype(np.float32)).any(axis=-1)
    count = int(np.count_nonzero(differ))
    measured: dict[str, object] = {"pixels": count, "max_difference": float(np.max(np.abs(a - b)))}
    if not count:
        return Verdict("exact", True, 0.0, "equal to the bit", measured)
    y, x = np.unravel_index(int(np.argmax(np.abs(a - b).max(axis=-1))), differ.shape)
    measured["worst_at"] = [int(x), int(y)]
    summary = f"{_share(count, differ.size)} differ, the worst at ({x}, {y}) by {measured['max_difference']:.3g}"
    ours, theirs = (p.provenance.get("glpath.device", "") for p in (picture, reference))
    if ours != theirs:
        summary += (
            f"; another device rounds otherwise: {ours or 'unknown'} here, {theirs or 'unknown'} in the reference"
        )
    seeds = [p.provenance.get("glpath.seed") for p in (picture, reference)]
    if seeds[0] != seeds[1]:
        summary += f"; the seed is {seeds[0]} here and {seeds[1]} in the reference"
    return Verdict("exact", False, 1.0 + count / differ.size, summary, measured)


def fuzzy(
    picture: Picture,
    reference: Picture,
    *,
    threshold: float = THRESHOLD,
    edge: float = EDGE,
    failpercent: float = FAILPERCENT,
) -> Verdict:
    """Return the verdict, passed if at most `failpercent` of the pixels differ by more than their allowance.

    threshold   : allowance in levels of 255 of an sRGB image; above white, levels continue logarithmically
    edge        : additional allowance, as a fraction of the contrast among a pixel's eight neighbours in the
                  reference. The coverage at an edge may differ by a quarter of a pixel. An edge displaced by a
                  whole pixel is detected. It does not apply if the signed differences that it allows average to
                  more than `threshold` over the image
    failpercent : percentage of all pixels

    Raises UsageError for a limit below 0.
    """
    for name, value in (("threshold", threshold), ("edge", edge), ("failpercent", failpercent)):
        if not 0 <= value < math.inf:
            raise UsageError(f"{name}: found {value}, expected a number of at least 0.")
    limits = {"threshold": threshold, "edge": edge, "failpercent": failpercent}
    same = np.array_equal(*matching_pair(picture.mean, reference.mean))
    if same:  # nearly all images of a test suite are equal, and this test takes a tenth of the time
        measured = {"pixels": 0, "percent": 0.0, "worst_levels": 0.0, "worst_at": [0, 0], "max_difference": 0.0}
        return Verdict("fuzzy", True, 0.0, _within(threshold), measured, limits)
    from scipy import ndimage  # late, because the import is slow

    a, b = (255 * _levels(image) for image in matching_pair(picture.mean, reference.mean))
    off = np.abs(a - b)
    around = (3, 3, 1)
    contrast = ndimage.maximum_filter(b, around, mode="nearest") - ndimage.minimum_filter(b, around, mode="nearest")
    forgiven = (off > threshold) & (off <= threshold + edge * contrast)
    # Coverage differences at edges cancel in the mean. If they do not, a texture has another brightness.
    adds_up = bool(np.any(np.abs(np.where(forgiven, a - b, 0.0).mean(axis=(0, 1))) > threshold))
    beyond = (off if adds_up else off - edge * contrast).max(axis=-1)
    failing = beyond > threshold + _ROUNDING
    count, percent = int(np.count_nonzero(failing)), 100 * float(np.mean(failing))
    y, x = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    worst = float(off[y, x].max())
    measured = {
        "pixels": count,
        "percent": percent,
        "worst_levels": worst,
        "worst_at": [int(x), int(y)],
        "max_difference": float(np.max(np.abs(picture.mean - reference.mean))),
    }
    # The verdict depends on the worst pixel that remains after the allowed number of worse pixels is left out.
    allowed = int(failpercent / 100 * beyond.size)
    deciding = 0.0 if allowed >= beyond.size else max(0.0, float(np.sort(beyond, axis=None)[::-1][allowed]))
    passed = deciding <= threshold + _ROUNDING
    severity = deciding / threshold if threshold else 0.0 if passed else 1.0 + deciding
    if not count:
        summary = _within(threshold)
    else:
        summary = (
            f"{_share(count, failing.size)} are off by more than {threshold:g} of 255 levels, {failpercent:g} % "
            f"allowed; the worst at ({x}, {y}) by {worst:.3g}"
        )
    return Verdict("fuzzy", passed, severity, summary, measured, limits)


def _levels(radiance: Float64) -> Float64:
    """Return sRGB, continued above white as a logarithm of the same slope, so that differences there count."""
    above = np.log(np.maximum(radiance, 1.0)) * (1.055 / 2.4)
    levels: Float64 = encode_srgb(radiance) + above + np.minimum(radiance, 0.0)
    return levels


def _within(threshold: float) -> str:
    return f"no pixel is off by more than {threshold:g} of 255 levels"


def _share(count: int, of: int) -> str:
    return f"{count} of {of} pixels ({100 * count / of:.3g} %)"
