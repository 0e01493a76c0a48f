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
from glpath.film.units import conversion
from glpath.io.completed import completed, is_aside
from glpath.io.from_trimesh import Surfaces, lights
from glpath.io.gltf.surfaces import Surface
from glpath.io.load import scene_of
from glpath.io.meshes import mesh_of_trimesh
from glpath.scene.model import Light, Mesh, Scene, Shapes, Texture, moved_textures, shapes_are_built_by
from glpath.scene.source_location import PythonLocation, SourceLocation, shown
from glpath.system.arguments import plain_dictionary, short_repr
from glpath.system.suggestions import listed_names

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
        scene = plain_dictionary("scene", scene)
    elif _of_trimesh(scene, "Trimesh"):
        scene = {"shapes": [{"mesh": scene}], "unit": "photometric"}
    elif _of_trimesh(scene, "Scene"):
        found, others = lights(scene)
        return _complete(_dictionary(scene, others), PythonLocation("scene"), Path(), found)
    return _complete(scene, PythonLocation("scene"), Path())


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
    if isinstance(material, Mapping):
        data["materials"] = {"new": material}
        table["material"] = "new"
    part = _scene_with_looks(data, PythonLocation("shape"), Path(), "shape")
    (new,) = part.shapes
    if new.motion is not None:
        new = replace(new, world_from_object=new.at(scene.camera.shutter[0]).world_from_object)
    name = new.name if "name" in table else f"{new.kind}-{len(scene.shapes)}"
    if isinstance(material, str):
        number, materials = names.index(material), scene.materials
    else:
        number = len(scene.materials)
        moved = moved_textures(part.materials[new.material], len(scene.textures))
        materials = (*scene.materials, replace(moved, name=f"{name}"))
    return replace(
        scene,
        shapes=Shapes((*scene.shapes, replace(new, name=name, material=number))),
        materials=materials,
        textures=(*scene.textures, *part.textures),
    )


shapes_are_built_by(added)


def _complete(
    data: Mapping[str, Any], location: SourceLocation, folder: Path, lights: Sequence[Light] = ()
) -> Scene:
    """Return the scene of a dictionary with a camera and light. Warns of each part that had to be added."""
    scene = _scene_with_looks(
        {"camera": _NO_CAMERA, **data}, location, folder, str(data.get("name", location.source))
    )
    scene = replace(scene, lights=(*scene.lights, *lights))
    return completed(scene, has_camera="camera" in data)


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
        eye, forward, up = to_world[:3, 3], -to_world[:3, 2], to_world[:3, 1]
        data["camera"] = {
            "position": eye,
            "target": eye + forward,
            "up": up,
            "fov": float(camera.fov[1]),
            "pixel_aspect": float(camera.K[1, 1] / camera.K[0, 0]),
        }
        data["film"] = {"resolution": [int(each) for each in camera.resolution]}
    return data


def _scene_with_looks(data: Mapping[str, Any], location: SourceLocation, folder: Path, name: str) -> Scene:
    """Return the scene of a dictionary. trimesh meshes keep their own materials if their shapes name none."""
    shapes = data.get("shapes", [])
    if not isinstance(shapes, list | tuple):
        return scene_of(data, location, folder, name)
    surfaces = Surfaces()
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
                looks[index] = surface
        tables.append(table)
    scene = scene_of({**data, "shapes": tables}, location, folder, name)
    sky = data.get("sky")
    has_map = is_aside("sky") or (isinstance(sky, Mapping) and "file" in sky and "unit" not in sky)
    # Emission of 1 is as bright as a value of 1 in an environment map without a unit, as for glTF assets.
    factor = 1.0 if has_map and "unit" not in data else conversion("photometric", scene.unit)
    return _with_looks(scene, looks, surfaces.textures, factor)


def _with_looks(
    scene: Scene, looks: Mapping[int, Surface], textures: Sequence[Texture], emission_factor: float
) -> Scene:
    """Return the scene with the materials and the emission of `looks`.

    looks           : surface by index of its shape
    textures        : textures of these surfaces, which are appended to those of the scene
    emission_factor : factor that converts the emission of these surfaces to the unit of the scene
    """
    if not looks:
        return scene
    given = list(dict.fromkeys(map(id, looks.values())))
    by_id = {id(surface): surface for surface in looks.values()}
    materials = [moved_textures(by_id[each].material, len(scene.textures)) for each in given]
    used = [shape.material for index, shape in enumerate(scene.shapes) if index not in looks]
    kept = [index for index, m in enumerate(scene.materials) if m.name != "default" or index in used]
    number = {old: new for new, old in enumerate(kept)}
    shapes = []
    for index, shape in enumerate(scene.shapes):
        if index not in looks:
            shapes.append(replace(shape, material=number[shape.material]))
            continue
        surface = looks[index]
        shape = replace(shape, material=len(kept) + given.index(id(surface)))
        if not shape.emits and surface.emission.any():
            emission = emission_factor * surface.emission
            shape = replace(shape, emission=emission, emission_two_sided=surface.material.two_sided)
        shapes.append(shape)
    return replace(
        scene,
        shapes=Shapes(shapes),
        materials=(*(scene.materials[index] for index in kept), *materials),
        textures=(*scene.textures, *textures),
    )
