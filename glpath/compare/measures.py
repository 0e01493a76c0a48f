"""Distances between an image and a reference: numbers, and an image of the difference.

All functions take an image and a reference of equal shape (H, W, 3), linear Rec. 709. They raise ImageError for
arrays of other or differing shapes, and for NaN or infinity. Documentation and benchmarks use `relative_mse`.

Poor at:  separating noise from bias. Compare `mean_ratio` with 1 as well, and look at `difference_image`: noise is
          red and blue mixed, bias is one colour in one region.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import ImageError, UsageError
from glpath.system.arguments import checked, real_array, short_repr
from glpath.system.colour import luminance

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

# Default `epsilon`, added to the squared reference so that dark pixels do not dominate; suits a white of about 1.
EPSILON = 0.01
# Maximum value of a pixel and of `peak`; its square is a finite float64.
_LARGEST = 1e150


@checked
def relative_mse(image: ArrayLike, reference: ArrayLike, epsilon: float = EPSILON) -> float:
    """Return mean((image - reference)² / (reference² + epsilon)) over pixels and channels; 0 for equal images.

    Raises ImageError for shapes that differ, NaN or infinity. Raises UsageError for an epsilon below 0, and for 0
    if the square of a reference value is 0.

    Source: Rousselle et al. 2011, "Adaptive Sampling and Reconstruction using Greedy Error Minimization".
    """
    a, b = matching_pair(image, reference)
    _check_epsilon(epsilon, b)
    return float(np.mean((a - b) ** 2 / (b**2 + epsilon)))


@checked
def mse(image: ArrayLike, reference: ArrayLike) -> float:
    """Return mean((image - reference)²) over pixels and channels. Raises ImageError."""
    a, b = matching_pair(image, reference)
    return float(np.mean((a - b) ** 2))


@checked
def psnr(image: ArrayLike, reference: ArrayLike, peak: float | None = None) -> float:
    """Return 10 log10(peak² / mse) in decibels; infinite for equal images.

    peak : largest possible value; None: maximum of the reference, because radiance has no upper bound

    Raises ImageError.
    """
    if peak is not None and not abs(peak) <= _LARGEST:
        raise UsageError(f"peak: {short_repr(peak)} where a number up to {_LARGEST:g} is needed")
    a, b = matching_pair(image, reference)
    largest = float(np.abs(a - b).max())
    top = float(b.max()) if peak is None else peak
    if largest == 0 or top <= 0:
        return math.inf if largest == 0 else -math.inf
    # Logarithms of quotients, because squares of values below 1e-162 are 0.
    error = float(np.mean(((a - b) / largest) ** 2))
    return 20 * (math.log10(top) - math.log10(largest)) - 10 * math.log10(error)


@checked
def max_difference(image: ArrayLike, reference: ArrayLike) -> float:
    """Return the maximum of |image - reference| over pixels and channels. Raises ImageError."""
    a, b = matching_pair(image, reference)
    return float(np.max(np.abs(a - b)))


@checked
def percent_beyond(image: ArrayLike, reference: ArrayLike, limit: float) -> float:
    """Return the percentage of pixels with a channel that differs by more than `limit`.

    Raises ImageError. Raises UsageError for a limit that is not a finite number from 0.
    """
    if not 0 <= limit < math.inf:
        raise UsageError(f"limit: {short_repr(limit)} where a finite number from 0 is needed")
    a, b = matching_pair(image, reference)
    return 100 * float(np.mean((np.abs(a - b) > limit).any(axis=-1)))


@checked
def mean_ratio(image: ArrayLike, reference: ArrayLike) -> float:
    """Return mean(image) / mean(reference), the energy gained or lost; NaN if both are black. Raises ImageError."""
    a, b = matching_pair(image, reference)
    above, below = float(a.mean()), float(b.mean())
    if below == 0:
        return math.nan if above == 0 else math.copysign(math.inf, above)
    return above / below


@checked
def difference_image(
    image: ArrayLike, reference: ArrayLike, scale: float | None = None, epsilon: float = EPSILON
) -> tuple[UInt8, float]:
    """Return the difference of luminance in false colours: red is too bright, blue too dark, white is equal.

    Parameters
    ----------
    scale : value of (image - reference) / sqrt(reference² + epsilon) that gets the full colour; None: the 99th
            percentile of its magnitude

    Returns the image, (H, W, 3) uint8 sRGB, and the scale. Raises ImageError; UsageError for a scale that is not
    above 0, and as `relative_mse` for `epsilon`.
    """
    if scale is not None and not 0 < scale < math.inf:
        raise UsageError(f"scale: found {short_repr(scale)}, expected a finite number above 0.")
    a, b = matching_pair(image, reference)
    y = luminance(b)
    _check_epsilon(epsilon, y)
    relative = (luminance(a) - y) / np.sqrt(y**2 + epsilon)
    if scale is None:
        scale = float(np.quantile(np.abs(relative), 0.99)) or float(np.abs(relative).max()) or 1.0
    t = np.clip(relative / scale, -1.0, 1.0)[..., None]
    # Ends and centre of ColorBrewer's RdBu (Harrower & Brewer 2003), which colour-blind readers can distinguish.
    red, middle, blue = np.array([178, 24, 43]), np.array([247, 247, 247]), np.array([33, 102, 172])
    colour = middle + np.maximum(t, 0) * (red - middle) + np.maximum(-t, 0) * (blue - middle)
    return (colour + 0.5).astype(np.uint8), scale


def _check_epsilon(epsilon: float, reference: Float64) -> None:
    """Raise UsageError for an epsilon below 0, and for 0 if the square of a reference value is 0."""
    if not 0 <= epsilon < math.inf:
        raise UsageError(f"epsilon: {short_repr(epsilon)} where a finite number from 0 is needed")
    zeros = np.count_nonzero(reference**2 == 0) if epsilon == 0 else 0
    if zeros:
        raise UsageError(
            f"epsilon: 0 where a number above 0 is needed, because the squares of {zeros:,} reference values are 0",
            f"The default is {EPSILON:g}.",
        )


def matching_pair(image: ArrayLike, reference: ArrayLike) -> tuple[Float64, Float64]:
    """Return both images as (H, W, 3) float64. Raises ImageError for shapes that differ, NaN or infinity."""
    size, wanted = np.shape(image), np.shape(reference)
    check_same_size(size, wanted)
    if len(size) != 3 or size[2] != 3 or 0 in size:
        raise ImageError(f"compare: found arrays of shape {size}, expected (H, W, 3).")
    a, b = real_array("image", image), real_array("reference", reference)
    for name, array in (("picture", a), ("reference", b)):
        broken = int(np.count_nonzero(~(np.abs(array) <= _LARGEST).all(axis=-1)))
        if broken:
            raise ImageError(f"compare: {broken} pixels of the {name} are NaN or infinite, or beyond {_LARGEST:g}.")
    return a, b


def check_same_size(size: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    """Raise ImageError unless the shape of a picture is that of its reference."""
    if size != wanted:
        raise ImageError(
            f"compare: the picture is {_size(size)} and the reference {_size(wanted)}; they must be of one size.",
            "Make both of one size: a render by its resolution and crop, a plot by its figsize and dpi.",
        )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}" if len(shape) == 3 else f"of shape {shape}"
