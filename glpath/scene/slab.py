"""Sheet of glass with two faces and all reflections between them.

Light that enters the sheet is reflected repeatedly at both faces, and the glass absorbs a fraction at each
crossing. The beams do not interfere, because a sheet is thicker than the coherence length of light.

Source:   Hecht 2017, Optics, 4.6 and 9.6.1; Ward, Radiance: the material glass, which has the same formula.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

#: Index of refraction of window glass, as in Radiance.
GLAZING_IOR = 1.52


def slab(cosine: ArrayLike, ior: float, inside: ArrayLike) -> tuple[Float64, Float64]:
    """Return the reflectance and transmittance of a sheet. `shaders/bsdf/slab.glsl` is the GPU version.

    Shapes are broadcast.

    cosine : cosine of the angle to the normal, in air
    inside : transmittance of the glass for one perpendicular crossing, in [0, 1]
    """
    cosine = np.maximum(cosine, 1e-4)
    within = np.sqrt(1 - (1 - cosine**2) / ior**2)
    once = np.asarray(inside, np.float64) ** (1 / within)
    reflected, passed = np.zeros_like(once), np.zeros_like(once)
    for r in ((cosine - ior * within) / (cosine + ior * within), (ior * cosine - within) / (ior * cosine + within)):
        f = r * r  # reflectance of one polarization
        between = 1 / np.maximum(1 - (f * once) ** 2, 1e-12)
        passed += 0.5 * (1 - f) ** 2 * once * between
        reflected += 0.5 * f * (1 + (1 - 2 * f) * once**2) * between
    return reflected, passed


def clearest(ior: float) -> float:
    """Return the transmittance at normal incidence of a sheet whose glass absorbs nothing."""
    return float(1 - between_faces(((ior - 1) / (ior + 1)) ** 2))


def between_faces(reflectance: ArrayLike) -> Float64:
    """Return the reflectance of a clear sheet from that of one face, ignoring polarization."""
    f = np.asarray(reflectance, np.float64)
    return np.asarray(2 * f / (1 + f))


def inside_of(transmittance: ArrayLike, ior: float) -> Float64:
    """Return the transmittance of the glass for one crossing, from that of the sheet at normal incidence.

    transmittance : transmittance of the sheet, at most `clearest`
    """
    f = ((ior - 1) / (ior + 1)) ** 2
    passed = np.asarray(transmittance, np.float64)
    # Root of f^2 T t^2 + (1 - f)^2 t - T = 0 in a form without cancellation.
    return np.asarray(2 * passed / ((1 - f) ** 2 + np.sqrt((1 - f) ** 4 + (2 * f * passed) ** 2)))


def hemispherical(ior: float, inside: ArrayLike) -> tuple[Float64, Float64]:
    """Return the (3,) reflectance and the (3,) transmittance for uniform illumination.

    inside : (3,) transmittance of the glass for one perpendicular crossing
    """
    u, weight = np.polynomial.legendre.leggauss(64)
    cosine = ((u + 1) / 2)[:, None]
    reflected, passed = slab(cosine, ior, inside)
    return tuple((weight[:, None] * cosine * x).sum(axis=0) for x in (reflected, passed))
