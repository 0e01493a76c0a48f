"""Numbers in whole steps, so that the charts of a scene are the same wherever it stands.

xatlas is chaotic: a difference in the last digit of one corner can make other charts, and another page. A scene
that was moved by (500123.37, 31.7, 5412345.91) has such differences twice: float64 has steps of 1e-9 there, and the
fractions of the offset make every coordinate round otherwise to 32 bits. So corners are counted in steps from the
least of them, which are far coarser than the former and exact in 32 bits.

Poor at:  scenes of about a unit with ten thousands of irregular corners at UTM coordinates: one of them may lie so
          near the middle between two steps that it gets the other one there.
"""

from __future__ import annotations

import math

import numpy as np

from glpath.scene.model import Float64

#: A step in heights of the narrowest triangle, whose directions it changes by no more than that; and the least and
#: the largest one, in extents of all. Of the least there are fewer than 2^24, as many as 32 bits have.
_OF_NARROWEST, _SMALLEST, _LARGEST = 2.0**-10, 2.0**-20, 2.0**-16
#: Sizes change from one power of two to the next at those divided by this, where no round number is.
_ODD = 1.2345
#: Bits of what `rounded` returns.
_BITS = 16


def power_of_two(value: float) -> float:
    """The one that is about a positive value, and 1 for zero; the same for values that differ by rounding."""
    return 2.0 ** math.floor(math.log2(_ODD * value)) if value > 0 else 1.0


def rounded(value: float) -> float:
    """To 16 bits."""
    mantissa, exponent = math.frexp(value)
    return math.ldexp(round(math.ldexp(mantissa, _BITS)), exponent - _BITS)


def points_in_steps(points: Float64) -> Float64:
    """Points (N, 3) in whole steps from their least coordinates, some 2^-16 of their extent."""
    low = points.min(axis=0)
    step = power_of_two(float((points.max(axis=0) - low).max())) * _LARGEST
    return np.asarray(np.rint((points - low) / step))


def corners_in_steps(corners: Float64) -> tuple[Float64, float]:
    """Corners of triangles (T, 3, 3) in whole steps from their least coordinates; and the step, a power of two."""
    low = corners.min(axis=(0, 1))
    extent = float((corners.max(axis=(0, 1)) - low).max())
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    narrowest = float((doubled / np.maximum(longest, np.finfo(float).tiny)).min())
    step = power_of_two(min(max(narrowest * _OF_NARROWEST, extent * _SMALLEST), extent * _LARGEST))
    return np.asarray(np.rint((corners - low) / step)), step
