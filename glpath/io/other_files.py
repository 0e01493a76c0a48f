"""Files that are often mistaken for scenes, and names that other programs give to fields, with remedies."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path

from glpath.errors import SceneError
from glpath.io import photometry
from glpath.scene.source_location import SourceLocation

_MODEL = "Export the scene as glTF (.glb) from the program that wrote it."
_PICTURE = 'It may light a scene as its environment map: [sky] with file = "{0}".'

#: Kind of file and remedy, by suffix.
KINDS = {
    ".hdr": ("a picture", _PICTURE),
    ".exr": ("a picture", _PICTURE),
    ".blend": ("a file of Blender", _MODEL),
    ".fbx": ("an FBX model", _MODEL),
    ".dae": ("a Collada model", _MODEL),
    ".3ds": ("a 3DS model", _MODEL),
    ".3mf": ("a 3MF model", _MODEL),
    ".amf": ("an AMF model", _MODEL),
    ".abc": ("an Alembic archive", _MODEL),
    ".wrl": ("a VRML world", _MODEL),
    ".x3d": ("an X3D scene", _MODEL),
    ".x": ("a DirectX model", _MODEL),
    ".lwo": ("a LightWave model", _MODEL),
    ".max": ("a file of 3ds Max", _MODEL),
    ".ma": ("a file of Maya", _MODEL),
    ".mb": ("a file of Maya", _MODEL),
    ".c4d": ("a file of Cinema 4D", _MODEL),
    ".3dm": ("a file of Rhino", _MODEL),
    ".dxf": ("a drawing (DXF)", _MODEL),
    ".dwg": ("a drawing (DWG)", _MODEL),
    ".igs": ("a CAD model (IGES)", _MODEL),
    ".iges": ("a CAD model (IGES)", _MODEL),
    ".usd": ("a USD stage", _MODEL),
    ".usda": ("a USD stage", _MODEL),
    ".usdc": ("a USD stage", _MODEL),
    ".usdz": ("a USD stage", _MODEL),
    ".skp": ("a file of SketchUp", _MODEL),
    ".ifc": ("a building model (IFC)", _MODEL),
    ".step": ("a CAD model (STEP)", _MODEL),
    ".stp": ("a CAD model (STEP)", _MODEL),
    ".mtl": ("materials of an OBJ file", "Give the .obj, which names it."),
    ".rad": ("a scene of Radiance", "Export its surfaces as OBJ (rad2obj), and its lights by hand."),
    ".pbrt": ("a scene of pbrt", _MODEL),
}


def refuse_other_file(path: Path) -> None:
    """Raise SceneError if the file exists but has a suffix of files that are not scenes.

    For a photometric file, the error also gives the maximum intensity and the flux.
    """
    suffix = path.suffix.lower()
    if not os.path.isfile(path):
        return
    location = SourceLocation(str(path))
    if suffix in photometry.SUFFIXES:
        raise _of_profile(path, location)
    if suffix in KINDS:
        what, remedy = KINDS[suffix]
        raise location.error(f"is {what}, not a scene.", remedy.format(path.name))


def _of_profile(path: Path, location: SourceLocation) -> SceneError:
    profile = photometry.read_profile(path, location)
    kind, _ = photometry.FORMATS[path.suffix.lower()]
    return location.error(
        f"is the profile of a lamp ({kind}: up to {profile.max:,.4g} cd, {profile.flux:,.4g} lm in all), not a "
        "scene.",
        "Hang it in one:\n"
        f'  [[lights]]\n  type = "point"\n  position = [0, 2.5, 0]\n  profile = "{path.name}"\n'
        "`glpath measure ROOM.toml --plane y=0.75 -o lux.csv` then has the lux below.",
    )


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
