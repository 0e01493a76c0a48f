"""The sixteen skies of cases 5.9 to 5.14: fifteen of ISO 15469, and 16, the traditional overcast sky.

All give open ground the same irradiance, so the irradiance in a room, in per cent of it, is the sky component. The
sun stands at 60 degrees; its direct light is no part of the cases.

Source: ISO 15469:2004 (CIE S 011), implemented here from its equations to check `glpath.sky.cie`; Moon &
        Spencer 1942, Illumination from a nonuniform sky.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss

from benchmarks.cie171.exact import Float64, Radiance

SKIES = tuple(range(1, 17))
#: Sine and cosine of the sun's elevation.
SUN = (np.sin(np.radians(60.0)), np.cos(np.radians(60.0)))

# Table 1 of the standard: six gradations (a, b), six indicatrices (c, d, e), and the pair of each sky.
_GRADATION = ((4.0, -0.70), (1.1, -0.80), (0.0, -1.0), (-1.0, -0.55), (-1.0, -0.32), (-1.0, -0.15))
_INDICATRIX = (
    (0.0, -1.0, 0.0),
    (2.0, -1.5, 0.15),
    (5.0, -2.5, 0.30),
    (10.0, -3.0, 0.45),
    (16.0, -3.0, 0.30),
    (24.0, -2.8, 0.15),
)
_GROUPS = ("11", "12", "21", "22", "31", "32", "33", "34", "42", "43", "44", "54", "55", "65", "66")


def relative(sky: int, directions: Float64, sun: Float64) -> Float64:
    """Return (N,) luminance in directions (N, 3), z up, as the standard's phi(z) f(chi); 0 below the horizon."""
    z = directions[:, 2]
    above = z > 0
    if sky == 16:
        return np.where(above, (1 + 2 * z) / 3, 0.0)
    a, b = _GRADATION[int(_GROUPS[sky - 1][0]) - 1]
    c, d, e = _INDICATRIX[int(_GROUPS[sky - 1][1]) - 1]
    phi = 1 + a * np.exp(b / np.where(above, z, 1.0))
    # Compute the angle from its sine and cosine: an arccosine loses half of the digits near the sun.
    cosine = directions @ sun
    chi = np.arctan2(np.linalg.norm(np.cross(directions, sun), axis=1), cosine)
    f = 1 + c * (np.exp(d * chi) - np.exp(d * np.pi / 2)) + e * cosine**2
    return np.where(above, phi * f, 0.0)


@cache
def on_open_ground(sky: int) -> float:
    """Integrate `relative` to the irradiance of open ground, over the angle from the sun and around the sun."""
    sine, cosine = SUN
    sun = np.array([cosine, 0.0, sine])
    u, w = leggauss(400)
    # The horizon cuts circles around the sun from 60 to 120 degrees.
    edges = np.radians([0.0, 60.0, 90.0, 120.0])
    total = 0.0
    for low, high in pairwise(edges):
        for chi, weight in zip(low + (high - low) * (u + 1) / 2, w * (high - low) / 2, strict=True):
            # Height is sin h cos chi + cos h sin chi cos psi; psi is 0 straight above the sun.
            limit = -sine * np.cos(chi) / (cosine * np.sin(chi))
            widest = np.arccos(np.clip(limit, -1.0, 1.0))
            psi = widest * (u + 1) / 2
            z = sine * np.cos(chi) + cosine * np.sin(chi) * np.cos(psi)
            along = cosine * np.cos(chi) - sine * np.sin(chi) * np.cos(psi)
            directions = np.column_stack([along, np.sin(chi) * np.sin(psi), z])
            seen = relative(sky, directions, sun) * np.maximum(z, 0.0)
            total += weight * np.sin(chi) * widest * float(w @ seen)
    return total


def radiance(sky: int, sun: Float64) -> Radiance:
    """Return a function from directions (N, 3), z up, to radiance that gives open ground an irradiance of 100.

    sun : (3,) unit direction to the sun
    """
    scale = 100.0 / on_open_ground(sky)
    return lambda directions: scale * relative(sky, directions, sun)
