"""Colours of linear Rec. 709: luminance, the sRGB curve, and conversion from other primaries.

Sources: IEC 61966-2-1 (sRGB).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import ImageError, UsageError
from glpath.system.arguments import checked, short_repr

__all__ = ["decode_srgb", "encode_srgb", "luminance"]

Float64 = NDArray[np.float64]

# Weights of red, green and blue of linear Rec. 709 in the luminance Y.
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


# Primaries and white point (D65) of Rec. 709 for an EXR header: x and y of red, green, blue and white.
REC709_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


# Chromaticities (x or y) that differ by less than this count as equal, because other programs round them.
_SAME_CHROMATICITY = 1e-3


# Bradford's matrix from XYZ to cone responses.
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


@checked
def luminance(radiance: Float64) -> Float64:
    """Return the relative luminance Y (...) of linear Rec. 709 colours (..., 3). Raises ImageError."""
    check_colours(radiance)
    y: Float64 = radiance @ LUMINANCE
    return y


def check_colours(colours: ArrayLike) -> None:
    """Raise ImageError unless the last axis of an array is red, green and blue."""
    if np.shape(colours)[-1:] != (3,):
        raise ImageError(
            f"image: found an array of shape {np.shape(colours)}, expected (..., 3): red, green and blue.",
            "np.repeat(grey[..., None], 3, axis=-1) makes colours of grey values.",
        )


def _numbers(values: ArrayLike) -> NDArray[Any]:
    """Return an array; objects become float64, and other types do not change."""
    array = np.asarray(values)
    return array.astype(np.float64) if array.dtype == np.object_ else array


@checked
def encode_srgb(linear: Float64) -> Float64:
    """Return linear values, clipped to [0, 1], as sRGB in [0, 1] (IEC 61966-2-1)."""
    x: Float64 = np.clip(_numbers(linear), 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


@checked
def decode_srgb(encoded: Float64) -> Float64:
    """Return sRGB in [0, 1] as linear values in [0, 1]."""
    encoded = _numbers(encoded)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def decode_levels(levels: NDArray[np.uint8]) -> Float64:
    """Return 8-bit sRGB as linear values in [0, 1], from a table; bit-identical to `decode_srgb(levels / 255)`."""
    return _of_levels()[levels]


@cache
def _of_levels() -> Float64:
    return decode_srgb(np.arange(256) / 255)


def check_exposure(exposure: object) -> None:
    """Raise UsageError unless the exposure is None, "auto", or a number of stops from -100 to 100."""
    if exposure is None or exposure == "auto":
        return
    if isinstance(exposure, bool) or not isinstance(exposure, int | float) or not abs(exposure) <= 100:
        raise UsageError(
            f'exposure is {short_repr(exposure)}; must be a number of stops from -100 to 100, or "auto".'
        )


def matrix_to_rec709(chromaticities: ArrayLike) -> Float64 | None:
    """Return the matrix of `_rec709_from`; None if the primaries are those of Rec. 709."""
    given = np.array(chromaticities, np.float64)
    if np.allclose(given, REC709_CHROMATICITIES, rtol=0.0, atol=_SAME_CHROMATICITY):
        return None
    return _rec709_from(given)


def _rec709_from(chromaticities: Float64) -> Float64:
    """Return the (3, 3) matrix from RGB with other primaries to linear Rec. 709.

    The matrix maps the white of the other primaries to D65. Raises ValueError if the matrix is not finite.

    chromaticities : (8,) x and y of red, green, blue and white of the other primaries

    Sources: SMPTE RP 177-1993 (XYZ from RGB); Lam 1985, the Bradford adaptation, as of ICC.1:2022, annex E.
    """
    try:
        cone = [_BRADFORD @ _xyz_from_rgb(each) for each in (chromaticities, np.array(REC709_CHROMATICITIES))]
        theirs, ours = (each.sum(axis=1) for each in cone)  # cone responses of the two white points
        matrix = np.linalg.solve(cone[1], (ours / theirs)[:, None] * cone[0])
    except np.linalg.LinAlgError:
        matrix = np.full((3, 3), np.nan)
    if not np.isfinite(matrix).all():
        raise ValueError(f"its chromaticities {chromaticities.round(4).tolist()} are not those of colours")
    return matrix


def _xyz_from_rgb(chromaticities: Float64) -> Float64:
    x, y = chromaticities.reshape(4, 2).T
    xyz = np.stack([x, y, 1.0 - x - y])
    with np.errstate(divide="ignore", invalid="ignore"):
        return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3] / y[3])
