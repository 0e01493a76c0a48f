"""A sheet of glass between two faces, with all reflections between them.

Light that meets the sheet is reflected at both faces, again and again, and the glass takes its share of each
crossing. The beams do not interfere, as a sheet is thicker than light is coherent.

Source:   Hecht 2017, Optics, 4.6 and 9.6.1; Ward, Radiance: the material glass, which has the same formula.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

#: The index of refraction of window glass, as in Radiance.
GLAZING_IOR = 1.52


def slab(cosine: ArrayLike, ior: float, inside: ArrayLike) -> tuple[Float64, Float64]:
    """What a sheet reflects and what it lets through; shapes are broadcast. `shaders/bsdf/slab.glsl` is the same.

    cosine : of the angle to the normal, in air
    inside : what the glass lets through once, straight across, in [0, 1]
    """
    cosine = np.maximum(cosine, 1e-4)
    within = np.sqrt(1 - (1 - cosine**2) / ior**2)
    once = np.asarray(inside, np.float64) ** (1 / within)
    reflected, passed = np.zeros_like(once), np.zeros_like(once)
    for r in ((cosine - ior * within) / (cosine + ior * within), (ior * cosine - within) / (ior * cosine + within)):
        f = r * r  # of one polarization
        between = 1 / np.maximum(1 - (f * once) ** 2, 1e-12)
        passed += 0.5 * (1 - f) ** 2 * once * between
        reflected += 0.5 * f * (1 + (1 - 2 * f) * once**2) * between
    return reflected, passed


def clearest(ior: float) -> float:
    """What a sheet lets through at normal incidence whose glass takes nothing."""
    return float(1 - between_faces(((ior - 1) / (ior + 1)) ** 2))


def between_faces(reflectance: ArrayLike) -> Float64:
    """Return the reflectance of a clear sheet of which one face has a reflectance, without polarization."""
    f = np.asarray(reflectance, np.float64)
    return np.asarray(2 * f / (1 + f))


def inside_of(transmittance: ArrayLike, ior: float) -> Float64:
    """What the glass lets through once, of a transmittance at normal incidence, at most `clearest`."""
    f = ((ior - 1) / (ior + 1)) ** 2
    passed = np.asarray(transmittance, np.float64)
    # The root of f^2 T t^2 + (1 - f)^2 t - T = 0, in the form that cancels nothing.
    return np.asarray(2 * passed / ((1 - f) ** 2 + np.sqrt((1 - f) ** 4 + (2 * f * passed) ** 2)))


def hemispherical(ior: float, inside: ArrayLike) -> tuple[Float64, Float64]:
    """(3,) each: what is reflected, and what is let through, of light from everywhere. inside : (3,)."""
    u, weight = np.polynomial.legendre.leggauss(64)
    cosine = ((u + 1) / 2)[:, None]
    reflected, passed = slab(cosine, ior, inside)
    return tuple((weight[:, None] * cosine * x).sum(axis=0) for x in (reflected, passed))
