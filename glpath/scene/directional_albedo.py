"""Directional albedo E of rough surfaces whose microfacets scatter light once.

The rest of the light hits another microfacet. If it is kept (`Material.multiple_scattering`), the lobes are divided
by E of the direction to the eye, which `see_along` in shaders/scene/surface.glsl looks up. A coloured surface
multiplies light by F at every further scattering. The factor of a lobe is then

    1 + F x / (1 - F (1 - x)) (1 - E) / E

where x is the fraction of light that leaves after a further scattering (`escapes`). The albedo of a dielectric is
f0 (E - B) + f90 B, with B for Schlick's weight (`schlick_albedo`). Its base receives the rest.

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

#: Alpha below which a microfacet surface is a mirror.
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

    eta : index of the far side over that of the near side, for glass. 0 for white metal, and for thin glass, which
          sends to both sides what metal sends to one
    """
    steps = np.arange(CELLS + 1) / CELLS
    cosine = np.maximum(steps**2, 1e-4)
    return np.stack([_scattered_once(cosine, float(max(r, 1e-3) ** 2), eta) for r in steps])


@lru_cache(maxsize=1)
def schlick_albedo() -> Float64:
    """Return the table of `directional_albedo` for microfacets that reflect (1 - cosine)^5, as Schlick's weight."""
    steps = np.arange(CELLS + 1) / CELLS
    cosine = np.maximum(steps**2, 1e-4)
    return np.stack([_scattered_once(cosine, float(max(r, 1e-3) ** 2), 0.0, schlick=True) for r in steps])


@lru_cache(maxsize=1)
def escapes() -> Float64:
    """Return the approximate fraction of light that leaves rough metal after a further scattering.

    The result is a polynomial of the roughness, (5,) float64, constant first. It is the mean of E over the cosine,
    to the power 0.6. That lies between the two sources, nearest to the random walk.
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
    """Return the (CELLS + 1,) float64 cosine-weighted mean over directions of light, for each roughness."""
    cosine = (np.arange(CELLS + 1) / CELLS) ** 2
    sent = 2.0 * cosine * table
    return np.asarray((0.5 * (sent[:, 1:] + sent[:, :-1]) * np.diff(cosine)).sum(axis=1))


def _scattered_once(cosine: Float64, alpha: float, eta: float, schlick: bool = False) -> Float64:
    """Return the albedo (n,) at cosines (n,), by the midpoint rule over visible normals [Dupuy & Benyoub 2023]."""
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
    """Return visible GGX normals.

    These are the weights, the cosines of the view (n, 1, 1), the cosines between view and normals, and the normals'
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
    """Return the reflectance of a smooth boundary at normal incidence, and its mean over light from everywhere.

    has_two_faces : the boundary is a thin sheet, which reflects between its faces as well
    """
    u, weight = np.polynomial.legendre.leggauss(64)
    cosine = np.append((u + 1.0) / 2.0, 1.0)
    reflected = _fresnel(cosine, ior)[0]
    if has_two_faces:
        reflected = between_faces(reflected)
    return float(reflected[-1]), float((weight * cosine[:-1] * reflected[:-1]).sum())


@lru_cache(maxsize=64)
def burley_albedo(roughness: float) -> float:
    """Return the share of light from everywhere that Burley's white base reflects [Burley 2012, 5.3].

    It is the mean of `disney_base` in shaders/bsdf/bsdf.glsl over both directions.
    """
    u, weight = np.polynomial.legendre.leggauss(16)
    cosine = (u + 1.0) / 2.0
    o, i = cosine[:, None], cosine[None, :]
    Fo, Fi = (1.0 - o) ** 5, (1.0 - i) ** 5
    # The means of R = 2 roughness cos^2 and of its square over the azimuth between the directions.
    R = roughness * (1.0 + o * i)
    R2 = roughness**2 * ((1.0 + o * i) ** 2 + 0.5 * (1.0 - o * o) * (1.0 - i * i))
    base = (1.0 - 0.5 * Fo) * (1.0 - 0.5 * Fi) + R * (Fo + Fi - Fo * Fi) + R2 * Fo * Fi
    return float((weight * cosine) @ base @ (weight * cosine))


@lru_cache(maxsize=64)
def plastic_entry(ior: float, alpha: float, distribution: str) -> tuple[Float64, float]:
    """Return the entry polynomial of a diffuse base under a rough boundary, and its mean over diffuse light.

    The polynomial, (8,) float64 with the constant first, is of the square root of the cosine. It is the fraction of
    light that crosses the boundary to the base, times a constant. Light of the base crosses twice, so a Lambertian
    base is multiplied by the polynomial at both cosines. The constant includes light that the boundary reflects
    back to a white base. For another base, that light is in the base's reflectance.

    ior          : index of the dielectric
    alpha        : alpha of its microfacets
    distribution : "ggx" or "beckmann"

    Source: Mitsuba 3.9, plastic and roughplastic. A rough boundary loses light that it scatters more than once.
            Light that it reflects back is Mitsuba's mean of 64 cosines, both ends included, up to 2 % too much.
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
    """Return Smith's masking of directions at a cosine z; 0 below the surface."""
    z = np.clip(z, 0.0, 1.0)
    return np.asarray(2.0 * z / np.maximum(z + np.sqrt(z * z + alpha * alpha * (1.0 - z * z)), 1e-12))


def _beckmann_seen(z: Float64, alpha: float) -> Float64:
    """Return the masking of Beckmann's microfacets [Walter et al. 2007, eq. 27]."""
    z = np.clip(z, 0.0, 1.0)
    a = z / np.maximum(alpha * np.sqrt(1.0 - z * z), 1e-12)
    return np.where(a < 1.6, a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a)), 1.0)


def cells(table: Float64) -> Float64:
    """Return the (CELLS², 4) corners of cells: both cosines at this roughness, then both at the next one."""
    corners = [table[:-1, :-1], table[:-1, 1:], table[1:, :-1], table[1:, 1:]]
    return np.stack(corners, axis=2).reshape(-1, 4)
