"""The extensions of glTF's materials that are factors alone, as the reader and the writer both have them; and those
that are not read.

An extension is a row of LAYERS: neither the reader nor the writer names it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class LayerTexture(NamedTuple):
    """field : of `Material`; srgb: its texture has colours; alpha: it is read; scale: of a normal map"""

    field: str
    srgb: bool = False
    alpha: bool = False
    scale: str | None = None


class Layer(NamedTuple):
    """An extension whose properties are fields of `Material`.

    factors  : the field of each property, in [0, 1], with the default of `Material`; without the first, whose
               default is 0, there is no layer
    numbers  : the field of each property from 0 on, with the default of `Material`
    textures : the field of each texture
    """

    factors: dict[str, str]
    numbers: Mapping[str, str] = MappingProxyType({})
    textures: Mapping[str, LayerTexture] = MappingProxyType({})

    @property
    def strength(self) -> str:
        """The field of `Material` that is 0 where the layer is absent."""
        return next(iter(self.factors.values()))


LAYERS = {
    "KHR_materials_clearcoat": Layer(
        {"clearcoatFactor": "clearcoat", "clearcoatRoughnessFactor": "clearcoat_roughness"},
        textures={
            "clearcoatTexture": LayerTexture("clearcoat_texture"),
            "clearcoatRoughnessTexture": LayerTexture("clearcoat_roughness_texture"),
            "clearcoatNormalTexture": LayerTexture("clearcoat_normal_texture", scale="clearcoat_normal_scale"),
        },
    ),
    "KHR_materials_sheen": Layer(
        {"sheenColorFactor": "sheen", "sheenRoughnessFactor": "sheen_roughness"},
        textures={
            "sheenColorTexture": LayerTexture("sheen_texture", srgb=True),
            "sheenRoughnessTexture": LayerTexture("sheen_roughness_texture", alpha=True),
        },
    ),
    "KHR_materials_diffuse_transmission": Layer(
        {
            "diffuseTransmissionFactor": "diffuse_transmission",
            "diffuseTransmissionColorFactor": "diffuse_transmission_colour",
        },
        textures={
            "diffuseTransmissionTexture": LayerTexture("diffuse_transmission_texture", alpha=True),
            "diffuseTransmissionColorTexture": LayerTexture("diffuse_transmission_colour_texture", srgb=True),
        },
    ),
    "KHR_materials_iridescence": Layer(
        {"iridescenceFactor": "iridescence"},
        {
            "iridescenceIor": "iridescence_ior",
            "iridescenceThicknessMinimum": "iridescence_thickness_min",
            "iridescenceThicknessMaximum": "iridescence_thickness",
        },
        {
            "iridescenceTexture": LayerTexture("iridescence_texture"),
            "iridescenceThicknessTexture": LayerTexture("iridescence_thickness_texture"),
        },
    ),
}
#: Extensions of materials that are lost, and the part of the look that is lost with each.
UNUSED_MATERIALS = {
    "KHR_materials_dispersion": "dispersion of glass: a path has all three colours, which would part",
    "KHR_materials_volume_scatter": "light that is scattered inside of solids: media are not traced",
}
