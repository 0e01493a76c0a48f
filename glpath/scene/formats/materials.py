"""The materials of a scene file, and their textures: pictures in files [imageio, OpenEXR] and checkers.

Image files are read as they are, without their rotation tags and colour profiles; with the transparency of a PNG
where a material's alpha is "mask" or "blend".
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from glpath.errors import SceneWarning
from glpath.image import encode_srgb
from glpath.scene.formats import description
from glpath.scene.formats.description import (
    MAX_TEXTURE_PIXELS,
    AnyMaterial,
    AnyTexture,
    Phong,
    Principled,
)
from glpath.scene.formats.scene_pictures import stored_picture
from glpath.scene.formats.values import rgb, share, unknown
from glpath.scene.model import Float64, Material, Texture, TextureSlot
from glpath.scene.place import Place

_NO_COLOURS = ("normal_texture", "surface_texture", "transmission_texture")
FORMATS = (".png", ".jpg", ".jpeg", ".exr")


def materials(
    given: Mapping[str, AnyMaterial], texture_number: Mapping[str, int], place: Place
) -> tuple[Material, ...]:
    """Those of the file; `place` is their table's. Raises SceneError."""
    return tuple(_material(name, each, texture_number, place.field(name)) for name, each in given.items())


def _material(name: str, given: AnyMaterial, texture_number: Mapping[str, int], place: Place) -> Material:
    return replace(
        _reflecting(name, given, texture_number, place),
        normal_texture=_slot(given.normal_texture, texture_number, place.field("normal_texture")),
        normal_scale=given.normal_scale,
        emission_texture=_slot(given.emission_texture, texture_number, place.field("emission_texture")),
        alpha=given.alpha,
        cutoff=given.cutoff,
        opacity=given.opacity,
    )


def _reflecting(name: str, given: AnyMaterial, texture_number: Mapping[str, int], place: Place) -> Material:
    texture = _slot(given.texture, texture_number, place.field("texture"))
    reflectance = given.reflectance
    if isinstance(reflectance, UnsetType):
        reflectance = 0.5 if texture is None else 1.0
    diffuse = share(
        reflectance,
        place.field("reflectance"),
        "A surface reflects at most what it receives; 0.8 is a white wall. Light is an emission.",
    )
    if isinstance(given, Principled):
        return _principled(name, given, diffuse, texture, texture_number, place)
    if not isinstance(given, Phong):
        return Material(name, diffuse, given.two_sided, texture=texture)
    specular = rgb(given.specular)
    if np.any(specular < 0):
        raise place.field("specular").wrong(given.specular, "0 or more", "0 is without a highlight.")
    mirror = share(given.mirror, place.field("mirror"), "1 is a perfect mirror, 0 none.")
    return Material(name, diffuse, given.two_sided, specular, given.exponent, mirror, texture)


def _principled(
    name: str,
    given: Principled,
    base: Float64,
    texture: TextureSlot | None,
    texture_number: Mapping[str, int],
    place: Place,
) -> Material:
    colour, attenuation = rgb(given.specular_color), rgb(given.attenuation)
    for field, value in (("specular_color", colour), ("attenuation", attenuation)):
        if np.any(value < 0):
            raise place.field(field).wrong(getattr(given, field), "0 or more")
    return Material(
        name,
        base,
        given.two_sided,
        texture=texture,
        specular_weight=given.specular,
        specular_colour=colour,
        attenuation=attenuation,
        clearcoat_roughness=given.clearcoat_roughness,
        roughness=given.roughness,
        metallic=given.metallic,
        anisotropy=given.anisotropy,
        anisotropy_angle=given.anisotropy_angle,
        ior=given.ior,
        transmission=given.transmission,
        thin=given.thin,
        clearcoat=given.clearcoat,
        surface_texture=_slot(given.surface_texture, texture_number, place.field("surface_texture")),
        transmission_texture=_slot(given.transmission_texture, texture_number, place.field("transmission_texture")),
    )


def _slot(given: str | UnsetType, texture_number: Mapping[str, int], place: Place) -> TextureSlot | None:
    if isinstance(given, UnsetType):
        return None
    if given not in texture_number:
        raise unknown("texture", given, list(texture_number), place, 'type = "checker" or "image"')
    return TextureSlot(texture_number[given])


def textures(
    given: Mapping[str, AnyTexture], used_by: Mapping[str, AnyMaterial], place: Place, folder: Path
) -> tuple[Texture, ...]:
    """Those of the file; `place` is their table's, `folder` where relative paths start. Raises SceneError.

    used_by : materials by name: those that look through alpha, and those that read what is no colour
    """
    alpha = {m.texture for m in used_by.values() if m.alpha != "opaque"}
    values = {getattr(m, slot, UNSET) for m in used_by.values() for slot in _NO_COLOURS}
    colours = {getattr(m, slot) for m in used_by.values() for slot in ("texture", "emission_texture")}
    for name in given:
        if name in values and name in colours:
            raise place.field(name).error(
                "is used both for colours and for what is no colour: a normal map, roughness or transmission.",
                "Give the picture two names, one for each.",
            )
    return tuple(
        _texture(name, each, place.field(name), folder, name in alpha, name not in values)
        for name, each in given.items()
    )


def _texture(name: str, given: AnyTexture, place: Place, folder: Path, alpha: bool, colour: bool) -> Texture:
    u, v = given.scale if isinstance(given.scale, tuple) else (given.scale, given.scale)
    if not (u > 0 and v > 0):
        raise place.field("scale").wrong(given.scale, "above 0", "It counts repeats: 2 shows the texture smaller.")
    if isinstance(given, description.Image):
        path = folder / given.file
        image = _picture(path, place.field("file"))
        if path.suffix.lower() != ".exr" and not colour:
            image = encode_srgb(image.astype(np.float64)).astype(np.float32)
        if path.suffix.lower() == ".png" and alpha:
            image = np.concatenate([image, _transparency(path)], axis=2)
        return Texture(name, image, (u, v), given.filter, wrap=(given.wrap, given.wrap))
    colors = place.field("colors")
    remedy = "They multiply the reflectance of the material."
    first, second = (share(each, colors.item(i), remedy) for i, each in enumerate(given.colors))
    return Texture(name, np.array([[first, second], [second, first]], np.float32), (u, v), "nearest")


def _transparency(path: Path) -> NDArray[np.float32]:
    """(h, w, 1) alpha of a PNG that could be read; 1 where it has none."""
    import PIL.Image

    with PIL.Image.open(path, formats=("PNG",)) as opened:
        alpha = np.asarray(opened.convert("RGBA"))[..., 3:]
    return (alpha / 255.0).astype(np.float32)


def _picture(path: Path, place: Place) -> NDArray[np.float32]:
    """(h, w, 3) float32 in [0, 1], linear Rec. 709, row 0 at the top. Raises SceneError; warns of what it clips."""
    stored = stored_picture(path, "a texture", FORMATS, MAX_TEXTURE_PIXELS, place)
    beyond = np.count_nonzero((stored < 0) | (stored > 1))
    if beyond:
        warnings.warn(
            SceneWarning(
                f"{place}: {beyond} of {stored.size} values of {path} are below 0 or above 1, down to "
                f"{stored.min():.3g} and up to {stored.max():.3g}; they were clipped, as no surface reflects so."
            ),
            stacklevel=2,
        )
    return np.clip(stored, 0, 1).astype(np.float32)
