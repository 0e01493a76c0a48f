"""Materials as texels for `bsdf_at` in shaders/scene/surface.glsl, and the shader variants that materials need.

Each field of `Material` that shaders read has its texel, number and variant here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, get_args

import numpy as np

from glpath.scene.directional_albedo import CELLS, cells, directional_albedo, plastic_entry, schlick_albedo
from glpath.scene.geometry import Float64
from glpath.scene.material import (
    CHARLIE_LAMBDA,
    SHEEN_CELLS,
    SHEEN_MIN_ALPHA,
    Layering,
    Material,
    sheen_albedo_fit,
    sheen_albedo_table,
    sheen_lambda,
)

#: Texels of a material, in order.
MATERIAL_LAYOUT = {
    "DIFFUSE": "reflectance, linear Rec. 709; 1 where the back reflects as well",
    "SPECULAR": "Phong's coefficient; Phong's exponent",
    "MIRROR": "share of the mirrored light",
    "SURFACE": "roughness, -1 for none; share of metal; anisotropy; angle of the tangent, radians",
    "LAYER": "what the dielectric reflects at normal incidence, not clipped before its texture; at grazing",
    "COAT": "share under clearcoat; its roughness",
    "GLASS": "share of the base that is glass; index of refraction; 1 for a solid; 1 for a thin dielectric",
    "INSIDE": "attenuation of a solid of glass, per scene unit",
    "SHEEN": "its colour; Charlie's alpha",
    "SHEEN_ALBEDO0": "the logarithm of white sheen's albedo, a polynomial of the cosine's root: powers 0 to 3",
    "SHEEN_ALBEDO1": "powers 4 to 7",
    "SHEEN_LAMBDA": "b, c, d, e of L(x) = a / (1 + b x^c) + d x + e, of Charlie's lambda",
    "SHEEN_LAMBDA_A": "a",
    "FILM": "share under a thin film; its thickness where its texture is 0, nm; where it is 1; its index",
    "THROUGH": "of what the diffuse base lets through the colour; the share",
    "FRESNEL": "index of Fresnel's equations; 1 for Beckmann's microfacets; number of the "
    "layering; mean of PLASTIC over light from everywhere",
    "PLASTIC0": "share of light that crosses to plastic's base, a polynomial of the cosine's root: powers 0 to 3",
    "PLASTIC1": "powers 4 to 7",
    "METAL_N": "index of metal, 0 for Schlick's formula",
    "METAL_K": "its imaginary part",
    "ENERGY": "1 where energy is kept; first cells of its glass's albedo, from outside and from inside",
}


class MaterialVariant(NamedTuple):
    """Shader variant that materials can need.

    meaning : condition for the variant
    asked_by : predicate that is True if a material needs the variant
    """

    meaning: str
    asked_by: Callable[[Material], bool]


def _rough(material: Material) -> bool:
    return material.roughness is not None


def _has_specular_glass(material: Material) -> bool:
    if material.transmission == 0 or material.thin or material.layering != "gltf":
        return False
    if material.specular_weight != 1 or np.any(material.specular_colour != 1):
        return True
    return material.specular_texture is not None or material.specular_colour_texture is not None


def _is_plastic(material: Material) -> bool:
    if material.layering != "plastic":
        return False
    has_dielectric = material.metallic < 1 or material.surface_texture is not None
    return has_dielectric and (material.transmission < 1 or material.transmission_texture is not None)


MATERIAL_VARIANTS = {
    "HAS_HIGHLIGHTS": MaterialVariant("a material has a Phong highlight", lambda m: bool(np.any(m.specular > 0))),
    "HAS_MIRRORS": MaterialVariant("a material is a mirror in part", lambda m: bool(np.any(m.mirror > 0))),
    "HAS_MICROFACETS": MaterialVariant("a material has a roughness", _rough),
    "HAS_ANISOTROPY": MaterialVariant("a rough material is anisotropic", lambda m: _rough(m) and m.anisotropy > 0),
    "HAS_SHEEN": MaterialVariant("a rough material has sheen", lambda m: _rough(m) and bool(np.any(m.sheen > 0))),
    "HAS_IRIDESCENCE": MaterialVariant(
        "a rough material is under a thin film", lambda m: _rough(m) and m.iridescence > 0
    ),
    "HAS_DIFFUSE_TRANSMISSION": MaterialVariant(
        "a rough material's diffuse base lets light through", lambda m: _rough(m) and m.diffuse_transmission > 0
    ),
    "HAS_MULTIPLE_SCATTERING": MaterialVariant(
        "a material keeps what its microfacets scatter more than once", lambda m: m.keeps_energy
    ),
    "HAS_COAT": MaterialVariant("a rough material has a clearcoat", lambda m: _rough(m) and m.clearcoat > 0),
    "HAS_GLASS": MaterialVariant("a rough material transmits", lambda m: _rough(m) and m.transmission > 0),
    "HAS_GLASS_SPECULAR": MaterialVariant(
        "and is a solid whose reflection has a factor", lambda m: _rough(m) and _has_specular_glass(m)
    ),
    "HAS_SLABS": MaterialVariant("and reflects at both faces of a slab", lambda m: _rough(m) and m.is_slab),
    "HAS_ROUGH_TRANSMISSION": MaterialVariant(
        "and scatters what it transmits", lambda m: _rough(m) and m.transmission > 0 and not m.is_smooth
    ),
    "HAS_FRESNEL": MaterialVariant(
        "a rough material has Fresnel's equations", lambda m: _rough(m) and m.layering != "gltf"
    ),
    "HAS_PLASTIC": MaterialVariant(
        "and a base whose light crosses the boundary twice", lambda m: _rough(m) and _is_plastic(m)
    ),
    "HAS_DISNEY": MaterialVariant("or has Burley's base", lambda m: _rough(m) and m.layering == "disney"),
    "HAS_METAL_INDICES": MaterialVariant(
        "a rough material is metal of a complex index",
        lambda m: _rough(m) and m.metallic > 0 and m.metal_index is not None,
    ),
    "HAS_BECKMANN": MaterialVariant(
        "a rough material has Beckmann's microfacets", lambda m: _rough(m) and m.distribution == "beckmann"
    ),
}


def material_variants(materials: Sequence[Material]) -> dict[str, bool]:
    """Return for each variant True if some material needs it, as arguments of `defined`."""
    return {name: any(map(each.asked_by, materials)) for name, each in MATERIAL_VARIANTS.items()}


def _sheen(m: Material) -> list[list[float]]:
    if not np.any(m.sheen > 0):
        return [[0.0] * 4] * 5
    (a, *b_to_e), fit = sheen_lambda(m.sheen_alpha), sheen_albedo_fit(m.sheen_alpha)
    return [[*m.sheen, m.sheen_alpha], [*fit[:4]], [*fit[4:]], b_to_e, [a, 0, 0, 0]]


def sheen_fits(materials: Sequence[Material]) -> Float64:
    """Return (cells + 1, 2, 4) float64 fits of white sheen's albedo by alpha.

    The table is empty unless a texture controls sheen roughness.
    """
    if not any(m.sheen_roughness_texture is not None and np.any(m.sheen > 0) for m in materials):
        return np.zeros((0, 2, 4))
    return sheen_albedo_table().reshape(-1, 2, 4)


def sheen_glsl() -> list[str]:
    """Return GLSL constants of sheen whose roughness comes from a texture."""
    ends = {"MAX": CHARLIE_LAMBDA[1], "MIN": CHARLIE_LAMBDA[0]}
    lines = [f"const int SHEEN_CELLS = {SHEEN_CELLS};", f"const float SHEEN_MIN_ALPHA = {SHEEN_MIN_ALPHA};"]
    for name, (a, b, c, d, e) in ends.items():
        lines.append(f"const vec4 CHARLIE_{name} = vec4({b}, {c}, {d}, {e});")
        lines.append(f"const float CHARLIE_{name}_A = {a};")
    return lines


def _dielectric(m: Material) -> list[float]:
    normal, grazing = m.dielectric
    if m.specular_colour_texture is not None:
        # The shader clips the reflectance to 1 after it multiplies by the texture.
        normal = grazing * m.dielectric_ratio
    return [*normal, grazing]


def _exact(m: Material) -> list[list[float]]:
    """Return the texels FRESNEL, PLASTIC0, PLASTIC1, METAL_N and METAL_K."""
    entry, entry_mean = np.zeros(8), 0.0
    if m.roughness is not None and _is_plastic(m):
        entry, entry_mean = plastic_entry(m.ior, m.roughness**2, m.distribution)
    n, k = np.zeros((2, 3)) if m.metal_index is None else m.metal_index
    first = [m.ior, m.distribution == "beckmann", get_args(Layering).index(m.layering), entry_mean]
    return [first, [*entry[:4]], [*entry[4:]], [*n, 0], [*k, 0]]


def _bends(m: Material) -> bool:
    return m.keeps_energy and m.scatters_repeatedly and m.transmission > 0 and not m.thin


def _glass_cells(materials: Sequence[Material]) -> list[tuple[float, int, int]]:
    """Return each refractive index of rough glass, and its first `albedo_cells` from outside and from inside."""
    indices = dict.fromkeys(m.ior for m in materials if _bends(m))
    return [(ior, (2 * i + 2) * CELLS**2, (2 * i + 3) * CELLS**2) for i, ior in enumerate(indices)]


def albedo_cells(materials: Sequence[Material]) -> Float64:
    """Return (cells, 1, 4) float64 albedo cells of white metal, Schlick's weight and each index of rough glass.

    The table is empty if no material conserves energy.
    """
    if not any(m.keeps_energy for m in materials):
        return np.zeros((0, 1, 4))
    etas = [eta for ior, *_ in _glass_cells(materials) for eta in (ior, 1.0 / ior)]
    tables = [directional_albedo(0.0), schlick_albedo(), *map(directional_albedo, etas)]
    return np.concatenate([cells(table) for table in tables])[:, None, :]


def material_table(materials: Sequence[Material]) -> Float64:
    """Return (n, texels, 4) float64 of the materials. Unlit materials have only their emission."""
    first = {ior: (cell, last) for ior, cell, last in _glass_cells(materials)}
    rows = [
        [
            [*m.reflectance * lit, m.two_sided],
            [*m.specular * lit, m.exponent],
            [*m.mirror * lit, 0],
            [
                -1 if m.roughness is None or m.unlit else m.roughness,
                m.metallic,
                m.anisotropy,
                np.radians(m.anisotropy_angle),
            ],
            _dielectric(m),
            [m.clearcoat, m.clearcoat_roughness, 0, 0],
            # An opaque material must not count as solid glass, whose formula would change its reflection. The last
            # number is the refractive index of a slab, and 1 for any other thin dielectric.
            [
                m.transmission,
                m.ior,
                m.transmission > 0 and not m.thin,
                m.is_thin_dielectric * (m.ior if m.slab else 1.0),
            ],
            [*m.attenuation, 0],
            *_sheen(m),
            [m.iridescence, m.iridescence_thickness_min, m.iridescence_thickness, m.iridescence_ior],
            [*m.diffuse_transmission_colour, m.diffuse_transmission],
            *_exact(m),
            [m.keeps_energy, *first.get(m.ior if _bends(m) else 0.0, (0, 0)), 0],
        ]
        for m, lit in ((m, 0.0 if m.unlit else 1.0) for m in materials)
    ]
    return np.array(rows, np.float64).reshape(-1, len(MATERIAL_LAYOUT), 4)
