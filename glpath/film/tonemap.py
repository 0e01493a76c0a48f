"""Tone curves and automatic exposure: 8-bit images for a screen from radiance.

Sources: Reinhard et al. 2002, "Photographic Tone Reproduction for Digital Images"; Narkowicz 2015, "ACES Filmic
         Tone Mapping Curve".
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError
from glpath.system.arguments import checked, short_repr
from glpath.system.colour import check_colours, encode_srgb, luminance

__all__ = ["auto_exposure", "tonemap"]

Float64 = NDArray[np.float64]
UInt8 = NDArray[np.uint8]

# Luminance that Reinhard's operator maps to white. It is fixed and not the image's maximum, so that a crop and the
# frames of a series have the same brightness.
REINHARD_WHITE = 4.0


# Maximum size of an exposure, stops. 2 to the power of 1,000 is a finite float64.
_MAX_STOPS = 1000


# Log-average luminance, called middle grey, to which `auto_exposure` brings an image.
MIDDLE_GREY = 0.18


def _reinhard(radiance: Float64) -> Float64:
    """Return radiance with Reinhard's equation 4 (2002) applied to its luminance; the colour does not change."""
    y = luminance(radiance)[..., None]
    return radiance * (1.0 + y / REINHARD_WHITE**2) / (1.0 + y)


def _aces(radiance: Float64) -> Float64:
    """Return Narkowicz's fit (2015) of the ACES reference curve for each channel, so that highlights turn white."""
    x = radiance
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


# Maximum radiance after exposure, so that no tone curve overflows; each is white long before.
_MAX_LIGHT = 1e30


# Tone curves by name (`choices.TONEMAP_NAMES`). Each maps radiance after exposure to linear display values, which
# are then clipped to [0, 1].
TONEMAPS: dict[str, Callable[[Float64], Float64]] = {
    "srgb": lambda radiance: radiance,
    "reinhard": _reinhard,
    "aces": _aces,
}


@checked
def tonemap(radiance: ArrayLike, exposure: float = 0.0, operator: str = "srgb") -> UInt8:
    """Return radiance as an image for a screen.

    Parameters
    ----------
    radiance : (H, W, 3), W sr^-1 m^-2, linear Rec. 709
    exposure : stops; 1 doubles the brightness
    operator : "srgb" clips, "reinhard" and "aces" compress bright values; the sRGB curve is applied afterwards

    Returns (H, W, 3) uint8, sRGB. Raises UsageError for another operator and for stops beyond 1,000 in size;
    ImageError for an array of another shape.

    Example
    -------
    >>> tonemap([[[0.0, 0.18, 1.0]]]).tolist()
    [[[0, 118, 255]]]
    """
    check_tonemap(operator)
    if not abs(exposure) <= _MAX_STOPS:
        raise UsageError(
            f"exposure: {short_repr(exposure)} where stops from -{_MAX_STOPS:,} to {_MAX_STOPS:,} are needed"
        )
    check_colours(radiance)
    with np.errstate(over="ignore"):
        light = np.maximum(np.asarray(radiance, np.float64), 0.0) * np.exp2(exposure)
    light = np.minimum(light, _MAX_LIGHT)
    return (encode_srgb(TONEMAPS[operator](light)) * 255.0 + 0.5).astype(np.uint8)


@checked
def auto_exposure(radiance: ArrayLike) -> float:
    """Return the stops that bring the log-average luminance to middle grey, 0.18 [Reinhard et al. 2002].

    Equations 1 and 2 of the paper give the average. Black pixels are ignored, because black surroundings are no
    reason to brighten an object. Other pixels count as at least a thousandth of the median. An image is darkened
    only until its 99th percentile is white, so that a bright image stays bright. The stops are rounded to quarters,
    so that noise does not change them. They are 0 for a black image.

    radiance : (H, W, 3), W sr^-1 m^-2, linear Rec. 709

    >>> auto_exposure([[[0.09, 0.09, 0.09], [0, 0, 0]]]), auto_exposure([[[0.5, 0.5, 0.5]]])
    (1.0, 0.0)
    """
    y = luminance(np.asarray(radiance, np.float64))
    lit = y[y > 0.0]
    if not lit.size:
        return 0.0
    key = float(np.exp(np.mean(np.log(np.maximum(lit, 1e-3 * np.median(lit))))))
    white = max(float(np.percentile(y, 99)), 1e-300)  # the percentile is 0 if less than 1 % of the pixels are lit
    wanted, to_white = np.log2(MIDDLE_GREY / key), -np.log2(white)
    return float(np.round(4.0 * max(wanted, min(0.0, to_white))) / 4.0) + 0.0


def check_tonemap(operator: str) -> None:
    """Raise UsageError if there is no tone curve with that name."""
    if not isinstance(operator, str) or operator not in TONEMAPS:
        raise UsageError(f"tonemap: there is no operator {short_repr(operator)}. Allowed: {', '.join(TONEMAPS)}.")
