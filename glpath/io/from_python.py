"""Scenes that are made in Python: dictionaries with arrays, and meshes and scenes of trimesh.

A missing camera or missing light is added, and a SceneWarning reports it. trimesh is not imported here, because a
caller who passes one of its objects has imported it. Meshes of trimesh keep their own materials, unless the caller
gives them others.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from glpath.errors import UsageError, warn
from glpath.io.build import Supplied
from glpath.io.completed import completed, is_aside
from glpath.io.from_trimesh import TrimeshMaterials, lights
from glpath.io.gltf.surfaces import Surface
from glpath.io.load import check_no_camera_is_needed, scene_of, up_without_camera
from glpath.io.meshes import mesh_of_trimesh
from glpath.scene.model import Mesh, Scene, Shapes, moved_textures, shapes_are_built_by
from glpath.scene.source_location import PythonLocation, SourceLocation, shown
from glpath.system.arguments import plain_dictionary, short_repr
from glpath.system.suggestions import listed_names
from glpath.system.units import conversion

if TYPE_CHECKING:
    import trimesh

    AnyScene: TypeAlias = str | Path | Scene | Mapping[str, Any] | trimesh.Trimesh | trimesh.Scene
else:
    AnyScene = Any

_NO_CAMERA = {"position": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0]}


def is_made_in_python(scene: object) -> bool:
    """Return True if the scene is a dictionary or an object of trimesh."""
    return isinstance(scene, Mapping) or _of_trimesh(scene, "Trimesh") or _of_trimesh(scene, "Scene")


def scene_from_python(scene: Any) -> Scene:
    """Return the scene of a dictionary, a `trimesh.Trimesh` or a `trimesh.Scene`; see `load_scene`."""
    if isinstance(scene, Mapping):
        data = plain_dictionary("scene", scene)
        if "camera" in data:
            return completed(_with_placeholder(data), has_camera=True)
        check_no_camera_is_needed(data, PythonLocation("scene"))
        made = _with_placeholder(data)
        up, remedy = up_without_camera(data, made), "with_camera(up=[0, 1, 0])"
        return completed(made, has_camera=False, up=up, up_remedy=remedy)
    if _of_trimesh(scene, "Trimesh"):
        made = _with_placeholder({"shapes": [{"mesh": scene}], "unit": "photometric"})
        return completed(made, has_camera=False)
    found, others = lights(scene)
    data = _dictionary(scene, others)
    made = _with_placeholder(data)
    return completed(replace(made, lights=(*made.lights, *found)), has_camera="camera" in data)


def added(scene: Scene, shape: Any, material: str | Mapping[str, Any] | None, fields: Mapping[str, Any]) -> Scene:
    """Return the scene with a shape added; see `Scene.add`."""
    if not isinstance(shape, Mapping | Mesh) and not _of_trimesh(shape, "Trimesh"):
        raise UsageError(
            f"shape: {short_repr(shape)} where a dictionary, a Mesh or a trimesh.Trimesh is needed",
            'For example {"type": "sphere", "center": [0, 0, 0], "radius": 1}.',
        )
    table = {**({"mesh": shape} if _of_trimesh(shape, "Trimesh") or isinstance(shape, Mesh) else shape), **fields}
    names = [each.name for each in scene.materials]
    if isinstance(material, str) and material not in names:
        raise UsageError(
            f"Scene.add: material = {shown(material)}, but the scene has {listed_names(names) or 'none'}.",
            "Name one of them, or describe a new one: material={'reflectance': [0.8, 0.2, 0.2]}.",
        )
    data: dict[str, Any] = {"camera": _NO_CAMERA, "shapes": [table], "unit": scene.unit}
    supplied = Supplied(camera=scene.camera)
    if isinstance(material, str):
        table["material"] = material
        supplied = replace(supplied, materials={0: scene.materials[names.index(material)]}, textures=scene.textures)
    elif isinstance(material, Mapping):
        data["materials"] = {"new": material}
        table["material"] = "new"
    part = _scene_with_looks(data, PythonLocation("shape"), Path(), "shape", supplied)
    (new,) = part.shapes
    name = new.name if "name" in table else f"{new.kind}-{len(scene.shapes)}"
    if isinstance(material, str):
        number, materials, textures = names.index(material), scene.materials, scene.textures
    else:
        number = len(scene.materials)
        moved = moved_textures(part.materials[new.material], len(scene.textures))
        materials = (*scene.materials, replace(moved, name=f"{name}"))
        textures = (*scene.textures, *part.textures)
    return replace(
        scene,
        shapes=Shapes((*scene.shapes, replace(new, name=name, material=number))),
        materials=materials,
        textures=textures,
    )


shapes_are_built_by(added)


def _with_placeholder(data: Mapping[str, Any]) -> Scene:
    """Return the scene of a dictionary, with a placeholder for a missing camera."""
    location = PythonLocation("scene")
    name = str(data.get("name", location.source))
    return _scene_with_looks({"camera": _NO_CAMERA, **data}, location, Path(), name)


# --- trimesh ---


def _of_trimesh(value: object, kind: str) -> bool:
    module = sys.modules.get("trimesh")
    return module is not None and isinstance(value, getattr(module, kind, ()))


def _dictionary(scene: Any, others: Sequence[str]) -> dict[str, Any]:
    """Return a `trimesh.Scene` as a dictionary of the scene format: a shape for each node, and its camera if any.

    others : names of unused lights, which the warning of unused parts includes
    """
    shapes: list[dict[str, Any]] = []
    dropped = set(others)
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not _of_trimesh(geometry, "Trimesh"):
            dropped.add(f"{type(geometry).__name__} {shown(str(name))}")
            continue
        shapes.append(
            {"mesh": geometry, "name": str(node), "transform": [{"matrix": np.asarray(transform).tolist()}]}
        )
    if dropped:
        warn(f"scene: dropped {', '.join(sorted(dropped))}.")
    data: dict[str, Any] = {"shapes": shapes, "unit": "photometric"}  # as in glTF, which trimesh follows
    if scene.has_camera:
        to_world, camera = np.asarray(scene.camera_transform), scene.camera
        aspect = camera.K[1, 1] / camera.K[0, 0]
        eye, forward, up = to_world[:3, 3], -to_world[:3, 2], to_world[:3, 1]
        data["camera"] = {
            "position": eye,
            "target": eye + forward,
            "up": up,
            "fov": float(camera.fov[1]),
            "pixel_aspect": 1.0 if np.isclose(aspect, 1.0, rtol=1e-9) else float(aspect),  # K is rounded
        }
        data["film"] = {"resolution": [int(each) for each in camera.resolution]}
    return data


def _emits_back(shape: Mapping[str, Any]) -> bool:
    """Return True if the table of a shape has an emission with `two_sided`."""
    emission = shape.get("emission")
    two_sided = emission.get("two_sided") if isinstance(emission, Mapping) else None
    return isinstance(two_sided, bool | np.bool_) and bool(two_sided)


def _scene_with_looks(
    data: Mapping[str, Any],
    location: SourceLocation,
    folder: Path,
    name: str,
    supplied: Supplied | None = None,
) -> Scene:
    """Return the scene of a dictionary. trimesh meshes keep their own materials if their shapes name none.

    supplied : materials and camera that replace those of the dictionary
    """
    shapes = data.get("shapes", [])
    if not isinstance(shapes, list | tuple):
        return scene_of(data, location, folder, name)
    surfaces = TrimeshMaterials()
    made: dict[int, tuple[Mesh, Surface | None]] = {}  # by id(), so that instances share a mesh
    looks: dict[int, Surface] = {}
    tables = []
    for index, shape in enumerate(shapes):
        table = shape
        if isinstance(shape, Mapping) and _of_trimesh(shape.get("mesh"), "Trimesh") and "material" not in shape:
            given = shape["mesh"]
            if id(given) not in made:
                here = location.field("shapes").item(index).field("mesh")
                made[id(given)] = surfaces.of(given, mesh_of_trimesh(given, here), here)
            mesh, surface = made[id(given)]
            table = {**shape, "mesh": mesh}
            if surface is not None:
                # The caller's emission decides: a back that is to emit must not be culled.
                lit = replace(surface.material, two_sided=True, culled=False) if _emits_back(shape) else None
                looks[index] = surface if lit is None else replace(surface, material=lit)
        tables.append(table)
    if looks:
        own = {index: surface.material for index, surface in looks.items()}
        supplied = replace(supplied or Supplied(), materials=own, textures=surfaces.textures)
    scene = scene_of({**data, "shapes": tables}, location, folder, name, supplied=supplied)
    sky = data.get("sky")
    has_map = is_aside("sky") or (isinstance(sky, Mapping) and "file" in sky and "unit" not in sky)
    # Emission of 1 is as bright as a value of 1 in an environment map without a unit, as for glTF assets.
    factor = 1.0 if has_map and "unit" not in data else conversion("photometric", scene.unit)
    lamps = {
        index: (factor * surface.emission, surface.material.two_sided)
        for index, surface in looks.items()
        if surface.emission.any() and not scene.shapes[index].emits
    }
    if not lamps:
        return scene
    changed = [
        replace(shape, emission=lamps[index][0], emission_two_sided=lamps[index][1]) if index in lamps else shape
        for index, shape in enumerate(scene.shapes)
    ]
    return replace(scene, shapes=Shapes(changed))
