"""Reading of glTF 2.0 models by `read_gltf`.

`Model.notes` lists the unused contents of a file. Forbidden contents raise a SceneError that names their location.
They are paths that leave the folder, wrong lengths, and cycles of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from glpath.errors import UsageError, warn
from glpath.io.gltf import limits
from glpath.io.gltf.accessors import Accessors
from glpath.io.gltf.animation import poses_at, shutter_times
from glpath.io.gltf.choices import animation_names, chosen_animations, chosen_variant, material_of
from glpath.io.gltf.document import Document, read_document
from glpath.io.gltf.environment import environment_of
from glpath.io.gltf.lights import ModelCamera, camera_of, light_of
from glpath.io.gltf.nodes import INSTANCING, Nodes, instances
from glpath.io.gltf.primitives import ONLY_TRIANGLES, Primitives, Skin, is_solid, skin_of
from glpath.io.gltf.profiles import Profiles
from glpath.io.gltf.surfaces import MaterialReader, has_black_backs
from glpath.io.gltf.table import Table
from glpath.io.precision import step_at, warn_of_steps
from glpath.io.values import LARGEST
from glpath.scene.appearance import opacity_of
from glpath.scene.model import Float64, Light, Material, Mesh, Shape, Texture
from glpath.scene.motion import Motion
from glpath.scene.sight import winding_number
from glpath.scene.source_location import shown
from glpath.scene.tessellate import without_area
from glpath.sky.sky import Environment
from glpath.system.suggestions import listed_names
from glpath.system.time_limit import check_time
from glpath.system.units import Unit

# Minimum ratio of the shortest to the longest axis of a transformed unit sphere. A flatter instance counts as a
# plane, because 32-bit floats do not separate its front and back.
_FLAT = 1e-7
# Maximum number of faces of a mesh that is tested for being closed; a larger mesh counts as open.
_LONG_TEST = 2**20
# Maximum number of faces in all tests of whether a mesh encloses a camera; they take about 20 s. If there are more,
# the other meshes count as enclosing it.
_LONG_TESTS = 2**25
# Number of faces that take as long as the other work of a test of a mesh, and of a test of bounding boxes; and
# number of boxes that take as long as a face.
_FACES_PER_TEST, _FACES_PER_BOXES, _BOXES_PER_FACE = 256, 32, 16
# Maximum number of meshes that a note names.
_NAMES = 20
# Fields of a node that may deform its mesh.
_OF_ITS_OWN = {"skin", "weights"}
_MIRRORED = " (mirrored)"


@dataclass(frozen=True)
class Model:
    """Model file in glpath's own data types.

    source    : path of the file
    name      : name of the scene in the file, or else of the file
    shapes    : one shape for each primitive, with all its instances
    lights    : punctual lights
    cameras   : all cameras of the scene
    camera    : requested camera, otherwise the first; None if there is no camera
    shutter   : animation times at which the shutter opens and closes, seconds; (0, 0) if animations do not run
    notes     : unused contents of the file, without duplicates
    unit      : unit of the model's light; None if the format has no unit
    sky       : environment; None if the file has no environment
    animated  : True if an animation runs that sets values of a node
    """

    source: str
    name: str
    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    textures: tuple[Texture, ...]
    lights: tuple[Light, ...]
    cameras: tuple[ModelCamera, ...]
    camera: ModelCamera | None
    notes: tuple[str, ...]
    shutter: tuple[float, float] = (0.0, 0.0)
    unit: Unit | None = None
    sky: Environment | None = None
    animated: bool = False


def read_gltf(
    path: Path,
    *,
    time: float | None = None,
    shutter: float = 0.0,
    camera: str | int | None = None,
    animation: str | None = None,
    variant: str | None = None,
    light_factor: float = 1.0,
    unit: Unit = "photometric",
    backs: Literal["absent", "black"] = "absent",
    open_files: dict[Path, OpenFile] | None = None,
) -> Model:
    """Read a .gltf or .glb.

    time         : animation time in seconds; None shows the model at rest
    shutter      : duration in seconds for which the shutter is open, from `time` on. Nodes that move meanwhile get
                   a motion, but skins and morph targets keep their form at `time`
    camera       : name or index of the camera for `Model.camera`; by default the first
    animation    : name or index of the animation that runs, or "all"; by default the first, as in viewers
    variant      : name or index of the material variant; by default the primitives' own materials
    light_factor : factor of the intensity of punctual lights; emitting surfaces keep their radiance. Blender's
                   exporter writes 683 lumen for a watt, so 1 / 683, with the unit "radiometric", restores its watts
    unit         : unit of the model's light: "photometric" (cd, lx, cd m^-2), as glTF defines it, or "radiometric",
                   as written by programs that have light in watts
    backs        : backs of materials that are not doubleSided: "absent", as in viewers, or "black", so that walls
                   block light from both sides
    open_files   : open files by path, to which the file is added. A file that is there is not decoded again, and
                   each read has its own limit of decoded bytes

    Raises SceneError for a file that is missing, broken or hostile, or requires an unknown extension. Raises
    UsageError for a camera, animation or variant that the file lacks, and for numbers that are not finite.
    """
    path = Path(path)
    if not (np.isfinite(light_factor) and light_factor >= 0):
        raise UsageError(f"light_factor is {light_factor}; must be a finite number, at least 0.")
    opened = OpenFile.of(path) if open_files is None else open_files.get(path) or OpenFile.of(path)
    if open_files is not None:
        open_files[path] = opened
    document, accessors = opened.document, opened.accessors
    document.decoded = 0
    running = chosen_animations(document, animation)
    if animation is None and time is not None and len(document.all("animations")) > 1:
        first = animation_names(document)[0]
        others = f"Animations after the first, {shown(first)}"
        document.notes.add(f"{others}: the parameter animation runs another by its name, or all.")
    poses = poses_at(document, accessors, time, running)
    nodes = Nodes.of(document, poses)
    surfaces = MaterialReader(document)
    path_of = None
    if time is not None and shutter > 0:
        times = shutter_times(running, accessors, time, time + shutter)
        document.take(128 * len(times) * len(nodes.world), nodes.tables.location)
        world, deforming = np.empty((len(times), *nodes.world.shape)), set[int]()
        for i, t in enumerate(times):
            now = poses_at(document, accessors, float(t), running)
            world[i] = Nodes.of(document, now).world
            deforming |= _deforming(poses, now)
        path_of = NodePaths(times, world, deforming)
    look = chosen_variant(document, variant)
    made = _Shapes(opened, nodes, poses, surfaces, path_of, look)
    written = nodes.tables.values
    views = [_camera(document, nodes, i, path_of) for i in nodes.drawn if "camera" in written[i]]
    cameras = tuple(each for each in views if each is not None)
    all_black = backs == "black" or has_black_backs(document.root)
    eyes = None if all_black else [camera.position for camera in cameras]
    shapes = made.all(eyes)
    if not shapes:  # points and lines are drawn only in models without triangles
        with_strokes = replace(opened, primitives=Primitives(accessors, strokes=True))
        made = _Shapes(with_strokes, nodes, poses, surfaces, path_of, look)
        shapes = made.all(eyes)
        if shapes:
            radii = f"{min(made.primitives.radii):.3g}", f"{max(made.primitives.radii):.3g}"
            warn(
                f"{document.location} has no triangles, so its points and lines are drawn as balls and rods, of "
                f"radius {' to '.join(dict.fromkeys(radii))} in units of their meshes."
            )
            document.notes.texts.pop(ONLY_TRIANGLES, None)
    if shapes:
        warn_of_steps(document.location, made.step, made.low, made.high)
    profiles = Profiles(document)
    extended = [i for i in nodes.drawn if "extensions" in written[i]]
    lights = [light_of(document, nodes.tables[i], nodes.world[i], light_factor, profiles) for i in extended]
    if path_of is not None:
        if any(light is not None and path_of.of(i) is not None for light, i in zip(lights, extended, strict=True)):
            document.notes.add("Lights that move while the shutter is open: they are where it opens.")
        if made.bent:
            names = ", ".join(made.bent[:_NAMES]) + (" ..." if len(made.bent) > _NAMES else "")
            document.notes.add(
                f"Skins and morph targets that move while the shutter is open: as it opens is {names}."
            )
    scenes, chosen = document.all("scenes"), document.root.integer("scene", 0)
    return Model(
        source=document.location.source,
        name=scenes[chosen].name(path.stem) if len(scenes) else path.stem,
        shapes=tuple(shapes),
        materials=tuple(surface.material for surface in surfaces.surfaces),
        textures=tuple(surfaces.textures),
        lights=tuple(light for light in lights if light is not None),
        cameras=cameras,
        camera=_chosen(cameras, camera, document),
        notes=(
            *document.notes.texts,
            *(f"{name[0].upper()}{name[1:]} ({count:,})." for name, count in accessors.left_out.items()),
            *document.files.notes(),
        ),
        shutter=(0.0, 0.0) if time is None else (time, time + shutter),
        unit=unit,
        sky=environment_of(document),
        animated=bool(poses),
    )


@dataclass
class OpenFile:
    """Document and what is decoded of it, for reads of one file at several animation times."""

    document: Document
    accessors: Accessors
    primitives: Primitives

    @classmethod
    def of(cls, path: Path) -> OpenFile:
        document = read_document(path)
        accessors = Accessors(document)
        return cls(document, accessors, Primitives(accessors))


@dataclass(frozen=True)
class NodePaths:
    """World transforms of nodes while the shutter is open.

    times     : (K,) seconds
    world     : (K, N, 4, 4) for each time and node
    deforming : indices of nodes whose morph weights change
    """

    times: Float64
    world: Float64
    deforming: set[int]

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """Mask (N,), True for each node that moves."""
        return np.asarray(np.any(self.world != self.world[0], axis=(0, 2, 3)))

    def of(self, node: int) -> Float64 | None:
        """Return the (K, 3, 4) transforms of a node; None if it does not move."""
        return self.world[:, node, :3] if self.moving[node] else None


def _deforming(first: dict[int, dict[str, Float64]], second: dict[int, dict[str, Float64]]) -> set[int]:
    """Return the indices of nodes whose morph weights differ between two poses of the same animations."""
    return {
        node
        for node, values in second.items()
        if "weights" in values and not np.array_equal(first[node]["weights"], values["weights"])
    }


def _camera(document: Document, nodes: Nodes, index: int, paths: NodePaths | None) -> ModelCamera | None:
    table = nodes.tables[index]
    found = camera_of(document, table, nodes.world[index])
    if found is None or paths is None or paths.of(index) is None:
        return found
    others = [camera_of(document, table, world[index]) for world in paths.world]
    # At times at which the node is scaled to nothing, there is no camera.
    times = paths.times[[each is not None for each in others]]
    return found.through(times, [each for each in others if each is not None])


def _chosen(cameras: Sequence[ModelCamera], wanted: str | int | None, document: Document) -> ModelCamera | None:
    if wanted is None:
        return cameras[0] if cameras else None
    if isinstance(wanted, int) and 0 <= wanted < len(cameras):
        return cameras[wanted]
    for each in cameras:
        if each.name == wanted:
            return each
    listed = listed_names(f"{i} {shown(each.name)}" for i, each in enumerate(cameras)) or "no camera"
    raise UsageError(f"{document.location} camera {shown(wanted)} was asked for, but the file has {listed}.")


@dataclass(eq=False)
class _Group:
    """Instances of one primitive's mesh, while they are collected.

    maps  : arrays (N, 3, 4) of affine transforms from mesh to world space
    nodes : indices of nodes with one instance each, whose transforms `add_instances` appends to `maps`
    """

    name: str
    mesh: Mesh
    surface: int
    maps: list[Float64]
    motion: Motion | None = None
    nodes: list[int] = field(default_factory=list)

    def add_instances(self, world: Float64) -> None:
        """Append the transforms of the instances of `nodes` to `maps`, and empty `nodes`.

        world : (N, 4, 4) transforms of all nodes
        """
        if self.nodes:
            self.maps.append(world[self.nodes, :3])
            self.nodes = []


@dataclass
class _Part:
    """Primitive of a mesh for nodes that only transform it, with the morph weights of the mesh itself.

    name  : suffix of the mesh's name for this primitive
    nodes : indices of the nodes that have an instance of the primitive
    """

    name: str
    primitive: Table
    mesh: Mesh
    surface: int
    nodes: list[int] = field(default_factory=list)


class _Shapes:
    def __init__(
        self,
        opened: OpenFile,
        nodes: Nodes,
        poses: dict[int, dict[str, Float64]],
        surfaces: MaterialReader,
        paths: NodePaths | None = None,
        variant: int | None = None,
    ) -> None:
        self.paths, self.variant = paths, variant
        self.document, self.accessors, self.nodes = opened.document, opened.accessors, nodes
        self.poses: dict[int, dict[str, Float64]] = poses
        self.surfaces = surfaces
        self.primitives = opened.primitives
        self.skins: dict[int, Skin] = {}
        self.joints_move: dict[int, bool] = {}  # by skin index
        self.solid: dict[tuple[Mesh, ...], bool] = {}
        self.tested = 0  # faces in tests of whether a mesh encloses a camera
        self.min_alphas: dict[int, float] = {}  # by texture index
        self.turned: dict[Mesh, Mesh] = {}
        self.flat: dict[tuple[Mesh, bytes], Mesh] = {}  # flattened meshes, by original mesh and axis
        self.groups: dict[tuple[Mesh, int, int], _Group] = {}
        self.parts: dict[int, list[_Part]] = {}  # by mesh index
        self.weights: dict[int, Float64] = {}  # morph weights by mesh index
        #: Groups of each mesh's primitives, by (mesh index, is mirrored). A mesh that is built for a single node
        #: has -1 - (node index) as its index.
        self.wholes: dict[tuple[int, bool], dict[tuple[Mesh, int, int], _Group]] = {}
        determinant, size = _stretch(nodes.world[:, :3, :3])
        self._flat = (~(np.abs(determinant) > _FLAT * size)).tolist()
        self._mirrored = (determinant < 0).tolist()
        self.triangles = self.instances = self.deformed = 0
        #: Maximum spacing of 32-bit floats at the vertices, and the bounding box of all shapes, world space.
        self.step, self.low, self.high = 0.0, np.full(3, np.inf), np.full(3, -np.inf)
        #: Names of meshes that deform while the shutter is open.
        self.bent: list[str] = []

    def all(self, eyes: Sequence[Float64] | None = None) -> list[Shape]:
        """Return a shape for each primitive.

        eyes : positions of cameras; backs that are visible become two-sided or are culled. None if all backs stay
               black
        """
        for index in self.nodes.drawn:
            number = self._plain_mesh(index)
            if number is None:
                self._add_node(index)
            else:
                self._add_plain(index, number)
        for parts in self.parts.values():
            for part in parts:
                self._check_extent(part.mesh, self.nodes.world[part.nodes, :3], part.primitive)
        for group in self.groups.values():
            group.add_instances(self.nodes.world)
        if eyes is not None:
            self._light_backs()
            self._cull_backs(eyes)
        shapes = []
        for group in self.groups.values():
            surface = self.surfaces.surfaces[group.surface]
            shapes.append(
                Shape(
                    group.name,
                    group.mesh,
                    group.surface,
                    np.concatenate(group.maps),
                    surface.emission,
                    surface.material.two_sided,
                    motion=group.motion,
                )
            )
        return shapes

    def _plain_mesh(self, index: int) -> int | None:
        """Return the index of a node's mesh if the node only transforms the mesh, as most do; otherwise None."""
        values = self.nodes.tables.values[index]
        if "mesh" not in values or not _OF_ITS_OWN.isdisjoint(values) or "weights" in self.poses.get(index, ()):
            return None
        if "extensions" in values and INSTANCING in values["extensions"]:
            return None
        if self._flat[index] or (
            self.paths is not None and (self.paths.moving[index] or index in self.paths.deforming)
        ):
            return None
        number: int | None = self.nodes.tables[index].index("mesh", self.document.all("meshes"), "meshes")
        return number

    def _add_plain(self, index: int, number: int) -> None:
        parts = self._parts(number)
        self._count_instances(len(parts), index)
        for part in parts:
            self._count(len(part.mesh.faces), index)
            part.nodes.append(index)
            geometry = self._turned(part.mesh) if self._mirrored[index] else part.mesh
            key = (geometry, part.surface, -1)
            if key not in self.groups:
                name = self.document.all("meshes")[number].name(self.nodes.tables[index].name(f"mesh-{number}"))
                suffix = _MIRRORED if self._mirrored[index] else ""
                self.groups[key] = _Group(f"{name}{part.name}{suffix}", geometry, part.surface, [])
            self.groups[key].nodes.append(index)
            self.wholes.setdefault((number, self._mirrored[index]), {})[key] = self.groups[key]

    def _parts(self, number: int) -> list[_Part]:
        """Return the primitives of a mesh for nodes that only transform it; they are made on first use."""
        if number not in self.parts:
            self.parts[number] = self._new_parts(number)
        return self.parts[number]

    def _new_parts(self, number: int) -> list[_Part]:
        primitives = self.document.all("meshes")[number].tables("primitives")
        weights = self._mesh_weights(number)
        parts = []
        for i, primitive in enumerate(primitives):
            check_time()
            surface, uv_sets = self._surface(primitive)
            made = self.primitives.mesh(primitive, weights, uv_sets)
            if made is not None:
                parts.append(_Part("" if len(primitives) == 1 else f"-{i}", primitive, made, surface))
        return parts

    def _surface(self, primitive: Table) -> tuple[int, frozenset[int]]:
        """Return the surface index of a primitive, and the texture coordinate sets that it needs."""
        surface = self.surfaces.number(material_of(primitive, self.variant, self.document))
        slots = self.surfaces.surfaces[surface].material.slots.values()
        return surface, frozenset(slot.uv_set for slot in slots)

    def _turned(self, mesh: Mesh) -> Mesh:
        if mesh not in self.turned:
            self.turned[mesh] = mesh.turned()
        return self.turned[mesh]

    def _count_instances(self, count: int, node: int) -> None:
        """Count instances of primitives by a node. Raises SceneError if the total exceeds the limits."""
        self.instances += count
        allowed = self.document.allowed(limits.ALWAYS_INSTANCES, limits.MAX_INSTANCES_RATIO, limits.MAX_TRIANGLES)
        if self.instances > allowed:
            raise self.nodes.tables[node].location.error(
                f"brings the model to {self.instances:,} instances of primitives, but files of "
                f"{self.document.stored:,} bytes may have {allowed:,}.",
                "Use fewer nodes, or join the primitives of their meshes.",
            )

    def _count_deformed(self, count: int, node: int) -> None:
        """Count meshes that are built for one node. Raises SceneError if the total exceeds the limits."""
        self.deformed += count
        allowed = max(limits.ALWAYS_DEFORMED, self.document.stored // limits.BYTES_PER_DEFORMED)
        if self.deformed > allowed:
            raise self.nodes.tables[node].location.error(
                f"brings the model to {self.deformed:,} primitives and morph targets that nodes deform by skins "
                f"and weights of their own, but files of {self.document.stored:,} bytes may have {allowed:,}.",
                "Use fewer nodes with a skin or weights, or join the primitives of their meshes.",
            )

    def _count(self, triangles: int, node: int) -> None:
        """Count the triangles of a node's instances. Raises SceneError if the total exceeds the limits."""
        self.triangles += triangles
        allowed = self.document.allowed(limits.ALWAYS_TRIANGLES, limits.MAX_TRIANGLES_RATIO, limits.MAX_TRIANGLES)
        if self.triangles > allowed:
            raise self.nodes.tables[node].location.error(
                f"brings the model, with all instances, to {self.triangles:,} triangles, but files of "
                f"{self.document.stored:,} bytes may have {allowed:,}.",
                "Use fewer instances, or simplify the model.",
            )

    def _add_node(self, index: int) -> None:
        node = self.nodes.tables[index]
        meshes = self.document.all("meshes")
        number = node.index("mesh", meshes, "meshes")
        if number is None:
            return
        mesh, world = meshes[number], self.nodes.world[index]
        skin = self._skin(node)
        primitives = mesh.tables("primitives")
        name = mesh.name(node.name(f"mesh-{number}"))
        if self.paths is not None and (self._joints_move(node) or index in self.paths.deforming):
            self.bent.append(name)
        # The joints of a skin give world positions, so glTF ignores the transform of the node with the mesh.
        maps = instances(node, world, self.accessors) if skin is None else np.eye(3, 4)[None]
        self._count_instances(len(primitives), index)
        pose = self.poses.get(index, {})
        if skin is None and "weights" not in node and "weights" not in pose:
            for part_of_mesh in self._parts(number):
                check_time()
                self._add_shape(
                    f"{name}{part_of_mesh.name}",
                    part_of_mesh.mesh,
                    part_of_mesh.surface,
                    maps,
                    part_of_mesh.primitive,
                    index,
                )
            return
        if "weights" in pose:
            weights = pose["weights"]
        else:
            weights = node.any_numbers("weights") if "weights" in node else self._mesh_weights(number)
        is_deformed = skin is not None or "weights" in node or "weights" in pose
        for i, primitive in enumerate(primitives):
            check_time()
            if is_deformed:
                self._count_deformed(1 + min(len(primitive.tables("targets")), len(weights)), index)
            part = name if len(primitives) == 1 else f"{name}-{i}"
            surface, uv_sets = self._surface(primitive)
            if skin is None:
                made = self.primitives.mesh(primitive, weights, uv_sets)
            else:
                made = self.primitives.skinned(primitive, weights, uv_sets, skin)
            if made is not None:
                self._add_shape(part, made, surface, maps, primitive, index)

    def _mesh_weights(self, number: int) -> Float64:
        """Return the (M,) morph weights of a mesh, for nodes that have no weights."""
        if number not in self.weights:
            self.weights[number] = self.document.all("meshes")[number].any_numbers("weights")
        return self.weights[number]

    def _skin(self, node: Table) -> Skin | None:
        skins = self.document.all("skins")
        index = node.index("skin", skins, "skins")
        if index is None:
            return None
        if index not in self.skins:
            self.skins[index] = skin_of(skins[index], self.nodes.world, self.accessors)
        return self.skins[index]

    def _joints_move(self, node: Table) -> bool:
        """Return True if a node has a skin of which a joint moves while the shutter is open."""
        skins = self.document.all("skins")
        index = node.index("skin", skins, "skins")
        if index is None or self.paths is None:
            return False
        if index not in self.joints_move:
            joints = skins[index].indices("joints", self.nodes.tables, "nodes")
            self.joints_move[index] = bool(self.paths.moving[joints].any())
        return self.joints_move[index]

    def _add_shape(self, name: str, mesh: Mesh, surface: int, maps: Float64, primitive: Table, node: int) -> None:
        """Add instances of a mesh with the transforms `maps` (N, 3, 4) from mesh to world space.

        Mirrored instances use a mesh with reversed winding, so that fronts stay outside.
        """
        determinant, size = _stretch(maps[:, :, :3])
        flat = ~(np.abs(determinant) > _FLAT * size)
        if flat.any():
            self._add_flat(name, mesh, surface, maps[flat], primitive, node)
        mirrored = determinant < 0
        self._count(len(mesh.faces) * int(np.count_nonzero(~flat)), node)
        self._check_extent(mesh, maps[~flat], primitive)
        for chosen, suffix in ((~flat & ~mirrored, ""), (~flat & mirrored, _MIRRORED)):
            if not chosen.any():
                continue
            geometry = self._turned(mesh) if suffix else mesh
            path = None if self.paths is None else self.paths.of(node)
            if path is not None and "skin" in self.nodes.tables[node]:
                path = None  # a skinned mesh is moved by its joints, not by its node
            # A moving node becomes a separate shape, because all instances of a shape move together.
            key = (geometry, surface, -1 if path is None else node)
            if key not in self.groups:
                self.groups[key] = _Group(name + suffix, geometry, surface, [])
            self.wholes.setdefault((-1 - node, bool(suffix)), {})[key] = self.groups[key]
            self.groups[key].add_instances(self.nodes.world)
            self.groups[key].maps.append(maps[chosen])
            if path is not None:
                assert self.paths is not None, "asked above"
                local = instances(self.nodes.tables[node], np.eye(4), self.accessors)
                placed = local[chosen]
                if (before := self.groups[key].motion) is not None:
                    placed = np.concatenate([before.placed, placed])
                self.groups[key].motion = Motion(self.paths.times, path, placed)

    def _add_flat(self, name: str, mesh: Mesh, surface: int, maps: Float64, primitive: Table, node: int) -> None:
        """Add instances of a mesh with transforms `maps` (N, 3, 4) that flatten the mesh into a plane.

        The mesh is flattened in its own space instead, so that an invertible transform gives the same plane.
        """
        if self.paths is not None and self.paths.of(node) is not None:
            self.document.notes.add("Meshes that are scaled to 0 along an axis and move while the shutter is open.")
            return
        for world in maps:
            left, scale, right = np.linalg.svd(world[:, :3])
            if not scale[1] > _FLAT * scale[0]:  # flattened to a line or a point
                self.document.notes.add("Meshes that are scaled to nothing.")
                continue
            axis = right[2] * np.sign(right[2][np.argmax(np.abs(right[2]))])
            normal = np.linalg.det(left) * np.linalg.det(right) * left[:, 2] * np.sign(axis @ right[2])
            key = mesh, np.round(axis, 9).tobytes()
            if key not in self.flat:
                corners = mesh.vertices - np.outer(mesh.vertices @ axis, axis)
                self.flat[key] = replace(mesh, vertices=corners, normals=None).without_faces(
                    without_area(corners[mesh.faces])
                )
            if not len(self.flat[key].faces):
                self.document.notes.add("Meshes of which no triangle has an area.")
                continue
            upright = world.copy()
            upright[:, :3] += np.outer(scale[0] * normal - world[:, :3] @ axis, axis)
            self._add_shape(name, self.flat[key], surface, upright[None], primitive, node)

    def _check_extent(self, mesh: Mesh, maps: Float64, primitive: Table) -> None:
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        centre = maps[:, :, :3] @ ((low + high) / 2) + maps[:, :, 3]
        extent = np.abs(maps[:, :, :3]) @ ((high - low) / 2)
        if not np.all(np.abs(centre) + extent <= LARGEST):
            raise primitive.location.error(
                f"reaches beyond {LARGEST:g} scene units, where 32 bit numbers end.",
                "Check the transforms of its nodes.",
            )
        if len(maps):
            self.step = max(self.step, step_at(low, high) * float(np.linalg.norm(maps[:, :, :3], axis=1).max()))
            self.low = np.minimum(self.low, (centre - extent).min(axis=0))
            self.high = np.maximum(self.high, (centre + extent).max(axis=0))

    def _light_backs(self) -> None:
        """Make one-sided materials two-sided on closed meshes whose inside is visible.

        The inside is visible through cut-out holes and through surfaces that transmit light. Viewers of glTF cull
        the backs inside such a mesh and show the surfaces behind them. Here, one-sided backs would be black.
        """
        surfaces = self.surfaces.surfaces
        seen: dict[int, dict[_Group, None]] = {}  # by surface index; the keys are groups in order
        for groups in self.wholes.values():
            clear = [group for group in groups.values() if self._is_see_through(group)]
            if not clear:
                continue
            if len(groups) > 1 and self._is_solid(*(group.mesh for group in groups.values())):
                always = set(clear)
                clear = [group for group in groups.values() if group in always or not self._is_solid(group.mesh)]
            else:
                clear = [group for group in clear if self._is_solid(group.mesh)]
            for group in clear:
                surface = surfaces[group.surface]
                material = surface.material
                if not (material.two_sided or material.transmission > 0 or surface.black_backs):
                    seen.setdefault(group.surface, {})[group] = None
        by_surface = self._groups_by_surface() if seen else {}
        for number, groups_of in seen.items():
            lit = replace(surfaces[number], material=replace(surfaces[number].material, two_sided=True))
            if len(groups_of) == len(by_surface[number]):
                surfaces[number] = lit
                continue
            surfaces.append(lit)
            for group in groups_of:
                group.surface = len(surfaces) - 1

    def _groups_by_surface(self) -> dict[int, list[_Group]]:
        """Return the groups of each surface that has any, by surface index."""
        by_surface: dict[int, list[_Group]] = {}
        for group in self.groups.values():
            by_surface.setdefault(group.surface, []).append(group)
        return by_surface

    def _is_see_through(self, group: _Group) -> bool:
        material = self.surfaces.surfaces[group.surface].material
        if material.transmission > 0 or material.diffuse_transmission > 0:
            return True
        if material.alpha == "opaque":
            return False
        alpha = 1.0
        if material.texture is not None:
            number = material.texture.texture
            if number not in self.min_alphas:
                self.min_alphas[number] = _min_alpha(self.surfaces.textures[number])
            alpha = self.min_alphas[number]
        if group.mesh.colours is not None:
            alpha *= float(group.mesh.colours[:, 3:].min(initial=1.0))
        return float(opacity_of(material, np.array(alpha))) < 1

    def _cull_backs(self, eyes: Sequence[Float64]) -> None:
        """Cull the backs of materials that are not doubleSided, unless all backs are hidden.

        Backs are hidden inside closed meshes that enclose no camera, so they need no culling.

        eyes : positions of cameras
        """
        surfaces = self.surfaces.surfaces
        points = np.unique(np.reshape(np.array(eyes, np.float64), (-1, 3)), axis=0)
        for number, groups in self._groups_by_surface().items():
            surface = surfaces[number]
            material = surface.material
            if material.two_sided or material.transmission > 0 or surface.black_backs:
                continue
            if not all(self._is_solid(group.mesh) and not self._may_enclose(group, points) for group in groups):
                surfaces[number] = replace(surface, material=replace(material, culled=True))

    def _may_enclose(self, group: _Group, points: Float64) -> bool:
        """Return True if an instance of a mesh encloses any of the points (P, 3), by the winding number.

        Also returns True if all tests together would take longer than `_LONG_TESTS` allows.
        """
        mesh = group.mesh
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        for maps in group.maps if len(points) else ():
            centre = maps[:, :, :3] @ ((low + high) / 2) + maps[:, :, 3]
            extent = np.abs(maps[:, :, :3]) @ ((high - low) / 2)
            for point in points:
                check_time()
                near = maps[np.all(np.abs(point - centre) <= extent, axis=1)]
                self.tested += _FACES_PER_BOXES + len(maps) // _BOXES_PER_FACE
                for world in near:
                    self.tested += len(mesh.faces) + _FACES_PER_TEST
                    if self.tested > _LONG_TESTS:
                        return True
                    corners = mesh.vertices @ world[:, :3].T + world[:, 3]
                    if winding_number(corners[mesh.faces], point) > 0.5:
                        return True
                if self.tested > _LONG_TESTS:
                    return True
        return False

    def _is_solid(self, *meshes: Mesh) -> bool:
        """Return True if the meshes together are closed; see `_are_solid`, whose results are cached."""
        if meshes not in self.solid:
            self.solid[meshes] = _are_solid(meshes)
        return self.solid[meshes]


def _min_alpha(texture: Texture) -> float:
    """Return the smallest alpha of a texture; 1 if it has none."""
    image = texture.image
    return 1.0 if image.shape[2] < 4 else float(image[..., 3].min()) / (255 if image.dtype == np.uint8 else 1)


def _are_solid(meshes: Sequence[Mesh]) -> bool:
    """Return True if the meshes together are closed, with fronts outward; False for more than _LONG_TEST faces."""
    if sum(len(mesh.faces) for mesh in meshes) > _LONG_TEST:
        return False
    return is_solid(Mesh.joined(meshes))


def _stretch(linear: Float64) -> tuple[Float64, Float64]:
    """Return (N,) determinants of linear maps (N, 3, 3), and (N,) sizes to compare them with.

    Both are of the maps divided by their largest entries, so that tiny maps do not underflow.

    A size is the product of the Frobenius norms of the map and of its cofactor matrix. The ratio of determinant to
    size is 1/3 for a uniform scale, and near 0 for a map that flattens.
    """
    largest = np.abs(linear).max(axis=(1, 2), keepdims=True)
    linear = linear / np.where(largest > 0, largest, 1.0)
    x, y, z = (linear[:, row] for row in range(3))
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    determinant = np.sum(x * cofactors[:, 0], axis=1)
    norms = [np.linalg.norm(each.reshape(-1, 9), axis=1) for each in (cofactors, linear)]
    return np.asarray(determinant), np.asarray(norms[0] * norms[1])
