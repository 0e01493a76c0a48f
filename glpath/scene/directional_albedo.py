"""What rough surfaces send back of light from everywhere when their microfacets scatter it once.

The rest is light that meets another microfacet. Where it is kept (`Material.multiple_scattering`), the lobes are
divided by this albedo E of the direction to the eye, which `see_along` in shaders/scene/surface.glsl looks up. Of a
colour, every further scattering takes its share F: a lobe's factor is 1 + F x / (1 - F (1 - x)) (1 - E) / E, with x
the share of the light that leaves after a further scattering (`escapes`). For a dielectric E is f0 (E - B) + f90 B,
with B of Schlick's weight (`schlick_albedo`); its base has what that leaves.

Cost:    0.1 s a table of an index, made once; read by one texel a vertex, by two of a dielectric.
Poor at: anisotropy, of which the table has the mean roughness; rough light at grazing incidence, as what is added
         has the lobe of what is there. It is not reciprocal.
Source:  Turquin 2019, Practical multiple scattering compensation for microfacet models, 3.1 and 3.4, whose x is 1;
         Kulla & Conty 2017, whose x is the mean of E. Light that walks from microfacet to microfacet [Heitz et
         al. 2016] is between: tests/pictures/test_kept_energy.py has it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from glpath.scene.geometry import Float64
from glpath.scene.slab import between_faces

#: Alpha below which microfacets are a mirror.
SMOOTH = 1e-3
#: Cells of a table along the root of the cosine and along the roughness.
CELLS = 24
_AZIMUTHS, _HEIGHTS = 16, 32  # points of the quadrature


@lru_cache(maxsize=64)
def directional_albedo(eta: float) -> Float64:
    """(CELLS + 1, CELLS + 1) float64 in [0, 1]: of roughness i / CELLS and of the cosine (j / CELLS)².

    eta : of glass, the index of the far side over that of the near one; 0 of white metal, and of thin glass, which
          sends light to both sides as metal sends it to one
    """
    steps = np.arange(CELLS + 1) / CELLS
    cosine = np.maximum(steps**2, 1e-4)
    return np.stack([_scattered_once(cosine, float(max(r, 1e-3) ** 2), eta) for r in steps])


@lru_cache(maxsize=1)
def schlick_albedo() -> Float64:
    """(CELLS + 1, CELLS + 1) float64 in [0, 1]: the same of what reflects (1 - cosine to the microfacet)^5."""
    steps = np.arange(CELLS + 1) / CELLS
    cosine = np.maximum(steps**2, 1e-4)
    return np.stack([_scattered_once(cosine, float(max(r, 1e-3) ** 2), 0.0, schlick=True) for r in steps])


@lru_cache(maxsize=1)
def escapes() -> Float64:
    """(5,) float64, from the constant on: a polynomial of the roughness, the share of light that leaves rough metal
    after a further scattering, about.

    The mean of E over the cosine to the power 0.6, which is between the two sources' and nearest to the walk.
    """
    steps, mean = np.arange(CELLS + 1) / CELLS, _over_the_cosine(directional_albedo(0.0))
    fitted = np.polynomial.Polynomial.fit(steps, mean**0.6, 4, domain=[0, 1], window=[0, 1])
    return np.asarray(fitted.coef, np.float64)


def hemispherical_albedo(f0: Float64, f90: float, roughness: float, kept: bool) -> Float64:
    """(3,) float64: of light from everywhere, what microfacets reflect of it all around.

    f0, f90 : what they reflect at normal (3,) and at grazing incidence
    kept    : with what they scatter more than once
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
    """(CELLS + 1,) float64: the mean over the directions of light, by the cosine, for each roughness."""
    cosine = (np.arange(CELLS + 1) / CELLS) ** 2
    sent = 2.0 * cosine * table
    return np.asarray((0.5 * (sent[:, 1:] + sent[:, :-1]) * np.diff(cosine)).sum(axis=1))


def _scattered_once(cosine: Float64, alpha: float, eta: float, schlick: bool = False) -> Float64:
    """(n,) of (n,), by the midpoint rule over the normals that are seen [Dupuy & Benyoub 2023]."""
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
    """Return what a boundary reflects at a cosine `o`, and the cosine on the far side."""
    sine2 = (1.0 - o * o) / (eta * eta)
    far = np.sqrt(np.clip(1.0 - sine2, 0.0, 1.0))
    across, along = (o - eta * far) / (o + eta * far), (eta * o - far) / (eta * o + far)
    return np.where(sine2 < 1.0, 0.5 * (across**2 + along**2), 1.0), far


def _ggx_normals(cosine: Float64, alpha: float) -> tuple[Float64, Float64, Float64, Float64]:
    """Return visible normals of GGX's distribution: weights, cosines (n, 1, 1), cosines to the normals, their z."""
    phi = np.pi * (np.arange(_AZIMUTHS)[:, None] + 0.5) / _AZIMUTHS
    # Denser towards the normals that lean most: they are few, and send light below the surface.
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
    """Return the same of Beckmann's distribution: normals of all slopes, weighted by how far they are visible."""
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
    """Return a polynomial of the cosine's root, (8,) float64 from the constant on, and its mean over all light.

    It is the share of light that crosses a rough boundary to the diffuse base under it, times a constant. Light of
    the base crosses twice, so that a Lambertian base is multiplied by it at both cosines. The constant has light
    that the boundary reflects back to the base; that of a base that is not white is in the base's reflectance.

    ior : of the dielectric; alpha : of its microfacets, `distribution` "ggx" or "beckmann"

    Source: Mitsuba 3.9, plastic and roughplastic. A rough boundary loses what it scatters more than once, and light
            that it reflects back is Mitsuba's mean of 64 cosines, both ends included, up to 2 % too much.
    """
    cosine = (np.arange(128) + 0.5) / 128
    through = 1.0 - _fresnel(cosine, ior)[0] if alpha < SMOOTH else _crossing(cosine, alpha, ior, distribution)[0]
    entry = through / (ior * np.sqrt(1.0 - internal_reflectance(ior, alpha, distribution)))
    powers = np.vander(np.sqrt(cosine), 8, increasing=True)
    fit = np.linalg.lstsq(powers, entry, rcond=None)[0]
    return np.asarray(fit), float(2.0 * np.mean(cosine * entry))


@lru_cache(maxsize=64)
def internal_reflectance(ior: float, alpha: float, distribution: str) -> float:
    """Return the share of diffuse light inside a dielectric that its boundary reflects; see `plastic_entry`."""
    if alpha < SMOOTH:
        cosine = (np.arange(4096) + 0.5) / 4096
        back = _fresnel(cosine, 1.0 / ior)[0]
    else:
        cosine = np.maximum(np.arange(64) / 63, 1e-6)
        back = _crossing(cosine, alpha, 1.0 / ior, distribution)[1]
    return float(2.0 * np.mean(cosine * back))


def _crossing(cosine: Float64, alpha: float, eta: float, distribution: str) -> tuple[Float64, Float64]:
    """Return what a rough boundary lets through and what it reflects, of light at a cosine, each once."""
    seen = _seen if distribution == "ggx" else _beckmann_seen
    weight, z, o, mz = (_ggx_normals if distribution == "ggx" else _beckmann_normals)(cosine, alpha)
    F, far = _fresnel(np.maximum(o, 1e-9), eta)
    through = (1.0 - F) * seen(-((o / eta - far) * mz - z / eta), alpha)
    back = F * seen(2.0 * o * mz - z, alpha)
    return (weight * through).mean(axis=(1, 2)), (weight * back).mean(axis=(1, 2))


def _seen(z: Float64, alpha: float) -> Float64:
    """Smith's masking of directions at a cosine z; 0 below the surface."""
    z = np.clip(z, 0.0, 1.0)
    return np.asarray(2.0 * z / np.maximum(z + np.sqrt(z * z + alpha * alpha * (1.0 - z * z)), 1e-12))


def _beckmann_seen(z: Float64, alpha: float) -> Float64:
    """Return the masking of Beckmann's microfacets [Walter et al. 2007, eq. 27]."""
    z = np.clip(z, 0.0, 1.0)
    a = z / np.maximum(alpha * np.sqrt(1.0 - z * z), 1e-12)
    return np.where(a < 1.6, a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a)), 1.0)


def cells(table: Float64) -> Float64:
    """(CELLS², 4): each cell's corners: this roughness and cosine, the next cosine; of the next roughness both."""
    corners = [table[:-1, :-1], table[:-1, 1:], table[1:, :-1], table[1:, 1:]]
    return np.stack(corners, axis=2).reshape(-1, 4)
