"""Scenes that are made in Python: dictionaries with arrays, meshes and scenes of trimesh, files of one mesh.

What such a scene does not say is filled in, and a SceneWarning says what: a camera that sees everything, and light
from all around. trimesh is not imported here: who hands in one of its objects has done so.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from glpath.errors import SceneWarning, UsageError
from glpath.image import decode_srgb
from glpath.scene.formats.completed import completed
from glpath.scene.formats.load import scene_of
from glpath.scene.formats.meshes import read_mesh
from glpath.scene.model import Float64, Mesh, Scene, Shapes
from glpath.scene.place import Place, PythonPlace, shown

if TYPE_CHECKING:
    import trimesh

    AnyScene: TypeAlias = str | Path | Scene | Mapping[str, Any] | trimesh.Trimesh | trimesh.Scene
else:
    AnyScene = Any

_NO_CAMERA = {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0]}


def is_made_in_python(scene: object) -> bool:
    """Whether it is a dictionary or an object of trimesh."""
    return isinstance(scene, Mapping) or _of_trimesh(scene, "Trimesh") or _of_trimesh(scene, "Scene")


def scene_from_python(scene: Any) -> Scene:
    """The scene of a dictionary, a `trimesh.Trimesh` or a `trimesh.Scene`; see `load_scene`."""
    if _of_trimesh(scene, "Trimesh"):
        scene = {"shapes": [{"mesh": scene}]}
    elif _of_trimesh(scene, "Scene"):
        scene = _dictionary(scene)
    return _complete(scene, PythonPlace("scene"), Path())


def scene_from_mesh_file(path: Path) -> Scene:
    """The scene of one mesh file, grey: its materials are not read."""
    mesh = read_mesh(path, Place(str(path)))
    return _complete(
        {"name": path.stem, "shapes": [{"mesh": mesh, "name": path.stem}]}, Place(str(path)), path.parent
    )


def added(scene: Scene, shape: Any, material: str | Mapping[str, Any] | None, fields: Mapping[str, Any]) -> Scene:
    """See `Scene.add`."""
    table = {**({"mesh": shape} if _of_trimesh(shape, "Trimesh") or isinstance(shape, Mesh) else shape), **fields}
    names = [each.name for each in scene.materials]
    if isinstance(material, str) and material not in names:
        raise UsageError(
            f"Scene.add: material = {shown(material)}, but the scene has {', '.join(names) or 'none'}.",
            "Name one of them, or describe a new one: material={'reflectance': [0.8, 0.2, 0.2]}.",
        )
    data: dict[str, Any] = {"camera": _NO_CAMERA, "shapes": [table]}
    if isinstance(material, Mapping):
        data["materials"] = {"new": material}
        table["material"] = "new"
    part = scene_of(_with_colours(data), PythonPlace("shape"), Path(), "shape")
    (new,) = part.shapes
    name = new.name if "name" in table else f"{new.kind}-{len(scene.shapes)}"
    if isinstance(material, str):
        number, materials = names.index(material), scene.materials
    else:
        number = len(scene.materials)
        materials = (*scene.materials, replace(part.materials[new.material], name=f"{name}"))
    return replace(
        scene, shapes=Shapes((*scene.shapes, replace(new, name=name, material=number))), materials=materials
    )


def _complete(data: Mapping[str, Any], place: Place, folder: Path) -> Scene:
    """The scene with a camera and a light, with a warning of what had to be added."""
    given = _with_colours(data)
    scene = scene_of({"camera": _NO_CAMERA, **given}, place, folder, str(given.get("name", place.source)))
    return completed(scene, has_camera="camera" in given, stacklevel=4)


# --- trimesh ---


def _of_trimesh(value: object, kind: str) -> bool:
    module = sys.modules.get("trimesh")
    return module is not None and isinstance(value, getattr(module, kind, ()))


def _dictionary(scene: Any) -> dict[str, Any]:
    """The scene format's form of a `trimesh.Scene`: an instance for each node, its camera where it has one."""
    shapes, dropped = [], set()
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not _of_trimesh(geometry, "Trimesh"):
            dropped.add(f"{type(geometry).__name__} {shown(str(name))}")
            continue
        shapes.append(
            {"mesh": geometry, "name": str(node), "transform": [{"matrix": np.asarray(transform).tolist()}]}
        )
    if getattr(scene, "_lights", None):
        dropped.add("its lights")
    if dropped:
        warnings.warn(SceneWarning(f"scene: dropped {', '.join(sorted(dropped))}."), stacklevel=5)
    data: dict[str, Any] = {"shapes": shapes}
    if scene.has_camera:
        to_world, camera = np.asarray(scene.camera_transform), scene.camera
        eye, forward, up = to_world[:3, 3], -to_world[:3, 2], to_world[:3, 1]
        data["camera"] = {"position": eye, "target": eye + forward, "up": up, "fov": float(camera.fov[1])}
        data["film"] = {"resolution": [int(each) for each in camera.resolution]}
    return data


def _with_colours(data: Mapping[str, Any]) -> dict[str, Any]:
    """The dictionary with a material for each mesh of trimesh that has a colour, and is given no material."""
    if not isinstance(data.get("shapes", []), Sequence):
        return dict(data)
    materials = data.get("materials", {})
    shapes, new = [], {}
    for index, shape in enumerate(data.get("shapes", [])):
        table = shape
        if isinstance(shape, Mapping) and _of_trimesh(shape.get("mesh"), "Trimesh") and "material" not in shape:
            colour = _base_colour(shape["mesh"], f'scene["shapes"][{index}]["mesh"]')
            if colour is not None:
                name = f"mesh-{index}"
                new[name] = {"reflectance": colour.tolist()}
                table = {**shape, "material": name}
        shapes.append(table)
    return {**data, "shapes": shapes, **({"materials": {**new, **materials}} if new else {})}


def _base_colour(mesh: Any, what: str) -> Float64 | None:
    """(3,) linear Rec. 709; None where the mesh has no colour. Warns of what is dropped."""
    visual = mesh.visual
    kind = getattr(visual, "kind", None)
    dropped = []
    if kind == "texture":
        material = visual.material
        factor = getattr(material, "baseColorFactor", None)
        # glTF's factor is linear; the colours of other formats are encoded.
        colour = None if factor is None else np.asarray(factor, np.float64)[:3] / 255
        if colour is None and getattr(material, "diffuse", None) is not None:
            colour = decode_srgb(np.asarray(material.diffuse, np.float64)[:3] / 255)
        if colour is None:
            colour = np.full(3, 0.5)
        images = ("image", "baseColorTexture", "normalTexture", "metallicRoughnessTexture", "emissiveTexture")
        if any(getattr(material, name, None) is not None for name in images):
            dropped.append("its textures")
    elif kind in ("vertex", "face"):
        colours = np.unique(np.asarray(getattr(visual, f"{kind}_colors"))[:, :3], axis=0)
        colour = decode_srgb(colours.astype(np.float64) / 255).mean(axis=0)
        if len(colours) > 1:
            dropped.append(f"its {len(colours)} colours ({kind}), for their mean")
    else:
        return None
    if dropped:
        warnings.warn(SceneWarning(f"{what}: dropped {', '.join(dropped)}."), stacklevel=6)
    return np.clip(colour, 0.0, 1.0)
