"""Round coordinates to whole steps, so that a scene has the same charts wherever it stands.

xatlas is chaotic: a difference in the last digit of one corner can lead to other charts, and to another page. A
scene moved by (500123.37, 31.7, 5412345.91) has such differences for two reasons. float64 has steps of 1e-9 there,
and the fractional parts of the offset change the rounding of every coordinate to 32 bits. Corners are therefore
counted in steps from the lowest corner. These steps are much coarser than those of float64, and exact in 32 bits.

Poor at:  scenes of about one unit with tens of thousands of irregular corners at UTM coordinates. A corner may lie
          so close to the middle between two steps that it is rounded to the other step there.
"""

from __future__ import annotations

import math

import numpy as np

from glpath.scene.model import Float64

#: Step as a fraction of the height of the narrowest triangle. Rounding changes the directions of that triangle by
#: no more than this.
_OF_NARROWEST = 2.0**-10
#: Smallest step as a fraction of the extent of all corners. The extent then has fewer than 2^24 steps, which are
#: exact in 32-bit floats.
_SMALLEST = 2.0**-20
#: Largest step as a fraction of the extent of all corners.
_LARGEST = 2.0**-16
#: Factor on sizes before they are rounded to a power of two, so that the result does not change at round numbers.
_ODD = 1.2345
#: Number of bits of the values that `rounded` returns.
_BITS = 16


def power_of_two(value: float) -> float:
    """Return a power of two near a positive value, and 1 for zero.

    Values that differ by rounding give the same power.
    """
    return 2.0 ** math.floor(math.log2(_ODD * value)) if value > 0 else 1.0


def rounded(value: float) -> float:
    """Return the value rounded to 16 significant bits."""
    mantissa, exponent = math.frexp(value)
    return math.ldexp(round(math.ldexp(mantissa, _BITS)), exponent - _BITS)


def points_in_steps(points: Float64) -> Float64:
    """Return points (N, 3) in whole steps from their lowest coordinates; a step is about 2^-16 of the extent."""
    low = points.min(axis=0)
    step = power_of_two(float((points.max(axis=0) - low).max())) * _LARGEST
    return np.asarray(np.rint((points - low) / step))


def corners_in_steps(corners: Float64) -> tuple[Float64, float]:
    """Return corners (T, 3, 3) in whole steps from their lowest coordinates, and the step, a power of two."""
    low = corners.min(axis=(0, 1))
    extent = float((corners.max(axis=(0, 1)) - low).max())
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    narrowest = float((doubled / np.maximum(longest, np.finfo(float).tiny)).min())
    step = power_of_two(min(max(narrowest * _OF_NARROWEST, extent * _SMALLEST), extent * _LARGEST))
    return np.asarray(np.rint((corners - low) / step)), step
