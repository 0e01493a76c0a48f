"""Build the materials and textures of a scene file. A texture is an image file [imageio, OpenEXR] or a checker.

Rotation tags and colour profiles of image files are ignored. The alpha channel of a PNG is used in two
cases: a material with this texture has alpha "mask" or "blend", or the texture is in a slot that reads alpha.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from glpath.errors import warn
from glpath.film.image import read_eight_bits, read_texture
from glpath.io import description
from glpath.io.description import (
    MAX_TEXTURE_PIXELS,
    AnyMaterial,
    AnyTexture,
    Glazing,
    Phong,
    Principled,
)
from glpath.io.description.materials import Surface
from glpath.io.scene_pictures import stored_picture
from glpath.io.values import rgb, share, unknown
from glpath.scene.material import SLOTS
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from glpath.scene.slab import clearest, inside_of
from glpath.scene.source_location import SourceLocation
from glpath.system.colour import encode_srgb
from glpath.system.npz import UnfoldedPictures
from glpath.system.time_limit import check_time

_COLOURS = (
    "texture",
    "emission_texture",
    "specular_color_texture",
    "diffuse_transmission_color_texture",
    "sheen_texture",
)
# Scene-file field to field of `Material`, for those fields of [materials.NAME] that `Material` names differently.
_RENAMED = {
    "specular": "specular_weight",
    "specular_color": "specular_colour",
    "specular_color_texture": "specular_colour_texture",
    "diffuse_transmission_color": "diffuse_transmission_colour",
    "diffuse_transmission_color_texture": "diffuse_transmission_colour_texture",
}
_GIVEN = {target: field for field, target in _RENAMED.items()}
_NO_COLOURS = tuple(name for name in (_GIVEN.get(slot, slot) for slot in SLOTS) if name not in _COLOURS)
_ALPHA = ("specular_texture", "diffuse_transmission_texture", "sheen_roughness_texture")
# Colours of principled materials that may be above 1.
_ABOVE_ONE = ("specular_color", "attenuation")
FORMATS = (".png", ".jpg", ".jpeg", ".exr")


def materials(
    given: Mapping[str, AnyMaterial], texture_number: Mapping[str, int], location: SourceLocation
) -> tuple[Material, ...]:
    """Build the materials of a scene file. Raises SceneError.

    given          : entries of the table of materials, by name
    texture_number : index of each texture, by name
    location       : location of the table, for errors
    """
    return tuple(_material(name, each, texture_number, location.field(name)) for name, each in given.items())


def _material(
    name: str, given: AnyMaterial, texture_number: Mapping[str, int], location: SourceLocation
) -> Material:
    check_time()
    glass = isinstance(given, Glazing) or (isinstance(given, Principled) and given.transmission > 0)
    if given.culled and (given.two_sided or glass):
        raise location.field("culled").error(
            "is true of a material that has a back: it is two-sided, or glass.",
            "Leave it out, or say two_sided = false of a material that is not glass.",
        )
    return replace(
        _reflecting(name, given, texture_number, location),
        culled=given.culled,
        normal_texture=_slot(given.normal_texture, texture_number, location.field("normal_texture")),
        normal_scale=given.normal_scale,
        emission_texture=_slot(given.emission_texture, texture_number, location.field("emission_texture")),
        alpha=given.alpha,
        cutoff=given.cutoff,
        opacity=given.opacity,
    )


def _reflecting(
    name: str, given: AnyMaterial, texture_number: Mapping[str, int], location: SourceLocation
) -> Material:
    texture = _slot(given.texture, texture_number, location.field("texture"))
    if isinstance(given, Glazing):
        return _glazing(name, given, texture, location)
    reflectance = given.reflectance
    if isinstance(reflectance, UnsetType):
        reflectance = 0.5 if texture is None else 1.0
    diffuse = share(
        reflectance,
        location.field("reflectance"),
        "A surface reflects at most what it receives; 0.8 is a white wall. Light is an emission.",
    )
    if isinstance(given, Principled):
        return _principled(name, given, diffuse, texture, texture_number, location)
    if not isinstance(given, Phong):
        return Material(name, diffuse, given.two_sided, texture=texture)
    specular = rgb(given.specular)
    if np.any(specular < 0):
        raise location.field("specular").wrong(given.specular, "0 or more", "0 is without a highlight.")
    mirror = share(given.mirror, location.field("mirror"), "1 is a perfect mirror, 0 none.")
    return Material(name, diffuse, given.two_sided, specular, given.exponent, mirror, texture)


def _glazing(name: str, given: Glazing, texture: TextureSlot | None, location: SourceLocation) -> Material:
    if not isinstance(given.reflectance, UnsetType):
        raise location.field("reflectance").error(
            "is of glazing, which reflects by its index.", "Leave it out, or make it a principled material."
        )
    if not given.two_sided:
        raise location.field("two_sided").error(
            "is false of glazing, which lets light through from both sides.", "Leave it out."
        )
    transmittance, limit = rgb(given.transmittance), clearest(given.ior)
    if np.any((transmittance <= 0) | (transmittance > limit * (1 + 1e-9))):
        raise location.field("transmittance").wrong(
            given.transmittance,
            f"above 0 and at most {limit:.3f}, what two faces of the index {given.ior:g} leave",
            "It is that of the whole glazing at normal incidence, as makers of glass give it.",
        )
    inside = np.minimum(inside_of(transmittance, given.ior), 1.0)
    return Material(
        name, inside, texture=texture, roughness=0.0, ior=given.ior, transmission=1.0, thin=True, slab=True
    )


def _principled(
    name: str,
    given: Principled,
    base: Float64,
    texture: TextureSlot | None,
    texture_number: Mapping[str, int],
    location: SourceLocation,
) -> Material:
    made = Material(name, base, given.two_sided, texture=texture)
    fields: dict[str, Any] = {}
    for field in sorted(set(Principled.__struct_fields__) - set(Surface.__struct_fields__)):
        value, target = getattr(given, field), _RENAMED.get(field, field)
        if target in SLOTS:
            fields[target] = _slot(value, texture_number, location.field(field))
        elif np.ndim(getattr(made, target)) == 0:
            fields[target] = value
        elif field not in _ABOVE_ONE:
            fields[target] = share(value, location.field(field), "It is a colour, linear Rec. 709.")
        else:
            fields[target] = rgb(value)
            if np.any(fields[target] < 0):
                raise location.field(field).wrong(value, "0 or more")
    return replace(made, **fields)


def _slot(
    given: str | UnsetType, texture_number: Mapping[str, int], location: SourceLocation
) -> TextureSlot | None:
    if isinstance(given, UnsetType):
        return None
    if given not in texture_number:
        raise unknown("texture", given, list(texture_number), location, 'type = "checker" or "image"')
    return TextureSlot(texture_number[given])


class _Use(NamedTuple):
    """Use of one texture by all materials.

    alpha  : True if a material uses the alpha of the texture
    colour : True if the texture's values are colours, not data such as normals or roughness
    shines : True if a material has the texture as `emission_texture`, and none has it as `texture`
    """

    alpha: bool
    colour: bool
    shines: bool


def textures(
    given: Mapping[str, AnyTexture],
    used_by: Mapping[str, AnyMaterial],
    location: SourceLocation,
    folder: Path,
    heights: Collection[str] = (),
) -> tuple[Texture, ...]:
    """Build the textures of a scene file. Raises SceneError.

    given    : entries of the table of textures, by name
    used_by  : materials by name. Their slots decide whether alpha is used and whether the values are colours
    location : location of the table, for errors
    folder   : base folder of relative paths
    heights  : names of the textures that displace surfaces
    """
    alpha = {m.texture for m in used_by.values() if m.alpha != "opaque"}
    alpha |= {getattr(m, slot, UNSET) for m in used_by.values() for slot in _ALPHA}
    values = {getattr(m, slot, UNSET) for m in used_by.values() for slot in _NO_COLOURS} | set(heights)
    colours = {getattr(m, slot, UNSET) for m in used_by.values() for slot in _COLOURS}
    shining = {m.emission_texture for m in used_by.values()} - {m.texture for m in used_by.values()}
    for name in given:
        if name in values and name in colours:
            raise location.field(name).error(
                "is used both for colours and for what is no colour: a normal map, roughness, transmission or "
                "a displacement.",
                "Give the picture two names, one for each.",
            )
    unfolded = UnfoldedPictures()
    return tuple(
        _texture(name, each, location.field(name), folder, use, unfolded)
        for name, each in given.items()
        for use in [_Use(name in alpha, name not in values, name in shining)]
    )


def _texture(
    name: str,
    given: AnyTexture,
    location: SourceLocation,
    folder: Path,
    use: _Use,
    unfolded: UnfoldedPictures,
) -> Texture:
    u, v = given.scale if isinstance(given.scale, tuple) else (given.scale, given.scale)
    if not (u > 0 and v > 0):
        raise location.field("scale").wrong(
            given.scale, "above 0", "It counts repeats: 2 shows the texture smaller."
        )
    if isinstance(given, description.Image):
        path = folder / given.file
        image = _picture(path, location.field("file"), use, unfolded)
        bytes_ = image.dtype == np.uint8
        if path.suffix.lower() != ".exr" and not use.colour and not bytes_:
            image = encode_srgb(image.astype(np.float64)).astype(np.float32)
        if not use.alpha:
            image = image[..., :3].copy()
        wrap = (given.wrap, given.wrap)
        return Texture(name, image, (u, v), given.filter, srgb=bytes_ and use.colour, wrap=wrap)
    colors = location.field("colors")
    remedy = "They multiply the reflectance of the material."
    first, second = (share(each, colors.item(i), remedy) for i, each in enumerate(given.colors))
    return Texture(name, np.array([[first, second], [second, first]], np.float32), (u, v), "nearest")


def _as_stored(path: Path, colours: bool) -> Float64 | NDArray[np.uint8]:
    eight_bits = read_eight_bits(path)
    return read_texture(path, colours) if eight_bits is None else eight_bits


def _picture(
    path: Path, location: SourceLocation, use: _Use, unfolded: UnfoldedPictures
) -> NDArray[np.float32] | NDArray[np.uint8]:
    """Read the pixels of an image: (h, w, 3), or (h, w, 4) if it has alpha. Row 0 is the top.

    8-bit images stay uint8 as stored. Other images become float32, linear Rec. 709, clipped to [0, 1] with a
    warning. Only values of an emission texture (`use.shines`) may exceed 1. Raises SceneError.
    """
    read = partial(_as_stored, colours=use.colour)
    stored = stored_picture(path, "a texture", FORMATS, MAX_TEXTURE_PIXELS, location, read, unfolded)
    if stored.dtype == np.uint8:
        return stored.astype(np.uint8, copy=False)
    if use.shines:
        return np.maximum(stored, 0).astype(np.float32)
    beyond = np.count_nonzero((stored < 0) | (stored > 1))
    if beyond:
        warn(
            f"{location}: {beyond} of {stored.size} values of {path} are below 0 or above 1, down to "
            f"{stored.min():.3g} and up to {stored.max():.3g}; they were clipped, as no surface reflects so."
        )
    return np.clip(stored, 0, 1).astype(np.float32)
