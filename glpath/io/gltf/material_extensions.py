"""Table of the glTF material extensions that are plain factors, and list of the extensions that are not read.

An extension is a row of LAYERS, so neither the reader nor the writer has code for a single extension.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class LayerTexture(NamedTuple):
    """Texture of a layer.

    field : field of `Material`
    srgb  : True if the texture holds colours
    alpha : True if its alpha is read
    scale : field of `Material` with the scale of a normal map; None for other textures
    """

    field: str
    srgb: bool = False
    alpha: bool = False
    scale: str | None = None


class Layer(NamedTuple):
    """Extension whose properties are fields of `Material`.

    factors  : field for each property in [0, 1]; defaults are those of `Material`. The first property, 0 by
               default, is the strength: without it there is no layer
    numbers  : field for each property that is a number; defaults and lowest values are those of `Material`
    textures : field for each texture
    """

    factors: dict[str, str]
    numbers: Mapping[str, str] = MappingProxyType({})
    textures: Mapping[str, LayerTexture] = MappingProxyType({})

    @property
    def strength(self) -> str:
        """Field of `Material` that is 0 if the layer is absent."""
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
#: Material extensions that are ignored, with a description of what the image then lacks.
UNUSED_MATERIALS = {
    "KHR_materials_dispersion": "dispersion of glass: a path has all three colours, which would part",
    "KHR_materials_volume_scatter": "light that is scattered inside of solids: media are not traced",
}
