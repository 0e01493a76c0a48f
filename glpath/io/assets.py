"""Assets of a scene file, which are models with their own materials or with materials of the scene file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from msgspec import UnsetType

from glpath.errors import encodable, warn
from glpath.io import transform
from glpath.io.description import Asset
from glpath.io.gltf import Model, limits
from glpath.io.gltf.document import SUFFIXES as GLTF_FORMATS
from glpath.io.gltf.load import OpenFile
from glpath.io.models import FORMATS, read_model
from glpath.io.motion import motion_of
from glpath.io.up_axis import axis_vector
from glpath.io.values import LARGEST, nearby_files, unknown
from glpath.scene import tessellate
from glpath.scene.camera import upright_from_world
from glpath.scene.model import Float64, Light, Material, Mesh, Shape, Texture, moved_textures
from glpath.scene.motion import Motion
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.files import absence_of
from glpath.system.suggestions import listed_names, similar_names
from glpath.system.units import Unit, conversion


@dataclass(frozen=True)
class _Read:
    """Loaded model, and the index of its first material in the scene's list of materials."""

    model: Model
    first_material: int


@dataclass
class Assets:
    """Assets of one scene. A file is read once for each animation time, and assets of one file share meshes.

    folder      : base folder of relative paths
    number      : index in `materials` by name, for the materials of the scene file
    materials   : materials of the scene file, followed by those of the assets
    textures    : textures of the scene file, followed by those of the assets
    shutter     : times at which the camera's shutter opens and closes, seconds, for moving assets
    unit        : unit of light in the scene
    beside_map  : True if the scene has no unit, and an environment map without a unit. Photometric numbers of a
                  model are then used unchanged, except for assets with a `unit` in the scene file
    animated    : True if an asset was read at a time of its animation
    photometric : file of the first asset that has photometric light but no `unit` in the scene file; empty if none
    """

    folder: Path
    number: Mapping[str, int]
    materials: list[Material]
    textures: list[Texture]
    shutter: tuple[float, float] = (0.0, 0.0)
    unit: Unit = "radiometric"
    beside_map: bool = False
    photometric: str = ""
    animated: bool = False
    shapes: list[Shape] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    _read: dict[tuple[Path, float | None], _Read] = field(default_factory=dict)
    _reported: set[str] = field(default_factory=set)
    _repeated: set[Path] = field(default_factory=set)  # files that are shown at several times
    _open_files: dict[Path, OpenFile] = field(default_factory=dict)
    _decoded: int = 0  # bytes of all glTF files together
    _stored: dict[Path, int] = field(default_factory=dict)  # bytes of each glTF file
    _meshes: dict[tuple[Mesh, bool, bool], Mesh] = field(default_factory=dict)

    def add(self, given: Sequence[Asset], location: SourceLocation) -> None:
        """Add the assets that the scene file lists.

        location : location of the list in the scene file

        Raises SceneError. Warns once per file of each kind of unused content.
        """
        times: dict[Path, set[object]] = {}
        for asset in given:
            times.setdefault(self.folder / asset.file, set()).add(asset.time)
        self._repeated = {path for path, of_file in times.items() if len(of_file) > 1}
        for index, asset in enumerate(given):
            self._add(asset, location.item(index))
        self._open_files.clear()

    def _add(self, given: Asset, location: SourceLocation) -> None:
        read = self._model(given, location)
        model, path = read.model, Path(given.file)
        name = encodable(path.stem) if isinstance(given.name, UnsetType) else given.name
        world = transform.world_from_shape(given.transform, location.field("transform"))
        if not isinstance(given.up, UnsetType):
            world[:3, :3] = world[:3, :3] @ upright_from_world(axis_vector(given.up))
        is_flat = np.isfinite(world).all() and transform.flattens(world)
        replaced = self._replaced(given, read, location.field("materials"))
        moved = motion_of(given.motion, world[None, :3], location.field("motion"))
        began = 0.0 if isinstance(given.time, UnsetType) else given.time
        unit = model.unit if isinstance(given.unit, UnsetType) else given.unit
        factor = 1.0 if unit is None else conversion(unit, self.unit)
        if isinstance(given.unit, UnsetType) and unit == "photometric":
            factor = 1.0 if self.beside_map else factor
            lit = [shape for shape in model.shapes if not model.materials[shape.material].unlit]
            if any(shape.emits for shape in lit) or (given.lights and model.lights):
                self.photometric = self.photometric or given.file
        for shape in model.shapes:
            material, emission = read.first_material + shape.material, shape.emission
            if not self.materials[material].unlit:  # unlit materials have colours, not physical light
                emission = factor * emission
            if shape.material in replaced:
                # Emission is part of the replaced material, so the shape no longer emits.
                material, emission = replaced[shape.material], np.zeros(3)
            here = self._placed(shape, world, self.materials[material].needs_uv, location)
            if is_flat:
                assert isinstance(here.geometry, Mesh)
                full_name = f"{name}/{shape.name}"
                mesh = tessellate.with_area(here.geometry, here.world_from_object, full_name, location)
                here = replace(here, geometry=mesh)
            here = self._moving(here, shape.motion, world, moved, began)
            self.shapes.append(replace(here, name=f"{name}/{shape.name}", material=material, emission=emission))
        if given.lights:
            if moved is not None:
                world = np.concatenate([moved.at(self.shutter[0])[0], world[3:]])
                if model.lights and moved.moves_within(*self.shutter):
                    text = f"{location}: its punctual lights do not move; they stay where they are at shutter open."
                    warn(text)
            for light in model.lights:
                placed = _placed_light(light, world, f"{name}/{light.name}", location)
                self.lights.append(replace(placed, intensity=factor * light.intensity))

    def _model(self, given: Asset, location: SourceLocation) -> _Read:
        path, here = self.folder / given.file, location.field("file")
        time = None if isinstance(given.time, UnsetType) else given.time
        if path.suffix.lower() not in FORMATS:
            raise here.wrong(given.file, f"a model file that ends in {', '.join(FORMATS)}", "Export it as .glb.")
        if time is not None and path.suffix.lower() not in GLTF_FORMATS:
            raise location.field("time").error(f"is for animations of glTF files, but the file is {given.file}.")
        if not isinstance(given.up, UnsetType) and path.suffix.lower() in GLTF_FORMATS:
            raise location.field("up").error(
                f"is for formats that do not say what is up, but {given.file} is glTF, which has y up.",
                "Leave it out, or turn the model: transform = [{ rotate = { axis = [1, 0, 0], angle = -90 } }].",
            )
        if not os.path.isfile(path):  # Path.is_file may raise if the name is too long
            raise here.error(f"names {path}, which {absence_of(path)}.", nearby_files("Models", path, FORMATS))
        if (path, time) not in self._read:
            opened, closed = self.shutter
            began = None if time is None else time + opened
            model = read_model(path, here, began, closed - opened, self._open_files)
            self._count_decoded(path, here)
            self.animated |= model.animated
            if not model.shapes:
                raise here.error(f"names {path}, which has no triangles.", "Export the file with its meshes.")
            lost = ("The environment, because a scene has its own sky.",) if model.sky is not None else ()
            for note in (*model.notes, *lost):
                text = f"{model.source}: not used: {note}"
                if text not in self._reported:
                    self._reported.add(text)
                    warn(text)
            self._read[path, time] = _Read(model, len(self.materials))
            first = len(self.textures)
            for material in model.materials:
                moved = moved_textures(material, first)
                self.materials.append(replace(moved, name=f"{encodable(path.stem)}/{material.name}"))
            self.textures += model.textures
        return self._read[path, time]

    def _count_decoded(self, path: Path, location: SourceLocation) -> None:
        """Count what was decoded of a glTF file. Raises SceneError if the sum of all files exceeds the limit."""
        if path not in self._open_files:
            return
        document = self._open_files[path].document
        self._decoded += document.decoded
        self._stored[path] = document.stored
        stored = sum(self._stored.values())
        allowed = max(2 * limits.ALWAYS_DECODED_BYTES, limits.MAX_DECODED_RATIO * stored)
        if self._decoded > allowed:
            raise location.error(
                f"brings the models of the scene to {self._decoded:,} bytes of memory, but files of {stored:,} "
                f"bytes may unfold to {allowed:,}.",
                "Name fewer files, or show a file at fewer times.",
            )
        if path not in self._repeated:
            del self._open_files[path]

    def _moving(
        self, shape: Shape, own: Motion | None, world: Float64, moved: Motion | None, began: float
    ) -> Shape:
        """Return the placed shape with two motions combined, that of the shape and that of the asset.

        own   : motion of the shape within the model, at times of the model's animation; None if it does not move
        world : (4, 4) matrix from model space to the scene, without the asset's motion
        moved : motion of the asset in the scene; None if the asset does not move
        began : animation time at scene time 0, in seconds
        """
        if own is None and moved is None:
            return shape
        if own is None:
            assert moved is not None, "one of them is there"
            motion = replace(moved, placed=shape.world_from_object)
        else:
            times = own.times - began
            if moved is not None:
                inside = (moved.times > times[0]) & (moved.times < times[-1])
                times = np.union1d(times, moved.times[inside])
            maps = []
            for time in times:
                there = _product(world, own.map_at(time + began))
                maps.append(there if moved is None else _product(_square(moved.map_at(time)), there))
            motion = Motion(times, np.array(maps), own.placed)
        return replace(shape, world_from_object=motion.at(self.shutter[0]), motion=motion)

    def _replaced(self, given: Asset, read: _Read, location: SourceLocation) -> dict[int, int]:
        """Return a dictionary from replaced materials of the model to materials of the scene, both by index."""
        names = [material.name for material in read.model.materials]
        found: dict[int, int] = {}
        for old, new in given.materials.items():
            here = location.field(old)
            if old not in names:
                near = similar_names(old, names, 1)
                raise here.error(
                    f"is for a material that {given.file} does not have. It has {listed_names(map(shown, names))}.",
                    f"Did you mean {shown(near[0])}?" if near else "",
                )
            if new not in self.number:
                raise unknown("material", new, list(self.number), here, "reflectance = [r, g, b]")
            found |= {index: self.number[new] for index, name in enumerate(names) if name == old}
        return found

    def _placed(self, shape: Shape, world: Float64, textured: bool, location: SourceLocation) -> Shape:
        """Return the shape in world space. Raises SceneError if it is too large.

        textured : True if the material needs texture coordinates; missing ones are then added by projection
        """
        maps = shape.world_from_object
        whole = np.concatenate([maps, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(maps), 1, 4))], axis=1)
        maps = np.asarray(world[:3] @ whole)
        assert isinstance(shape.geometry, Mesh)
        mesh = shape.geometry
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        centre = maps[:, :, :3] @ ((low + high) / 2) + maps[:, :, 3]
        if not np.all(np.abs(centre) + np.abs(maps[:, :, :3]) @ ((high - low) / 2) <= LARGEST):
            raise location.error(
                f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.",
                "Check its transform, or choose a larger unit of length.",
            )
        key = (mesh, textured and mesh.uv is None, transform.mirrors(world))
        if key not in self._meshes:
            made = tessellate.with_projected_uv(mesh) if key[1] else mesh
            self._meshes[key] = made.turned() if key[2] else made
        return replace(shape, geometry=self._meshes[key], world_from_object=maps)


def _square(m: Float64) -> Float64:
    return np.concatenate([m[:3], [[0.0, 0.0, 0.0, 1.0]]])


def _product(a: Float64, b: Float64) -> Float64:
    """Return the (3, 4) affine map that applies `b` (3, 4) first, and then `a` (4, 4)."""
    return np.asarray(a[:3] @ _square(b))


def _placed_light(light: Light, world: Float64, name: str, location: SourceLocation) -> Light:
    """Return the light in world space, with its profile turned or mirrored. Raises SceneError if that is flattened.

    world    : (4, 4) matrix from model space to the scene
    location : location of the asset
    """
    linear = world[:3, :3]
    position = linear @ light.position + world[:3, 3]
    direction = linear @ light.direction
    direction = direction / np.linalg.norm(direction)
    c0, profile = light.c0, light.profile
    if light.profile is not None:
        c0 = linear @ light.c0
        length = np.linalg.norm(c0)
        c0 = c0 - (c0 @ direction) * direction  # perpendicular to `direction` even if the asset is sheared
        if not np.linalg.norm(c0) > 1e-9 * length:
            raise location.field("transform").error(
                f"flattens the profile of the light {shown(light.name)}, which needs two directions.",
                "Check its scale, or set lights = false.",
            )
        c0 = c0 / np.linalg.norm(c0)
        profile = light.profile.mirrored if transform.mirrors(world) else profile
    return replace(light, name=name, position=position, direction=direction, c0=c0, profile=profile)
