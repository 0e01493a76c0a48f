"""Export of a scene as binary glTF 2.0 (.glb), for any program that reads it.

Triangles are those that path tracing renders; `gltf_surfaces` writes the materials. Lengths are not scaled. Light
is in candela, lux and nits, as in glTF; a radiometric scene is converted by 179 lumens per watt. Backs of one-sided
materials are black in glpath, and viewers do not draw them.

Poor at:  skies and ambient light, which core glTF does not have.
Source:   glTF 2.0 and its KHR extensions, https://registry.khronos.org/glTF
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glpath.io.export import gltf_json
from glpath.io.export.false_colours import Facets
from glpath.io.export.geometry import (
    Notes,
    at_opening,
    in_triangles,
    in_world,
    mirrors,
    v_downwards,
    with_all_normals,
)
from glpath.io.export.glb import Glb
from glpath.io.export.gltf_surfaces import LightMap, MaterialWriter
from glpath.io.export.tangents import tangent_slot, with_tangents
from glpath.io.gltf.surfaces import BLACK_BACKS
from glpath.scene.geometry import IDENTITY, Float64, Mesh, Shape
from glpath.scene.model import Light, Scene
from glpath.system.units import conversion

# Maximum cosine between two axes of a transform that counts as unsheared.
_SHEAR = 1e-6
# Minimum difference of the inner and the outer angle of a spot, radians. glTF requires inner < outer <= pi / 2.
_EDGE = 1e-4


def write_gltf(
    scene: Scene, path: Path, light_maps: Sequence[LightMap] | None = None, facets: Facets | None = None
) -> tuple[str, ...]:
    """Write the scene. Raises SceneError and ImageError.

    light_maps : light map of each shape, written as MOZ_lightmap of its material; an image used twice is stored
                 once
    facets     : faces in false colours that are shown in the scene

    Returns the differences between the file and the scene, a sentence each.
    """
    return _Writer(scene, light_maps).write(path, facets)


class _Writer:
    def __init__(self, scene: Scene, light_maps: Sequence[LightMap] | None = None) -> None:
        self.notes = Notes()
        self._light_maps = light_maps
        scene = at_opening(scene, self.notes).centred
        self.scene = in_triangles(scene, self.notes)
        if scene.camera.projection == "panorama":
            self.notes.add("glTF has no panorama: the camera is a perspective one of 90 degrees")
        if scene.camera.aperture_radius > 0:
            self.notes.add("the camera's lens is left out: everything is sharp")
        if scene.camera.principal_point != (0.5, 0.5):
            self.notes.add("the camera's principal point is left out: the view is to the middle of the picture")
        self.file = Glb(scene)
        # Accessors of a mesh, by mesh and by the material that defines its tangents; None for no tangents.
        self._arrays: dict[tuple[Mesh, int | None], tuple[dict[str, int], int]] = {}
        self._turned: dict[Mesh, Mesh] = {}
        self._meshes: dict[tuple[Mesh, int], int] = {}
        self._surfaces = MaterialWriter(self.scene, self.file, self.notes)

    def write(self, path: Path, facets: Facets | None = None) -> tuple[str, ...]:
        for number, shape in enumerate(self.scene.shapes):
            self._add_shape(shape, None if self._light_maps is None else self._light_maps[number])
        if self.scene.lights:
            name = self.file.use("KHR_lights_punctual")
            self.file.extensions[name] = {"lights": [self._light(light) for light in self.scene.lights]}
            for i, light in enumerate(self.scene.lights):
                matrix = np.concatenate([_axes_along(light.direction), light.position[:, None]], axis=1)
                self.file.add_node(light.name, matrix, extensions={name: {"light": i}})
        for what, present in (("the sky", self.scene.sky), ("ambient light", np.any(self.scene.ambient > 0))):
            if present:
                self.notes.add(f"{what} is left out")
        if facets is not None:
            facets.add_to(self.file, self.scene.origin)
        backs = {} if self._surfaces.culls else BLACK_BACKS
        self.file.save(path, **backs, **({} if facets is None else facets.legend))
        return self.notes.texts

    # Geometry

    def _add_shape(self, shape: Shape, light: LightMap | None) -> None:
        mesh = shape.geometry
        assert isinstance(mesh, Mesh)
        material = self._surfaces.material(shape, light)
        slot = tangent_slot(self.scene.materials[shape.material])
        tangents_of = None if slot is None else shape.material
        for matrix in shape.world_from_object:
            placed, at = mesh, matrix
            if _is_sheared(matrix):  # glTF forbids shear
                alone = Shape(shape.name, mesh, shape.material, matrix[None])
                placed, at = in_world(alone), IDENTITY
            elif mirrors(matrix):
                if mesh not in self._turned:
                    self._turned[mesh] = mesh.turned()
                placed = self._turned[mesh]
            number = self._mesh(placed, material, tangents_of, shape.name)
            self.file.add_node(shape.name, None if np.array_equal(at, IDENTITY) else at, mesh=number)

    def _mesh(self, mesh: Mesh, material: int, tangents_of: int | None, name: str) -> int:
        key = (mesh, material)
        if key not in self._meshes:
            if (mesh, tangents_of) not in self._arrays:
                self._add_arrays(mesh, tangents_of)
            attributes, indices = self._arrays[mesh, tangents_of]
            primitive = gltf_json.Primitive(attributes=attributes, indices=indices, material=material)
            self._meshes[key] = self.file.add_mesh(name, [primitive])
        return self._meshes[key]

    def _add_arrays(self, mesh: Mesh, tangents_of: int | None) -> None:
        whole, tangents = with_all_normals(mesh), None
        if tangents_of is not None:
            slot = tangent_slot(self.scene.materials[tangents_of])
            assert slot is not None
            whole, tangents = with_tangents(mesh, slot)
        arrays = {"POSITION": whole.vertices}
        if whole.normals is not None:
            arrays["NORMAL"] = whole.normals
        if tangents is not None:
            arrays["TANGENT"] = tangents
        if whole.uv is not None or whole.uv1 is not None:
            # TEXCOORD_1 is only allowed together with TEXCOORD_0.
            arrays["TEXCOORD_0"] = np.zeros((len(whole.vertices), 2)) if whole.uv is None else v_downwards(whole.uv)
        if whole.uv1 is not None:
            arrays["TEXCOORD_1"] = v_downwards(whole.uv1)
        if whole.colours is not None:
            arrays["COLOR_0"] = np.clip(whole.colours, 0.0, 1.0)
        attributes = {
            name: self.file.add_array(array.astype(np.float32), bounds=name == "POSITION")
            for name, array in arrays.items()
        }
        indices = self.file.add_array(whole.faces.astype(np.uint32).ravel(), indices=True)
        self._arrays[mesh, tangents_of] = attributes, indices

    # Lights

    def _light(self, light: Light) -> dict[str, Any]:
        intensity = conversion(self.scene.unit, "photometric") * light.intensity
        if light.falloff == "none" and light.kind != "directional":
            low, high = self.file.bounds
            intensity = intensity * float(np.sum((light.position - 0.5 * (low + high)) ** 2))
            self.notes.add(
                "it falls off with the square of the distance; at the scene's centre its brightness stays",
                "light",
                light.name,
            )
        if light.profile is not None:
            self.notes.add("its profile is left out: it emits its mean in all directions", "light", light.name)
            intensity = intensity * (light.profile.flux / (4 * math.pi))
        max_intensity = float(intensity.max())
        made: dict[str, Any] = {"name": light.name, "type": light.kind, "intensity": max_intensity}
        made["color"] = (intensity / max_intensity).tolist() if max_intensity > 0 else [1.0, 1.0, 1.0]
        if light.kind == "spot":
            if light.cone[1] > 90:
                self.notes.add("its cone ends at 90 degrees", "light", light.name)
            outer = min(math.radians(light.cone[1]), 0.5 * math.pi)
            made["spot"] = {
                "innerConeAngle": max(min(math.radians(light.cone[0]), outer - _EDGE), 0.0),
                "outerConeAngle": outer,
            }
        return made


def _is_sheared(matrix: Float64) -> bool:
    columns = matrix[:, :3] / np.linalg.norm(matrix[:, :3], axis=0)
    return bool(np.abs(columns.T @ columns - np.eye(3)).max() > _SHEAR)


def _axes_along(direction: Float64) -> Float64:
    """Return the (3, 3) axes of a node whose -z points along a unit direction."""
    z = -direction
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
