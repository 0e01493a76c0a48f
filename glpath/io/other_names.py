"""Names that other programs and formats give to fields of a scene file, for the remedy of an error."""

from __future__ import annotations

from collections.abc import Collection

_NAMES = {
    "reflectance": "albedo basecolor basecolour color colour diffuse diffusecolor diffusecolour kd rgb rho",
    "texture": "basecolormap basecolortexture colormap diffusemap diffusetexture map mapkd",
    "metallic": "metal metallicity metalness",
    "ior": "eta extior indexofrefraction intior refractiveindex",
    "opacity": "alphavalue",
    "cutoff": "alphacutoff alphathreshold",
    "exponent": "ns shininess",
    "specular": "ks specularcolor specularcolour specularweight",
    "clearcoat": "clearcoatweight coat coatweight",
    "clearcoat_roughness": "coatroughness",
    "sheen": "fuzz fuzzcolor sheencolor sheencolour sheenweight",
    "transmission": "transmissionweight transmittance",
    "normal_texture": "bumpmap normalmap",
    "emission_texture": "emissivemap emissivetexture",
    "surface_texture": "metallicroughnesstexture roughnessmap roughnesstexture",
    "two_sided": "doublesided twosided",
    "emission": "ambient arealight ke emissive emissioncolor emissivecolor light luminance radiance",
    "radiance": "emissivecolor color colour intensity luminance power strength",
    "intensity": "candela color colour emission energy i luminousintensity power radiance strength",
    "irradiance": "color colour e illuminance intensity power strength",
    "profile": "eulumdat ies iesfile iesprofile ldt web",
    "position": "eye from location lookfrom origin",
    "target": "at center lookat lookto to",
    "fov": "fieldofview fovy vfov yfov",
    "up": "upvector vup",
    "resolution": "imagesize size",
    "center": "centre origin position",
    "radius": "r",
    "file": "filename mesh path uri",
    "unit": "units",
}


def meant_by(name: str, allowed: Collection[str]) -> str:
    """Return the field in `allowed` that other programs call `name`; empty if there is none."""
    plain = "".join(letter for letter in name.lower() if letter.isalnum()).removesuffix("factor")
    for field, others in _NAMES.items():
        if field in allowed and plain in (field.replace("_", ""), *others.split()):
            return field
    return ""
