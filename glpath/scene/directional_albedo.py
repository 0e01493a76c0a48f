"""Directional albedo E of rough surfaces whose microfacets scatter light once.

The remaining fraction 1 - E of the light hits another microfacet. If that light is kept
(`Material.multiple_scattering`), a lobe is divided by E for the direction to the eye. `see_along` in
shaders/scene/surface.glsl looks E up. A coloured surface multiplies light by its reflectance F at every further
scattering, so its lobe is multiplied by

    1 + F x / (1 - F (1 - x)) (1 - E) / E

where x is the fraction of light that leaves after a further scattering (`escapes`). The albedo of a dielectric is
f0 (E - B) + f90 B, where B is the albedo for Schlick's weight (`schlick_albedo`). Its base receives the rest.

Cost:    0.1 s for the table of an index, made once. A path vertex reads one texel, or two for a dielectric.
Poor at: anisotropy, for which the table has the mean roughness; grazing incidence on rough surfaces, because the
         added light has the shape of the single-scattering lobe. The result is not reciprocal.
Source:  Turquin 2019, Practical multiple scattering compensation for microfacet models, 3.1 and 3.4, with x = 1;
         Kulla & Conty 2017, with x the mean of E. A random walk between microfacets [Heitz et al. 2016] lies
         between the two; tests/pictures/test_kept_energy.py compares with it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from glpath.scene.geometry import Float64
from glpath.scene.slab import between_faces

#: Alpha below which a microfacet surface is treated as a perfectly smooth one.
SMOOTH = 1e-3
#: Number of table cells along the square root of the cosine, and along the roughness.
CELLS = 24
# Number of azimuths of the quadrature.
_AZIMUTHS = 16
# Number of heights of the quadrature.
_HEIGHTS = 32


@lru_cache(maxsize=64)
def directional_albedo(eta: float) -> Float64:
    """Return (CELLS + 1, CELLS + 1) float64 albedo in [0, 1] for roughness i / CELLS and cosine (j / CELLS)².

    eta : refractive index of the far side divided by that of the near side, for glass. 0 for white metal. Also 0
          for thin glass, which sends to both sides together what metal sends to one side
    """
    steps = np.arange(CELLS + 1) / CELLS
    cosine = np.maximum(steps**2, 1e-4)
    return np.stack([_scattered_once(cosine, float(max(r, 1e-3) ** 2), eta) for r in steps])


@lru_cache(maxsize=1)
def schlick_albedo() -> Float64:
    """Return a table like `directional_albedo` for microfacets of reflectance (1 - cosine)^5, Schlick's weight."""
    steps = np.arange(CELLS + 1) / CELLS
    cosine = np.maximum(steps**2, 1e-4)
    return np.stack([_scattered_once(cosine, float(max(r, 1e-3) ** 2), 0.0, schlick=True) for r in steps])


@lru_cache(maxsize=1)
def escapes() -> Float64:
    """Return the approximate fraction of light that leaves rough metal after a further scattering.

    The result has the (5,) float64 coefficients of a polynomial in the roughness, constant first. It is fitted to
    the cosine-weighted hemispherical mean of E, to the power 0.6. That lies between the values x of the two
    sources, and gives results closest to the random walk.
    """
    steps, mean = np.arange(CELLS + 1) / CELLS, _over_the_cosine(directional_albedo(0.0))
    fitted = np.polynomial.Polynomial.fit(steps, mean**0.6, 4, domain=[0, 1], window=[0, 1])
    return np.asarray(fitted.coef, np.float64)


def hemispherical_albedo(f0: Float64, f90: float, roughness: float, kept: bool) -> Float64:
    """Return the (3,) float64 fraction of uniform illumination that microfacets reflect in all directions.

    f0, f90 : reflectance at normal (3,) and at grazing incidence
    kept    : True to include light that is scattered more than once
    """
    steps = np.arange(CELLS + 1) / CELLS
    whole, grazing = (
        float(np.interp(roughness, steps, _over_the_cosine(table)))
        for table in (directional_albedo(0.0), schlick_albedo())
    )
    once = f0 * (whole - grazing) + f90 * grazing
    if not kept:
        return np.asarray(once)
    F, left = f0 + (f90 - f0) / 21.0, float(np.polynomial.polynomial.polyval(min(roughness, 1.0), escapes()))
    return np.asarray(once * (1.0 + (1.0 / whole - 1.0) * F * left / (1.0 - F * (1.0 - left))))


def _over_the_cosine(table: Float64) -> Float64:
    """Return the (CELLS + 1,) float64 cosine-weighted hemispherical mean of a table for each roughness."""
    cosine = (np.arange(CELLS + 1) / CELLS) ** 2
    sent = 2.0 * cosine * table
    return np.asarray((0.5 * (sent[:, 1:] + sent[:, :-1]) * np.diff(cosine)).sum(axis=1))


def _scattered_once(cosine: Float64, alpha: float, eta: float, schlick: bool = False) -> Float64:
    """Return the single-scattering albedo (n,) at cosines (n,) of the direction to the eye.

    It is integrated by the midpoint rule over visible normals [Dupuy & Benyoub 2023].
    """
    weight, z, o, mz = _ggx_normals(cosine, alpha)
    reflected = _seen(2.0 * o * mz - z, alpha)
    if schlick:
        reflected = reflected * np.clip(1.0 - o, 0.0, 1.0) ** 5
    if eta == 0:
        return np.asarray((weight * reflected).mean(axis=(1, 2)))
    F, far = _fresnel(o, eta)
    through = _seen(-((o / eta - far) * mz - z / eta), alpha)
    return np.asarray((weight * (F * reflected + (1.0 - F) * through)).mean(axis=(1, 2)))


def _fresnel(o: Float64, eta: float) -> tuple[Float64, Float64]:
    """Return the Fresnel reflectance at a cosine `o`, and the cosine on the far side."""
    sine2 = (1.0 - o * o) / (eta * eta)
    far = np.sqrt(np.clip(1.0 - sine2, 0.0, 1.0))
    across, along = (o - eta * far) / (o + eta * far), (eta * o - far) / (eta * o + far)
    return np.where(sine2 < 1.0, 0.5 * (across**2 + along**2), 1.0), far


def _ggx_normals(cosine: Float64, alpha: float) -> tuple[Float64, Float64, Float64, Float64]:
    """Return sample normals of the visible GGX distribution, for views at cosines (n,).

    Returns the samples' weights, the view cosines (n, 1, 1), the cosines between view and normals, and the normals'
    z.
    """
    phi = np.pi * (np.arange(_AZIMUTHS)[:, None] + 0.5) / _AZIMUTHS
    # Points are denser towards the most inclined normals, which are few and send light below the surface.
    left = 1.0 - (np.arange(_HEIGHTS)[None, :] + 0.5) / _HEIGHTS
    v, weight = 1.0 - left * left, 2.0 * left
    z = cosine[:, None, None]
    x = np.sqrt(1.0 - z * z)
    stretched = np.sqrt((alpha * x) ** 2 + z * z)
    sx, sz = alpha * x / stretched, z / stretched
    cap = (1.0 - v) * (1.0 + sz) - sz
    r = np.sqrt(np.clip(1.0 - cap * cap, 0.0, 1.0))
    mx, my, mz = alpha * (r * np.cos(phi) + sx), alpha * r * np.sin(phi), np.maximum(cap + sz, 1e-9)
    length = np.sqrt(mx * mx + my * my + mz * mz)
    mx, mz = mx / length, mz / length
    return weight, z, x * mx + z * mz, mz


def _beckmann_normals(cosine: Float64, alpha: float) -> tuple[Float64, Float64, Float64, Float64]:
    """Return the values of `_ggx_normals` for Beckmann's distribution: all slopes, weighted by their visibility."""
    phi = np.pi * (np.arange(_AZIMUTHS)[:, None] + 0.5) / _AZIMUTHS
    slope = alpha * np.sqrt(-np.log(1.0 - (np.arange(4 * _HEIGHTS)[None, :] + 0.5) / (4 * _HEIGHTS)))
    z = cosine[:, None, None]
    mz = 1.0 / np.sqrt(1.0 + slope * slope)
    o = np.maximum(mz * (z - np.sqrt(1.0 - z * z) * slope * np.cos(phi)), 0.0)
    visible = o / mz
    return visible / visible.mean(axis=(1, 2), keepdims=True), z, o, np.broadcast_to(mz, o.shape)


@lru_cache(maxsize=64)
def boundary_reflectance(ior: float, has_two_faces: bool) -> tuple[float, float]:
    """Return the reflectance of a smooth boundary at normal incidence and for uniform illumination.

    has_two_faces : True for a thin sheet, with the reflections between its two faces
    """
    u, weight = np.polynomial.legendre.leggauss(64)
    cosine = np.append((u + 1.0) / 2.0, 1.0)
    reflected = _fresnel(cosine, ior)[0]
    if has_two_faces:
        reflected = between_faces(reflected)
    return float(reflected[-1]), float((weight * cosine[:-1] * reflected[:-1]).sum())


@lru_cache(maxsize=64)
def burley_albedo(roughness: float) -> float:
    """Return the fraction of uniform illumination that Burley's white base reflects [Burley 2012, 5.3].

    It is the cosine-weighted mean of `disney_base` in shaders/bsdf/bsdf.glsl over incident and outgoing directions.
    """
    u, weight = np.polynomial.legendre.leggauss(16)
    cosine = (u + 1.0) / 2.0
    o, i = cosine[:, None], cosine[None, :]
    Fo, Fi = (1.0 - o) ** 5, (1.0 - i) ** 5
    # Means of R = 2 roughness cos^2, and of R^2, over the azimuth between the two directions.
    R = roughness * (1.0 + o * i)
    R2 = roughness**2 * ((1.0 + o * i) ** 2 + 0.5 * (1.0 - o * o) * (1.0 - i * i))
    base = (1.0 - 0.5 * Fo) * (1.0 - 0.5 * Fi) + R * (Fo + Fi - Fo * Fi) + R2 * Fo * Fi
    return float((weight * cosine) @ base @ (weight * cosine))


@lru_cache(maxsize=64)
def plastic_entry(ior: float, alpha: float, distribution: str) -> tuple[Float64, float]:
    """Return a polynomial for light that enters a rough boundary over a diffuse base, and its mean.

    The first result has the (8,) float64 coefficients of a polynomial in the square root of the cosine, constant
    first. Its value is the fraction of light that crosses the boundary to the base, times a constant. The second
    result is its mean over uniform illumination. Light crosses the boundary inwards and outwards, so a Lambertian
    base is multiplied by the polynomial at both cosines. The constant accounts for light that the boundary reflects
    back to a white base. For another base, that light is part of the base's reflectance.

    ior          : index of the dielectric
    alpha        : alpha of its microfacets
    distribution : "ggx" or "beckmann"

    Source: Mitsuba 3.9, plastic and roughplastic. A rough boundary loses light that it scatters more than once.
            The fraction reflected back is Mitsuba's mean of 64 cosines, both ends included, up to 2 % too large.
    """
    cosine = (np.arange(128) + 0.5) / 128
    through = 1.0 - _fresnel(cosine, ior)[0] if alpha < SMOOTH else _crossing(cosine, alpha, ior, distribution)[0]
    entry = through / (ior * np.sqrt(1.0 - internal_reflectance(ior, alpha, distribution)))
    powers = np.vander(np.sqrt(cosine), 8, increasing=True)
    fit = np.linalg.lstsq(powers, entry, rcond=None)[0]
    return np.asarray(fit), float(2.0 * np.mean(cosine * entry))


@lru_cache(maxsize=64)
def internal_reflectance(ior: float, alpha: float, distribution: str) -> float:
    """Return the fraction of diffuse light inside a dielectric that its boundary reflects; see `plastic_entry`."""
    if alpha < SMOOTH:
        cosine = (np.arange(4096) + 0.5) / 4096
        back = _fresnel(cosine, 1.0 / ior)[0]
    else:
        cosine = np.maximum(np.arange(64) / 63, 1e-6)
        back = _crossing(cosine, alpha, 1.0 / ior, distribution)[1]
    return float(2.0 * np.mean(cosine * back))


def _crossing(cosine: Float64, alpha: float, eta: float, distribution: str) -> tuple[Float64, Float64]:
    """Return the transmittance and reflectance of a rough boundary at a cosine, for single scattering."""
    seen = _seen if distribution == "ggx" else _beckmann_seen
    weight, z, o, mz = (_ggx_normals if distribution == "ggx" else _beckmann_normals)(cosine, alpha)
    F, far = _fresnel(np.maximum(o, 1e-9), eta)
    through = (1.0 - F) * seen(-((o / eta - far) * mz - z / eta), alpha)
    back = F * seen(2.0 * o * mz - z, alpha)
    return (weight * through).mean(axis=(1, 2)), (weight * back).mean(axis=(1, 2))


def _seen(z: Float64, alpha: float) -> Float64:
    """Return Smith's masking of GGX microfacets in directions at a cosine z; 0 below the surface."""
    z = np.clip(z, 0.0, 1.0)
    return np.asarray(2.0 * z / np.maximum(z + np.sqrt(z * z + alpha * alpha * (1.0 - z * z)), 1e-12))


def _beckmann_seen(z: Float64, alpha: float) -> Float64:
    """Return the masking of Beckmann's microfacets [Walter et al. 2007, eq. 27]."""
    z = np.clip(z, 0.0, 1.0)
    a = z / np.maximum(alpha * np.sqrt(1.0 - z * z), 1e-12)
    return np.where(a < 1.6, a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a)), 1.0)


def cells(table: Float64) -> Float64:
    """Return the (CELLS², 4) values at cell corners: two cosines at the lower, then at the upper roughness."""
    corners = [table[:-1, :-1], table[:-1, 1:], table[1:, :-1], table[1:, 1:]]
    return np.stack(corners, axis=2).reshape(-1, 4)
