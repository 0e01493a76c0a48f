"""Perceived difference of two images: FLIP, computed by NVIDIA's optional package flip-evaluator.

The package's Python interface prints the reason and calls sys.exit for invalid input, which is an ImageError here.

Source: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images".
Poor at: results that must not depend on exposure, because FLIP compares images as displayed, with the sRGB curve.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.compare.measures import matching_pair
from glpath.compare.picture import Picture
from glpath.compare.verdict import Verdict
from glpath.errors import ImageError, UsageError
from glpath.system.arguments import checked
from glpath.system.colour import encode_srgb

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

#: Default limit of the FLIP value (0 to 1) averaged over the whole image.
MEAN = 0.01
#: Default limit of the FLIP value averaged over the worst spot of the image, see `_SPOT`.
LOCAL = 0.1
#: Default number of pixels per degree of view: a 4K screen 70 cm wide, seen from 70 cm.
PPD = 67.0
# Maximum pixels per degree; an eye resolves 60.
_MAX_PPD = 1000

# Side of a spot, in degrees of view. A spot is a square whose mean FLIP value has a limit of its own.
_SPOT = 0.1

# Distance in degrees of view within which other pixels affect a pixel's FLIP value: three standard deviations of
# FLIP's widest filter, the contrast sensitivity for blue and yellow (exp(-pi^2 r^2 / 0.04)).
_RADIUS = 3 * math.sqrt(0.04 / (2 * math.pi**2))

# FLIP's colour for no difference, the first of matplotlib's magma.
_EQUAL = (0.001462, 0.000466, 0.013866)


def flip(
    picture: Picture, reference: Picture, *, mean: float = MEAN, local: float | None = None, ppd: float = PPD
) -> Verdict:
    """Return the verdict, passed if the FLIP map's mean is at most `mean`, and that of any spot at most `local`.

    mean  : limit for the mean over the image; 0 is equal, 1 black against white
    local : limit for the mean over each square of a tenth of a degree of view (7 x 7 pixels by default), so that
            small differences in a large image are found. Default 0.1, or `mean` if that is larger. The default
            detects 5 x 5 pixels that differ from their surroundings by 16 of 255 levels, and 3 x 3 that differ by
            32. It passes rounding, noise of 2 levels, and an edge displaced by a tenth of a pixel
    ppd   : pixels per degree of view; with more, fine differences are harder to see. From 1 to 1,000

    Raises UsageError if flip-evaluator is not installed, and for limits out of range.
    """
    local = max(LOCAL, mean) if local is None else local
    for name, limit in (("mean", mean), ("local", local)):
        if not 0 <= limit <= 1:
            raise UsageError(f"{name}: found {limit}, expected a number from 0 to 1.")
    from scipy import ndimage  # late, because the import is slow

    found = flip_map(picture.mean, reference.mean, ppd=ppd)
    side = 2 * round((_SPOT * ppd - 1) / 2) + 1
    spots = ndimage.uniform_filter(found, max(side, 1), mode="reflect")
    y, x = np.unravel_index(int(np.argmax(spots)), spots.shape)
    value, spot = float(found.mean()), float(spots[y, x])
    summary = (
        f"mean FLIP {value:.4f}, {mean:g} allowed; the worst spot, at ({x}, {y}), {spot:.3g}, {local:g} allowed"
    )
    severity = max(
        share / limit if limit else 0.0 if share == 0 else 1.0 + share
        for share, limit in ((value, mean), (spot, local))
    )
    measured = {"mean": value, "local": spot, "max": float(found.max()), "worst_at": [int(x), int(y)]}
    limits = {"mean": mean, "local": local, "ppd": ppd}
    return Verdict("flip", value <= mean and spot <= local, severity, summary, measured, limits)


@checked
def flip_map(image: Float64, reference: Float64, *, ppd: float = PPD) -> Float64:
    """Return the (H, W) float64 visibility, in [0, 1], of the difference between images (H, W, 3), linear Rec. 709.

    Raises ImageError for images that cannot be compared; UsageError if flip-evaluator is not installed, or `ppd` is
    not from 1 to 1,000.
    """
    found: Float64 = (
        _evaluated(image, reference, ppd, colours=False).reshape(np.shape(image)[:2]).astype(np.float64)
    )
    return found


@checked
def flip_picture(image: Float64, reference: Float64, *, ppd: float = PPD) -> UInt8:
    """Return the FLIP map in colours, (H, W, 3) uint8 sRGB: black is equal, yellow most different.

    Raises the errors of `flip_map`.
    """
    coloured = _evaluated(image, reference, ppd, colours=True)
    return np.asarray(np.clip(coloured, 0, 1) * 255 + 0.5).astype(np.uint8)


def _evaluated(image: Float64, reference: Float64, ppd: float, *, colours: bool) -> NDArray[np.float32]:
    if not 1 <= ppd <= _MAX_PPD:
        raise UsageError(f"ppd: found {ppd}, expected 1 to {_MAX_PPD:,} pixels per degree.")
    evaluate = _evaluator()
    a, b = (encode_srgb(side).astype(np.float32) for side in matching_pair(image, reference))
    found = np.zeros((*a.shape[:2], 3 if colours else 1), np.float32)
    if colours:
        found[:] = _EQUAL
    part = _differing(a, b, ppd)
    if part is not None:
        shape = found[part].shape
        found[part] = _by_package(evaluate, a[part], b[part], ppd, colours=colours).reshape(shape)
    return found


def _differing(a: NDArray[np.float32], b: NDArray[np.float32], ppd: float) -> tuple[slice, slice] | None:
    """Return the rectangle outside which FLIP is zero, including its filters' extent; None for equal images.

    FLIP takes half a microsecond per pixel. Most changes cover only a part of an image, so only that part is
    evaluated.
    """
    differ = (a != b).any(axis=2)
    if not differ.any():
        return None
    # Pixels within the radius of a differing pixel have a FLIP value above 0, which depends on pixels as far again.
    margin = 2 * (math.ceil(_RADIUS * ppd) + 1)
    spans = (np.flatnonzero(differ.any(axis=1 - axis)) for axis in (0, 1))
    rows, columns = (slice(max(int(span[0]) - margin, 0), int(span[-1]) + 1 + margin) for span in spans)
    return rows, columns


def _by_package(
    evaluate: Any, a: NDArray[np.float32], b: NDArray[np.float32], ppd: float, *, colours: bool
) -> NDArray[np.float32]:
    try:
        evaluated = evaluate(
            np.ascontiguousarray(b),
            np.ascontiguousarray(a),
            "LDR",
            applyMagma=colours,
            computeMeanError=False,
            parameters={"ppd": ppd},
        )
    except (SystemExit, RuntimeError, ValueError, TypeError) as error:
        reason = "it printed the reason." if isinstance(error, SystemExit) else str(error)
        raise ImageError(f"flip: flip-evaluator refused the pictures: {reason}") from error
    return np.asarray(evaluated[0], np.float32)


def _evaluator() -> Any:
    try:
        from flip_evaluator import evaluate
    except ImportError as error:
        raise UsageError(
            "flip: the package flip-evaluator is not installed.", 'pip install "glpath[flip]"'
        ) from error
    return evaluate
