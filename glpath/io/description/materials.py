"""Tables [materials.NAME] and [textures.NAME] of a scene file."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from glpath.io.description.vector import Vector

MAX_TEXTURE_SIDE = 16384
MAX_TEXTURE_PIXELS = 2**26


class Surface(Struct, tag_field="type", forbid_unknown_fields=True, kw_only=True):
    """Fields that all materials have."""

    reflectance: (
        Annotated[
            float | Vector,
            Meta(
                description="Share of light reflected diffusely, 0 to 1: one number for grey or [r, g, b], linear "
                "Rec. 709. Without it 0.5, or 1 where there is a texture, which it multiplies."
            ),
        ]
        | UnsetType
    ) = UNSET
    texture: (
        Annotated[str, Meta(description="Name of a texture of this file, [textures.NAME], for the reflectance.")]
        | UnsetType
    ) = UNSET
    two_sided: Annotated[bool, Meta(description="false makes the back black; it still blocks light.")] = True
    culled: Annotated[
        bool,
        Meta(
            description="true: its back is not there, for eyes, bounces and rays to lights, as in viewers of glTF; "
            "it goes with two_sided = false, and not with glass."
        ),
    ] = False
    normal_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: a normal map, of tangent space.")]
        | UnsetType
    ) = UNSET
    normal_scale: Annotated[float, Meta(description="Strength of the normal map: its x and y are multiplied.")] = (
        1.0
    )
    emission_texture: (
        Annotated[
            str, Meta(description="Name of a texture of this file, which the emission of shapes is multiplied by.")
        ]
        | UnsetType
    ) = UNSET
    alpha: Annotated[
        Literal["opaque", "mask", "blend"],
        Meta(
            description="What opacity does: nothing; all or nothing, from `cutoff` on; a share of the light. "
            "Opacity is multiplied by the alpha of the texture."
        ),
    ] = "opaque"
    cutoff: Annotated[float, Meta(ge=0, le=1, description="Of a mask: opacity below it is a hole.")] = 0.5
    opacity: Annotated[float, Meta(ge=0, le=1, description="Share of light that the surface meets.")] = 1.0


class Diffuse(Surface, tag="diffuse", kw_only=True):
    """Lambertian reflection; the default if a material has no type."""


class Phong(Surface, tag="phong", kw_only=True):
    """Lambertian reflection, a highlight as in Phong's model of 1975, and mirror reflection."""

    specular: Annotated[
        float | Vector,
        Meta(description="Strength of Phong's highlight, 0 or more: one number or [r, g, b], linear Rec. 709."),
    ] = 0.5
    exponent: Annotated[
        float, Meta(gt=0, le=1e6, description="Phong's exponent: the larger, the smaller the highlight.")
    ] = 32.0
    mirror: Annotated[
        float | Vector,
        Meta(description="Share of light mirrored, 0 to 1: one number or [r, g, b], linear Rec. 709."),
    ] = 0.0


_Share = Annotated[float, Meta(ge=0, le=1)]


class Principled(Surface, tag="principled", kw_only=True):
    """Principled material for metal, plastic, clearcoat and glass: the metallic-roughness model of glTF 2.0."""

    roughness: Annotated[
        _Share, Meta(description="0 is a mirror, 1 all diffuse: the alpha of GGX's microfacets is its square.")
    ] = 0.5
    metallic: Annotated[
        _Share, Meta(description="Share of metal, which has its reflectance for a colour and no diffuse base.")
    ] = 0.0
    anisotropy: Annotated[_Share, Meta(description="How much rougher it is along the tangent than across.")] = 0.0
    anisotropy_angle: Annotated[
        float, Meta(description="Angle of the tangent in degrees, from where u grows towards where v grows.")
    ] = 0.0
    ior: Annotated[
        float, Meta(ge=1, le=10, description="Index of refraction: 1.33 water, 1.5 glass and plastic, 2.4 diamond.")
    ] = 1.5
    specular: Annotated[
        _Share, Meta(description="Strength of what is not metal's reflection, 1 as its ior says.")
    ] = 1.0
    specular_color: Annotated[
        float | Vector,
        Meta(description="Its colour at normal incidence, 0 or more: one number or [r, g, b], linear Rec. 709."),
    ] = 1.0
    transmission: Annotated[
        _Share, Meta(description="Share that is glass instead of a diffuse base: 1 is clear glass.")
    ] = 0.0
    thin: Annotated[
        bool,
        Meta(
            description="true: a thin dielectric, which does not refract. false: the surface of a solid that does, "
            "which should be closed, with its fronts outward."
        ),
    ] = False
    attenuation: Annotated[
        float | Vector,
        Meta(
            description="Of a solid of glass, per scene unit, 0 or more: exp(-attenuation) is left after one unit."
        ),
    ] = 0.0
    diffuse_transmission: Annotated[
        _Share,
        Meta(description="Share of the diffuse base that sends light to the other side, as paper or a leaf."),
    ] = 0.0
    diffuse_transmission_color: Annotated[
        float | Vector,
        Meta(description="Colour of that, instead of the reflectance, 0 to 1: one number or [r, g, b]."),
    ] = 1.0
    diffuse_transmission_texture: (
        Annotated[
            str,
            Meta(description="Name of a texture of this file: diffuse_transmission is multiplied by its alpha."),
        ]
        | UnsetType
    ) = UNSET
    diffuse_transmission_color_texture: (
        Annotated[str, Meta(description="Name of a texture of this file, which that colour is multiplied by.")]
        | UnsetType
    ) = UNSET
    iridescence: Annotated[
        _Share, Meta(description="Share of what is reflected that is under a thin film, as a bubble's or oil.")
    ] = 0.0
    iridescence_ior: Annotated[float, Meta(ge=1, le=10, description="Index of refraction of the film.")] = 1.3
    iridescence_thickness: Annotated[float, Meta(ge=0, description="Thickness of the film in nanometres.")] = 400.0
    iridescence_thickness_min: Annotated[
        float, Meta(ge=0, description="The same where iridescence_thickness_texture is 0.")
    ] = 100.0
    iridescence_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: iridescence is multiplied by its red.")]
        | UnsetType
    ) = UNSET
    iridescence_thickness_texture: (
        Annotated[
            str,
            Meta(
                description="Name of a texture of this file: its green goes from the least thickness to the other."
            ),
        ]
        | UnsetType
    ) = UNSET
    multiple_scattering: Annotated[
        bool,
        Meta(
            description="true: rough surfaces keep the light that their microfacets scatter more than once. "
            "false: it is lost, as in Mitsuba, and white metal is darker the rougher it is."
        ),
    ] = True
    clearcoat: Annotated[_Share, Meta(description="Share that is under a clearcoat.")] = 0.0
    clearcoat_roughness: Annotated[_Share, Meta(description="The roughness of the clearcoat.")] = 0.0
    sheen: Annotated[
        float | Vector,
        Meta(description="Sheen of cloth, 0 to 1: its colour, one number or [r, g, b], linear Rec. 709."),
    ] = 0.0
    sheen_roughness: Annotated[
        _Share, Meta(description="The roughness of the sheen: the smaller, the nearer to outlines. At least 0.1.")
    ] = 0.5
    sheen_texture: (
        Annotated[str, Meta(description="Name of a texture of this file, which sheen is multiplied by.")]
        | UnsetType
    ) = UNSET
    sheen_roughness_texture: (
        Annotated[
            str, Meta(description="Name of a texture of this file: sheen_roughness is multiplied by its alpha.")
        ]
        | UnsetType
    ) = UNSET
    surface_texture: (
        Annotated[
            str,
            Meta(
                description="Name of a texture of this file: roughness is multiplied by its green, metallic by its "
                "blue."
            ),
        ]
        | UnsetType
    ) = UNSET
    transmission_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: transmission is multiplied by its red.")]
        | UnsetType
    ) = UNSET
    clearcoat_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: clearcoat is multiplied by its red.")]
        | UnsetType
    ) = UNSET
    clearcoat_roughness_texture: (
        Annotated[
            str, Meta(description="Name of a texture of this file: clearcoat_roughness is multiplied by its green.")
        ]
        | UnsetType
    ) = UNSET
    clearcoat_normal_texture: (
        Annotated[
            str,
            Meta(
                description="Name of a texture of this file: a normal map of the clearcoat alone, which "
                "normal_texture does not bend."
            ),
        ]
        | UnsetType
    ) = UNSET
    clearcoat_normal_scale: Annotated[float, Meta(description="Strength of the clearcoat's normal map.")] = 1.0
    anisotropy_texture: (
        Annotated[
            str,
            Meta(
                description="Name of a texture of this file: its red and green, from -1 to 1, are the tangent; "
                "anisotropy is multiplied by its blue."
            ),
        ]
        | UnsetType
    ) = UNSET
    specular_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: specular is multiplied by its alpha.")]
        | UnsetType
    ) = UNSET
    specular_color_texture: (
        Annotated[str, Meta(description="Name of a texture of this file: specular_color is multiplied by it.")]
        | UnsetType
    ) = UNSET


class Glazing(Surface, tag="glazing", kw_only=True):
    """Window glass given by its transmittance, with all reflections between its two faces."""

    transmittance: Annotated[
        float | Vector,
        Meta(
            description="Share of light let through at normal incidence, above 0: one number or [r, g, b], linear "
            "Rec. 709. At most 0.918 for the index 1.52. The reflectance of the surface is not given."
        ),
    ]
    ior: Annotated[float, Meta(gt=1, le=10, description="Index of refraction of the glass.")] = 1.52


AnyMaterial = Diffuse | Phong | Principled | Glazing
Repeats = Annotated[
    float | tuple[float, float],
    Meta(description="Repeats per unit of the texture coordinates: one number above 0, or [u, v]."),
]


class Checker(Struct, tag_field="type", tag="checker", forbid_unknown_fields=True, kw_only=True):
    """Checkerboard of two colours; one repeat is two by two squares."""

    colors: Annotated[
        tuple[float | Vector, float | Vector],
        Meta(description="Two colours, each from 0 to 1: a number for grey or [r, g, b], linear Rec. 709."),
    ] = (0.8, 0.2)
    scale: Repeats = 1.0


class Image(Struct, tag_field="type", tag="image", forbid_unknown_fields=True, kw_only=True):
    """Image texture: PNG and JPEG in sRGB, EXR in linear Rec. 709.

    Data that are not colours, such as normal maps, are read without conversion.
    """

    file: Annotated[
        str, Meta(description="PNG, JPEG or EXR file; a relative path starts at the folder of the scene file.")
    ]
    scale: Repeats = 1.0
    filter: Annotated[
        Literal["linear", "nearest"],
        Meta(description="linear blends neighbouring pixels where they are seen large, nearest shows squares."),
    ] = "linear"
    wrap: Annotated[
        Literal["repeat", "clamp", "mirror"],
        Meta(description="Beyond its edges: repeated, its last pixels, or mirrored."),
    ] = "repeat"


AnyTexture = Checker | Image
