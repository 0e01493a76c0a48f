"""Reader of Mitsuba's shapes: geometry, transforms, materials and area lights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from glpath.errors import encodable
from glpath.io.export.geometry import UniqueNames, uv_handedness
from glpath.io.meshes import has_uv_gaps, without_uv_gaps
from glpath.io.mitsuba import meshes
from glpath.io.mitsuba.document import error_of_kind
from glpath.io.mitsuba.plugin import Plugin
from glpath.io.mitsuba.surfaces import BsdfReader
from glpath.io.mitsuba.textures import Look, Textures
from glpath.io.transform import mirrors
from glpath.io.values import LARGEST
from glpath.scene.geometry import Float64, Mesh, Shape, placed
from glpath.scene.tessellate import unit_sphere, with_area
from glpath.scene.triangulate import turned
from glpath.system.time_limit import check_time

_FILES = {"obj": ".obj", "ply": ".ply", "serialized": ".serialized"}
_MADE: dict[str, Callable[[], Mesh]] = {
    "rectangle": meshes.rectangle,
    "cube": meshes.cube,
    "disk": meshes.disk,
}
_KINDS = dict.fromkeys((*_FILES, *_MADE, "cylinder", "sphere", "instance", "shapegroup"))
# Shapes whose normals define the front, so a mirroring transform does not exchange front and back. Instances and
# files with normals behave in the same manner. In other meshes, the order of the corners defines the front.
_OF_NORMALS = ("rectangle", "cube", "disk", "cylinder")
# Maximum number of instances of shapes, which take 400 MB. An instance of a group counts once for each shape.
_MAX_INSTANCES = 2**22
# Relative difference of a sphere's axes above which it is an ellipsoid.
_ELLIPSOID = 1e-4


@dataclass
class _Part:
    """Geometry, transform, material and emission of a shape before it is added to the scene."""

    geometry: Mesh | Literal["sphere"]
    world_from_object: Float64
    material: int
    emission: Float64


@dataclass
class Reader:
    """Reader that converts Mitsuba's shape plugins to `shapes`.

    notes : differences from Mitsuba, as sentences without a full stop
    """

    surfaces: BsdfReader
    textures: Textures
    shapes: list[Shape] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    _meshes: dict[tuple[object, ...], Mesh] = field(default_factory=dict)
    _serialized: meshes.SerializedFiles = field(default_factory=meshes.SerializedFiles)
    _with_normals: set[Mesh] = field(default_factory=set)
    _with_all_uv: dict[Mesh, Mesh] = field(default_factory=dict)
    _turned: dict[Mesh, Mesh] = field(default_factory=dict)
    _groups: dict[int, list[tuple[str, _Part]]] = field(default_factory=dict)
    _instances: dict[tuple[int, bool], list[Float64]] = field(default_factory=dict)
    _instance_count: int = 0
    _names: UniqueNames = field(default_factory=UniqueNames)

    def add(self, plugin: Plugin) -> None:
        """Read a shape, shape group or instance. Instances become shapes in `finish`. Raises SceneError."""
        check_time()
        if plugin.kind not in _KINDS:
            raise error_of_kind(plugin.element, "a shape", _KINDS, _remedy(plugin.kind))
        if plugin.kind == "shapegroup":
            self._group(plugin)
        elif plugin.kind == "instance":
            self._instance(plugin)
        else:
            name = self._name(plugin)
            for part in self._parts(plugin, name):
                self._put(name, part, plugin)

    def finish(self) -> None:
        """Add a shape for each instanced mesh, with the transforms of all its instances."""
        for (group, mirrored), own_maps in self._instances.items():
            worlds = np.stack(own_maps)
            for name, part in self._groups[group]:
                check_time()
                maps = _composed(worlds, part.world_from_object)
                material = self.surfaces.mirrored(part.material) if mirrored else part.material
                geometry, maps = self._facing(part.geometry, maps, mirrored, material)
                self.shapes.append(Shape(name, geometry, material, maps))

    def _put(self, name: str, part: _Part, plugin: Plugin) -> None:
        geometry, matrix = part.geometry, part.world_from_object
        if isinstance(geometry, Mesh):
            extent = np.abs(placed(geometry.vertices, matrix))
            if not np.all(extent <= LARGEST):
                raise plugin.location.error(f"reaches beyond {LARGEST:g} scene units.", "Check its transform.")
            geometry = with_area(geometry, matrix, name, plugin.location)
        self.shapes.append(Shape(name, geometry, part.material, matrix[None], part.emission))

    def _parts(self, plugin: Plugin, name: str) -> list[_Part]:
        """Return the parts of a shape: one, or two one-sided parts if its front and back have different BSDFs."""
        surface = next(iter(plugin.nested("bsdf")), None)
        emitter = self._emitter(plugin)
        emission, look = (np.zeros(3), None) if emitter is None else self._light(emitter)
        interior = next(iter(plugin.nested("medium", "interior")), None)
        back = self.surfaces.back(surface)
        flips = plugin.flag("flip_normals", False) != self.surfaces.is_turned(surface)
        geometry, world, mirrored = self._placed(plugin, self.surfaces.colour_attribute(surface))
        handedness = self._handedness(surface, geometry, flips != mirrored)
        number = self.surfaces.number(
            surface,
            interior,
            look,
            name,
            emits=emitter is not None,
            one_side=back is not None,
            uv_lengths=self._uv_lengths(surface, geometry, world),
            handedness=handedness,
        )
        parts = [_Part(*self._facing(geometry, world, flips != mirrored, number), number, emission)]
        if back is not None:
            geometry, world, _ = self._placed(plugin, self.surfaces.colour_attribute(back))
            # Mitsuba mirrors the frame of the front at the surface, so that green has the direction of the front.
            number = self.surfaces.number(
                back,
                None,
                None,
                f"{name}-back",
                one_side=True,
                uv_lengths=self._uv_lengths(back, geometry, world),
                handedness=self._handedness(back, geometry, flips != mirrored),
            )
            placed_back = self._facing(geometry, world, flips == mirrored, number)
            parts.append(_Part(*placed_back, number, np.zeros(3)))
        plugin.check_all_read()
        return parts

    def _uv_lengths(
        self, surface: Plugin | None, geometry: Mesh | Literal["sphere"], world: Float64
    ) -> tuple[float, float]:
        """Return the scene units of one u and one v; (1, 1) for a surface that does not depend on them."""
        if not self.surfaces.is_bumpy(surface):
            return 1.0, 1.0
        return meshes.uv_lengths(unit_sphere(3, with_uv=True) if geometry == "sphere" else geometry, world)

    def _handedness(self, surface: Plugin | None, geometry: Mesh | Literal["sphere"], reverse: bool) -> float:
        """Return the handedness of the texture coordinates, see `uv_handedness`; 1 without a normal map.

        reverse : True if front and back of the geometry are to be exchanged
        """
        if not self.surfaces.has_normal_map(surface):
            return 1.0
        mesh = unit_sphere(3, with_uv=True) if geometry == "sphere" else geometry
        # A mesh without texture coordinates gets those of `with_uv_of_triangles`, which are left-handed.
        handedness, differs = (-1.0, False) if mesh.uv is None else uv_handedness(mesh.uv, mesh.faces)
        if differs:
            self.notes["a normal map is inverted along green where texture coordinates are mirrored"] = None
        return -handedness if reverse else handedness

    def _placed(self, plugin: Plugin, attribute: str) -> tuple[Mesh | Literal["sphere"], Float64, bool]:
        """Return a shape's geometry, its (3, 4) transform to world, and True if front and back must be exchanged.

        attribute : mesh attribute that supplies the colours; empty if no attribute does
        """
        matrix = plugin.transform("to_world")
        if plugin.kind != "sphere":
            mesh = self._mesh(plugin, attribute)
            has_normals = plugin.kind in _OF_NORMALS or mesh in self._with_normals
            return mesh, matrix[:3], has_normals and mirrors(matrix)
        centre, radius = plugin.vector("center", (0, 0, 0)), plugin.number("radius", 1.0, 1e-15)
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = radius * np.eye(3), centre
        matrix = matrix @ local
        axes = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if axes[0] - axes[2] > _ELLIPSOID * axes[0]:
            self.notes["a sphere whose `to_world` stretches it is an ellipsoid, but a sphere in Mitsuba"] = None
        return "sphere", matrix[:3], False  # a mirroring transform turns the sphere's front inside, as in Mitsuba

    def _with_uv(self, mesh: Mesh, material: int) -> Mesh:
        """Return the mesh with texture coordinates for all vertices if the material has textures.

        Texture coordinates that only some vertices have are completed for any material.
        """
        is_textured, has_gaps = bool(self.surfaces.materials[material].slots), has_uv_gaps(mesh)
        if has_gaps and is_textured:
            self.notes["faces without texture coordinates show the first texel of their texture"] = None
        if not has_gaps and (mesh.uv is not None or not is_textured):
            return mesh
        if mesh not in self._with_all_uv:
            self._with_all_uv[mesh] = without_uv_gaps(mesh) if has_gaps else meshes.with_uv_of_triangles(mesh)
        return self._with_all_uv[mesh]

    def _facing(
        self, geometry: Mesh | Literal["sphere"], maps: Float64, reverse: bool, material: int
    ) -> tuple[Mesh | Literal["sphere"], Float64]:
        """Return the geometry and its transforms to world, with front and back exchanged if `reverse` is True.

        maps     : (..., 3, 4) transforms to world, one for each instance
        material : index of the material, whose textures need texture coordinates

        A mirrored transform exchanges front and back of a sphere. It would also mirror a texture, so a textured
        sphere becomes triangles instead.
        """
        if isinstance(geometry, Mesh):
            geometry = self._with_uv(geometry, material)
        if not reverse:
            return geometry, maps
        if geometry == "sphere":
            if not self.surfaces.materials[material].needs_uv:
                return geometry, turned(maps)
            geometry = unit_sphere(Shape.subdivisions, with_uv=True)
        if geometry not in self._turned:
            self._turned[geometry] = geometry.turned()
        return self._turned[geometry], maps

    def _mesh(self, plugin: Plugin, attribute: str) -> Mesh:
        """Return the mesh of a shape; shapes of the same file share a mesh."""
        if plugin.kind in _FILES:
            path: Path = plugin.element.file(plugin.text("filename"))
            options = ("face_normals", "flip_tex_coords")
            given = tuple(plugin.flag(name, name != "face_normals") if name in plugin else None for name in options)
            key: tuple[object, ...] = (
                path,
                given,
                plugin.whole("shape_index", 0) if plugin.kind == "serialized" else 0,
                attribute,
            )
            if key not in self._meshes:
                made, has_normals = meshes.read_file(
                    plugin, _FILES[plugin.kind], self._serialized, attribute=attribute
                )
                self._meshes[key] = made.without_unused_vertices()
                if has_normals:
                    self._with_normals.add(self._meshes[key])
        else:
            if attribute:
                raise plugin.location.error(f"has no attributes, but its surface asks for {attribute}.")
            if plugin.kind == "cylinder":
                start, end = plugin.vector("p0", (0, 0, 0)), plugin.vector("p1", (0, 0, 1))
                radius = plugin.number("radius", 1.0, 1e-15)
                if not np.linalg.norm(end - start) > 0:
                    raise plugin.location.error("has p0 and p1 at one point.", "Move one of them.")
                key = (plugin.kind, *start, *end, radius)
                if key not in self._meshes:
                    self._meshes[key] = meshes.cylinder(start, end, radius)
            else:
                key = (plugin.kind,)
                if key not in self._meshes:
                    self._meshes[key] = _MADE[plugin.kind]()
        return self._meshes[key]

    def _emitter(self, plugin: Plugin) -> Plugin | None:
        """Return the area light of a shape; None if it has none."""
        emitters = plugin.nested("emitter")
        if not emitters:
            return None
        if emitters[0].kind != "area" or len(emitters) > 1:
            raise error_of_kind(emitters[0].element, "light of a shape", {"area": None})
        return emitters[0]

    def _light(self, emitter: Plugin) -> tuple[Float64, Look | None]:
        """Return the radiance (3,) of an area light, and the image that multiplies it; None if it is uniform."""
        texture = emitter.texture("radiance")
        radiance = emitter.colour("radiance", 1.0, light=True) if texture is None else np.ones(3)
        if "sampling_weight" in emitter:
            emitter.number("sampling_weight", 1.0)
        emitter.check_all_read()
        return radiance, None if texture is None else self.textures.look(texture)

    def _group(self, plugin: Plugin) -> None:
        key = id(plugin.element)
        if key in self._groups:
            return
        parts = []
        for child in plugin.nested("shape"):
            if child.kind not in _KINDS or child.kind in ("instance", "shapegroup"):
                allowed = {kind: None for kind in _KINDS if kind not in ("instance", "shapegroup")}
                raise error_of_kind(child.element, "a shape of a group", allowed)
            name = self._name(child, plugin.id)
            made = self._parts(child, name)
            if made[0].emission.any():
                raise child.location.error("shines, but shapes of a group cannot.", "Take it out of the group.")
            parts += [(name, part) for part in made]
        plugin.check_all_read()
        self._groups[key] = parts

    def _instance(self, plugin: Plugin) -> None:
        groups = plugin.nested("shape")
        if len(groups) != 1 or groups[0].kind != "shapegroup":
            raise plugin.location.error(
                "must name one shapegroup.", '<ref id="..."/> of a <shape type="shapegroup">.'
            )
        self._group(groups[0])
        key, world = id(groups[0].element), plugin.transform("to_world")
        plugin.check_all_read()
        self._instance_count += len(self._groups[key])
        if self._instance_count > _MAX_INSTANCES:
            raise plugin.location.error(
                f"brings the scene to {self._instance_count:,} instances of shapes, but it may have "
                f"{_MAX_INSTANCES:,}.",
                "Use fewer instances, or join the shapes of their groups.",
            )
        self._instances.setdefault((key, mirrors(world)), []).append(world)

    def _name(self, plugin: Plugin, group: str = "") -> str:
        path = ""
        if plugin.kind in _FILES:
            path = encodable(Path(plugin.text("filename")).stem)
        return self._names.of(plugin.id or group or path or plugin.kind)


def _composed(after: Float64, world_from_object: Float64) -> Float64:
    """Return the affine maps (N, 3, 4) that apply `world_from_object` first and one of `after` (N, 4, 4) second."""
    return np.ascontiguousarray((after @ np.vstack([world_from_object, [0.0, 0.0, 0.0, 1.0]]))[:, :3])


def _remedy(kind: str) -> str:
    if kind in ("bsplinecurve", "linearcurve", "sdfgrid", "heightfield", "hair"):
        return "Make triangles of it, as PLY."
    return ""
