"""Reflectance of a surface with a thin film on it: interference of light from its two sides, in linear Rec. 709.

`film_reflects` in shaders/bsdf/iridescence.glsl is the GPU version. This version is for solvers, which treat all
surfaces as diffuse.

Source: Belcour & Barla 2017, A practical extension to microfacet theory for the modeling of varying iridescence;
with Schlick's Fresnel on both sides and two orders of interference, as in Khronos' sample renderer
[KHR_materials_iridescence].
"""

from __future__ import annotations

import numpy as np

from glpath.scene.geometry import Float64

# Gaussians that approximate the eye's sensitivities X, Y and Z as functions of the wave number: weight, centre and
# variance. X is the sum of two Gaussians; `_SECOND` is the other one.
_VALUE = np.array([5.4856e-13, 4.4201e-13, 5.2481e-13])
_CENTRE = np.array([1.6810e6, 1.7953e6, 2.2084e6])
_VARIANCE = np.array([4.3278e9, 9.3046e9, 6.6121e9])
_SECOND = (9.7470e-14, 2.2399e6, 4.5282e9)
_WHOLE = 1.0685e-7
_REC709 = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)


def film_reflects(cosine: Float64, thickness: float, ior: float, f0: Float64) -> Float64:
    """Return the (n, 3) reflectance in [0, 1] at cosines (n,) to the normal.

    thickness : thickness of the film in nm
    ior       : index of refraction of the film
    f0        : (3,) reflectance in air, at normal incidence, of the surface below the film
    """
    cosine = cosine[:, None]
    t = np.clip(thickness / 0.03, 0.0, 1.0)
    index = 1.0 + (ior - 1.0) * t * t * (3.0 - 2.0 * t)
    inside = np.sqrt(np.maximum(1.0 - (1.0 - cosine**2) / index**2, 0.0))
    R12 = _schlick(((index - 1.0) / (index + 1.0)) ** 2, cosine)
    root = np.sqrt(np.clip(f0, 0.0, 0.9999))
    base = (1.0 + root) / (1.0 - root)
    R23 = _schlick(((base - index) / (base + index)) ** 2, inside)
    phase = np.pi + np.where(base < index, np.pi, 0.0)
    r = np.clip(R12 * R23, 1e-5, 0.9999)
    Rs = (1.0 - R12) ** 2 * R23 / (1.0 - r)
    found, C = R12 + Rs, Rs - (1.0 - R12)
    for m in (1, 2):
        C = C * np.sqrt(r)
        found = found + C * 2.0 * _sensitivity(m * 2.0 * index * thickness * inside, m * phase)
    return np.asarray(np.clip(found, 0.0, 1.0))


def _schlick(f0: Float64 | float, cosine: Float64) -> Float64:
    return np.asarray(f0 + (1.0 - f0) * (1.0 - cosine) ** 5)


def _sensitivity(path: Float64, shift: Float64) -> Float64:
    phase = 2e-9 * np.pi * path
    xyz = (
        _VALUE * np.sqrt(2 * np.pi * _VARIANCE) * np.cos(_CENTRE * phase + shift) * np.exp(-(phase**2) * _VARIANCE)
    )
    value, centre, variance = _SECOND
    x = (
        value
        * np.sqrt(2 * np.pi * variance)
        * np.cos(centre * phase + shift[..., :1])
        * np.exp(-(phase**2) * variance)
    )
    xyz = xyz + np.concatenate([x, np.zeros((*x.shape[:-1], 2))], axis=-1)
    return np.asarray(xyz / _WHOLE @ _REC709.T)
