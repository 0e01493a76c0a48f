"""Read mesh files as models, with one shape for each material of an OBJ, and with textures and colours."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from glpath.errors import encodable, warn
from glpath.io.from_trimesh import surface_of_colours
from glpath.io.gltf import Model
from glpath.io.gltf.surfaces import Surface
from glpath.io.meshes import UV_GAPS, MeshFile, has_uv_gaps, read_mesh_file, which, without_uv_gaps
from glpath.io.mtl import Library
from glpath.io.pictures import Pictures
from glpath.io.values import LARGEST
from glpath.scene.geometry import IDENTITY
from glpath.scene.model import Material, Mesh, Shape, Texture, TextureSlot
from glpath.scene.source_location import SourceLocation
from glpath.scene.tessellate import with_area, without_area
from glpath.system.time_limit import check_time

_UNUSED = "Colours, of some vertices only or beside materials, textures or their coordinates."
_UNUSED_OF = {".off": "Colours. Those of PLY files are read."}
_GREY = Surface(Material("default", np.full(3, 0.5)), np.zeros(3))


def read_mesh_model(path: Path, location: SourceLocation) -> Model:
    """Read a mesh file as a model. The suffix of the file must be one of `meshes.FORMATS`.

    location : location in the scene file that names this mesh file, for errors

    Raises SceneError for a file that is missing, broken or without triangles, and for faces that name missing
    vertices. Warns of triangles without area.
    """
    file = read_mesh_file(path, location, colours=True, smooth=True)
    return _Reader(path, location, file).model()


@dataclass
class _Reader:
    path: Path
    location: SourceLocation
    file: MeshFile
    surfaces: list[Surface] = field(default_factory=list)
    numbers: dict[int, int] = field(default_factory=dict)  # index in `surfaces` by id() of a surface
    textures: list[Texture] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the model: the file name without its suffix."""
        return encodable(self.path.stem)

    def model(self) -> Model:
        library = Library(self.path.parent, self.textures, self.notes)
        plain = self.file.obj
        for name in plain.libraries if plain is not None else ():
            library.add(name)
        shapes: list[Shape] = []
        uses_colours = False
        if self.file.ply is not None:
            self.notes |= dict.fromkeys(self.file.ply.notes)
        for mesh, number in zip(self.file.meshes, self.file.materials, strict=True):
            check_time()
            if not np.all(np.abs(mesh.vertices) <= LARGEST):
                prefix = which(self.path, self.location)
                raise self.location.error(
                    f"{prefix}reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.",
                    "Choose a larger unit of length.",
                )
            defined = None
            if plain is not None and number >= 0:
                name = plain.materials[number]
                defined = library.surface(name)
            else:
                name = self.name if len(self.file.meshes) == 1 else f"{self.name}-{len(shapes)}"
            if defined is not None:
                mesh, surface = replace(mesh, colours=None), self._with_coordinates(defined, mesh)
            else:
                mesh, surface = self._plain(mesh)
                uses_colours |= surface.material.name in ("colours", "colour")
            mesh = without_uv_gaps(mesh).without_unused_vertices()
            if len(self.file.meshes) > 1 and without_area(mesh.vertices[mesh.faces]).all():
                self.notes[f'"{name}", which has no area.'] = None
                continue
            mesh = with_area(mesh, IDENTITY, name, self.location)
            shapes.append(Shape(name, mesh, self._index(surface), IDENTITY[None], surface.emission, True))
        if self.file.coloured and not uses_colours:
            self.notes[_UNUSED_OF.get(self.path.suffix.lower(), _UNUSED)] = None
        if plain is not None and plain.guess and uses_colours:
            warn(f"{self.path}: colours of its vertices: {plain.guess}.")
        self.notes |= dict.fromkeys(library.pictures.files.notes())
        return Model(
            source=str(self.path),
            name=self.name,
            shapes=tuple(shapes),
            materials=tuple(surface.material for surface in self.surfaces),
            textures=tuple(self.textures),
            lights=(),
            cameras=(),
            camera=None,
            notes=tuple(self.notes),
        )

    def _index(self, surface: Surface) -> int:
        index = self.numbers.setdefault(id(surface), len(self.surfaces))
        if index == len(self.surfaces):
            self.surfaces.append(surface)
        return index

    def _with_coordinates(self, surface: Surface, mesh: Mesh) -> Surface:
        """Return the surface, without its textures if the mesh has no texture coordinates."""
        if not surface.material.slots:
            return surface
        if mesh.uv is not None:
            if has_uv_gaps(mesh):
                self.notes[UV_GAPS] = None
            return surface
        self.notes["Textures of faces without texture coordinates."] = None
        material = replace(surface.material, **dict.fromkeys(surface.material.slots))  # type: ignore[arg-type]
        return replace(surface, material=material)

    def _plain(self, mesh: Mesh) -> tuple[Mesh, Surface]:
        """Return the mesh and its surface, for a mesh without an MTL material.

        The surface has the texture of the PLY file. If it cannot be used, it has the colours of the mesh, otherwise
        grey.
        """
        textures = self.file.ply.textures if self.file.ply is not None else ()
        if len(textures) > 1:
            self.notes[f"Textures but the first of {len(textures)}."] = None
        textured = self._textured(textures[0]) if textures else None
        if textured is not None:
            textured = self._with_coordinates(textured, mesh)
            if textured.material.slots or mesh.colours is None:
                # Scanning programs write vertex colours that repeat the texture, so these colours are dropped.
                return replace(mesh, colours=None), textured
        if mesh.colours is None:
            return mesh, _GREY
        return surface_of_colours(mesh)

    def _textured(self, name: str) -> Surface | None:
        """Return the surface of a texture; None, with a note, if there is no such picture."""
        pictures = Pictures(self.path.parent)
        image = pictures.picture(name)
        self.notes |= dict.fromkeys(pictures.files.notes())
        if image is None:
            return None
        self.textures.append(Texture(name, image[..., :3], srgb=image.dtype == np.uint8))
        slot = TextureSlot(len(self.textures) - 1)
        return Surface(Material("texture", np.ones(3), texture=slot), np.zeros(3))
