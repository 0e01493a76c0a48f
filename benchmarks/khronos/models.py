"""The models in a folder of Khronos' samples, the features of their materials, and their limits.

Source: https://github.com/KhronosGroup/glTF-Sample-Assets, with the layout Models/NAME/glTF-Binary/NAME.glb and
        Models/NAME/glTF/NAME.gltf.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from glpath.errors import UsageError

#: Folders of one model, in the order of the search.
_KINDS = ("glTF-Binary", "glTF", "glTF-Embedded")
#: Largest mean difference of eight-bit values to accept, by feature.
PLAIN, SPECULAR, LAYERED = 1.5, 2.5, 3.0
_FEATURES = {
    "sheen": ("KHR_materials_sheen", LAYERED),
    "clearcoat": ("KHR_materials_clearcoat", LAYERED),
    "specular": ("KHR_materials_specular", SPECULAR),
}
# Extensions that do not change the limit of a plain material.
_AS_PLAIN = {
    "KHR_materials_emissive_strength",
    "KHR_materials_variants",
    "KHR_materials_unlit",
    "KHR_materials_ior",
}
# Nearly white metal shows the energy that microfacets conserve.
_WHITE = 0.9


class SampleModel(NamedTuple):
    """name : name of its folder; file : path of the model"""

    name: str
    file: Path


class Mark(NamedTuple):
    """features : features of the materials, as words
    limit : largest mean difference to accept; None if the programs interpret a feature differently
    """

    features: tuple[str, ...]
    limit: float | None


def find_models(folder: Path, only: Sequence[str] = ()) -> list[SampleModel]:
    """Find the models of a folder, one file for each. Raises UsageError if there are none.

    folder : the repository, its `Models`, or any folder that has a folder for each model
    only   : names of the models to find; all if empty
    """
    if not folder.is_dir():
        raise UsageError(f"khronos: {folder} is not a folder.", "Clone or unpack glTF-Sample-Assets, and name it.")
    top = folder / "Models" if (folder / "Models").is_dir() else folder
    found = [model for each in sorted(top.iterdir()) if each.is_dir() for model in _of_folder(each)]
    missing = set(only) - {model.name for model in found}
    if missing or not found:
        what = f"no model {', '.join(sorted(missing))}" if missing else "no models"
        raise UsageError(
            f"khronos: {what} in {top}.", f"Looked for: NAME/{_KINDS[0]}/*.glb, then NAME/{_KINDS[1]}/*.gltf."
        )
    return [model for model in found if not only or model.name in only]


def _of_folder(folder: Path) -> list[SampleModel]:
    for kind in _KINDS:
        files = sorted([*folder.glob(f"{kind}/*.glb"), *folder.glob(f"{kind}/*.gltf")])
        if files:
            return [SampleModel(folder.name, files[0])]
    return []


def mark_of(file: Path) -> Mark:
    """Return the features of a file's materials, and the limit for them."""
    document = _document(file)
    materials = document.get("materials", [])
    used = {name for material in materials for name in material.get("extensions", {})}
    used = {name for name in used if name.startswith("KHR_materials_")}
    features = [word for word, (extension, _) in _FEATURES.items() if extension in used]
    limits = [_FEATURES[word][1] for word in features]
    if any(map(_is_white_metal, materials)):
        features.append("white metal")
        limits.append(SPECULAR)
    known = _AS_PLAIN | {extension for extension, _ in _FEATURES.values()}
    others = sorted(name.removeprefix("KHR_materials_") for name in used - known)
    if document.get("animations") and document.get("skins"):
        others.append("posed by an animation")  # Blender poses it by its first frame, glpath by its nodes
    if others:
        return Mark((*features, *others), None)
    return Mark(tuple(features) or ("metal and rough",), max(limits, default=PLAIN))


def _is_white_metal(material: dict[str, Any]) -> bool:
    surface = material.get("pbrMetallicRoughness", {})
    colour = surface.get("baseColorFactor", (1, 1, 1, 1))[:3]
    textured = {"baseColorTexture", "metallicRoughnessTexture"} & surface.keys()
    return not textured and surface.get("metallicFactor", 1) == 1 and min(colour) >= _WHITE


def _document(file: Path) -> dict[str, Any]:
    """Return the JSON of a .gltf or .glb that glpath can read."""
    content = file.read_bytes()
    if file.suffix.lower() == ".glb":
        (length,) = struct.unpack_from("<I", content, 12)
        content = content[20 : 20 + length]
    found: dict[str, Any] = json.loads(content)
    return found
