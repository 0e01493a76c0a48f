"""Meshes: primitives with their attributes, morph targets and skins.

Texture coordinate v is flipped. In glTF v grows downwards from the image's first row; here it grows upwards.
TANGENT is not read, because normal maps follow the gradient of the texture coordinates. A mesh without NORMAL is
shaded flat.

Source: glTF 2.0, 3.7; KHR_mesh_quantization; KHR_draco_mesh_compression.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.gltf import compression, limits
from glpath.io.gltf.accessors import OPTIONAL_ATTRIBUTES, Accessors
from glpath.io.gltf.table import Table, Tables
from glpath.io.strokes import (
    ball_triangles,
    balls,
    line_radius,
    point_radius,
    rod_triangles,
    rods,
    used_points,
)
from glpath.scene.model import Float64, Mesh
from glpath.scene.source_location import SourceLocation
from glpath.scene.tessellate import without_area
from glpath.system.suggestions import listed_names
from glpath.system.time_limit import check_time
from glpath.system.vectors import unit_normals

_MODES = {0: "points", 1: "lines", 2: "line loop", 3: "line strip", 4: "triangles", 5: "strip", 6: "fan"}
#: Note on points and lines, which are left out.
ONLY_TRIANGLES = "Points and lines: only triangles are drawn."
_STROKES = ("points", "lines", "line loop", "line strip")
#: Vertex attributes that are read, with the allowed numbers of components.
_WIDTHS = {"POSITION": (3,), "NORMAL": (3,), "TEXCOORD_0": (2,), "TEXCOORD_1": (2,), "COLOR_0": (3, 4)}
_MAX_JOINT_SETS = 4
# Attributes that are read from Draco data.
_DRACO_WIDTHS = _WIDTHS | {f"{name}_{i}": (4,) for name in ("JOINTS", "WEIGHTS") for i in range(_MAX_JOINT_SETS)}
# Number of vertices that a skin moves at once.
_TOGETHER = 1 << 16
# Bytes of memory in which Draco data are decoded, with copies: of a face, and of a vector of a point.
_DRACO_FACE, _DRACO_VECTOR = 72, 48
# Maximum number of positions in the Draco data of a file that are searched for lists of attributes, which takes
# about 3 s. Of compressed data, about one position in 600 is searched.
_MAX_DRACO_SEARCHES = 500_000


@dataclass(frozen=True, eq=False)
class Skin:
    """Skin that moves the vertices of a mesh.

    world_from_mesh : (J, 4, 4) transform for each joint
    """

    world_from_mesh: Float64


@dataclass
class Primitives:
    """Primitives of a document as meshes; those without a skin are cached by primitive, morph weights and UV sets.

    strokes : True if points and lines are drawn, see `glpath.io.strokes`
    radii   : radii of the balls and rods drawn for points and lines, in units of their meshes
    """

    accessors: Accessors
    strokes: bool = False
    radii: list[float] = field(default_factory=list)
    _made: dict[tuple[object, ...], Mesh | None] = field(default_factory=dict)
    _texts: dict[int, str] = field(default_factory=dict)
    _stroke_triangles: int = 0
    _draco_made: dict[int, tuple[NDArray[np.int64], dict[int, NDArray[Any]]]] = field(default_factory=dict)
    _draco_searches: int = 0

    def mesh(self, primitive: Table, morph: Float64, uv_sets: frozenset[int]) -> Mesh | None:
        """Return a primitive as a morphed mesh; None if no triangle has an area.

        Points and lines also give None, unless `strokes` is set.

        morph   : (M,) weights of its morph targets
        uv_sets : texture coordinate sets that its material needs; missing ones are filled with zeros
        """
        morph = morph[: len(primitive.tables("targets"))]
        key = (self._text(primitive), np.trim_zeros(morph, "b").tobytes(), uv_sets)
        if key not in self._made:
            attributes = self._attributes(primitive, morph)
            self._made[key] = None if attributes is None else self._mesh(primitive, attributes, uv_sets)
        return self._made[key]

    def _text(self, primitive: Table) -> str:
        """Return the primitive's content without its material, because primitives often share arrays."""
        number = id(primitive.values)  # the document keeps the object, so that its number stays unique
        if number not in self._texts:
            says = {name: value for name, value in primitive.values.items() if name not in ("material", "extras")}
            self._texts[number] = repr(says)
        return self._texts[number]

    def skinned(self, primitive: Table, morph: Float64, uv_sets: frozenset[int], skin: Skin) -> Mesh | None:
        """Return a primitive as a morphed and skinned mesh, its vertices in world space; None as for `mesh`."""
        attributes = self._attributes(primitive, morph)
        if attributes is None:
            return None
        count = len(attributes["POSITION"])
        self.accessors.document.take(96 * count, primitive.location)
        sets = self._joint_sets(primitive, attributes)
        moved = {name: np.empty((count, 3)) for name in ("POSITION", "NORMAL") if name in attributes}
        determinants = np.empty(count)
        # A transform and its intermediate results take about a kilobyte for a vertex.
        for part in (slice(start, start + _TOGETHER) for start in range(0, count, _TOGETHER)):
            check_time()
            maps = _vertex_maps(primitive, skin, sets, part)
            linear = maps[:, :, :3]
            moved["POSITION"][part] = np.einsum("nij,nj->ni", linear, attributes["POSITION"][part]) + maps[:, :, 3]
            rows = [linear[:, i] for i in range(3)]
            cofactors = np.stack([np.cross(rows[i - 2], rows[i - 1]) for i in range(3)], axis=1)
            determinants[part] = np.einsum("ni,ni->n", linear[:, 0], cofactors[:, 0])
            if "NORMAL" in moved:
                moved["NORMAL"][part] = np.einsum("nij,nj->ni", cofactors, attributes["NORMAL"][part])
        mesh = self._mesh(primitive, attributes | moved, uv_sets)
        return mesh.turned() if mesh is not None and np.median(determinants) < 0 else mesh

    def _attributes(self, primitive: Table, morph: Float64) -> dict[str, NDArray[Any]] | None:
        """Return morphed attributes by name, and "faces" (F, 3) int64; None for a primitive that is not drawn.

        Joints and weights are only among the attributes if they are in Draco data.
        """
        document = self.accessors.document
        mode = primitive.choice("mode", _MODES, "triangles")
        if mode in _STROKES and not self.strokes:
            document.notes.add(ONLY_TRIANGLES)
            return None
        packed = self._unpacked(primitive)
        found = self._plain(primitive, packed or {}) | (packed or {})
        if "POSITION" not in found:
            document.notes.add("Meshes without POSITION: nothing is drawn of them.")
            return None
        count = len(found["POSITION"])
        for name, values in found.items():
            if name != "faces" and len(values) != count:
                raise (
                    primitive.location.field("attributes")
                    .field(name)
                    .error(f"has {len(values):,} elements, but POSITION has {count:,}.", "Export the file anew.")
                )
        if packed is None:
            found["faces"] = self._faces(primitive, mode, count)
        elif np.any((found["faces"] < 0) | (found["faces"] >= count)):
            raise primitive.location.error(f"has Draco data that names vertices beyond its {count:,}.")
        self._morphed(found, primitive.tables("targets"), morph)
        return found

    def _plain(self, primitive: Table, packed: Mapping[str, object]) -> dict[str, NDArray[Any]]:
        """Return the attributes in accessors, except those in `packed`."""
        attributes = primitive.table("attributes")
        every = self.accessors.document.all("accessors")
        found = {}
        for name, widths in _WIDTHS.items():
            index = None if name in packed else attributes.index(name, every, "accessors")
            if index is not None:
                found[name] = self.accessors.attribute(name, index, widths, attributes.location.field(name))
        for name in attributes.values:
            if name.startswith("TEXCOORD_") and name not in _WIDTHS:
                self.accessors.document.notes.add("Texture coordinates beyond TEXCOORD_1.")
            if name.startswith("COLOR_") and name not in _WIDTHS:
                self.accessors.document.notes.add("Vertex colours beyond COLOR_0.")
        return found

    def _unpacked(self, primitive: Table) -> dict[str, NDArray[Any]] | None:
        """Return the attributes of Draco data, with "faces"; None if accessors hold the same data."""
        extension = primitive.extension(compression.DRACO)
        if extension is None:
            return None
        document, attributes = self.accessors.document, primitive.table("attributes")
        every = document.all("accessors")
        position = attributes.index("POSITION", every, "accessors")
        if position is not None and "bufferView" in every[position]:
            return None
        view = extension.required_index("bufferView", document.all("bufferViews"), "buffer views")
        if view not in self._draco_made:
            self._draco_made[view] = self._decoded(document.view(view), extension.location)
        (faces, by_id), ids = self._draco_made[view], extension.table("attributes")
        found: dict[str, NDArray[Any]] = {}
        for name, widths in _DRACO_WIDTHS.items():
            number = ids.integer(name)
            if number is None:
                continue
            location = ids.location.field(name)
            if number not in by_id:
                raise location.error(
                    f"is {number}, but the Draco data has {listed_names(map(str, by_id)) or 'none'}."
                )
            stored = np.atleast_2d(by_id[number].T).T
            values = stored.astype(np.float64)
            index = attributes.index(name, every, "accessors")
            if stored.dtype.kind != "f" and index is not None and every[index].flag("normalized"):
                values /= np.iinfo(stored.dtype).max
                np.maximum(values, -1.0, out=values)
            if name in OPTIONAL_ATTRIBUTES and values.ndim == 2:
                values = self.accessors.repaired(name, values)
            if values.ndim != 2 or values.shape[1] not in widths or not np.isfinite(values).all():
                raise location.error(f"has Draco data of shape {values.shape}, or numbers that are not finite.")
            if name.startswith("JOINTS_") and np.any(values < 0):
                raise location.error(f"has Draco data with the joint {values.min():g}, but the first is 0.")
            found[name] = values.astype(np.int64) if name.startswith("JOINTS_") else values
        return {**found, "faces": faces}

    def _decoded(
        self, data: memoryview, location: SourceLocation
    ) -> tuple[NDArray[np.int64], dict[int, NDArray[Any]]]:
        """Return the indices (F, 3) of Draco data, and its attributes (V, k) by their unique ids."""
        document = self.accessors.document

        def count_search() -> None:
            self._draco_searches += 1
            if self._draco_searches > _MAX_DRACO_SEARCHES:
                raise location.error(
                    "has data of Draco that look like lists of attributes nearly everywhere.",
                    "Write the file anew, without compression.",
                )

        max_faces, max_points, max_vectors = compression.draco_counts(data, location, count_search)
        max_bytes = _DRACO_FACE * max_faces + _DRACO_VECTOR * max_vectors * max_points
        document.take(max_bytes, location)
        faces, by_id = compression.draco(data, location)
        # The header gives upper bounds, so count the actual sizes instead.
        document.take(24 * faces.size + sum(8 * a.size for a in by_id.values()) - max_bytes, location)
        return faces, by_id

    def _faces(self, primitive: Table, mode: str, count: int) -> NDArray[np.int64]:
        """Return vertex indices: (F, 3) for triangles, (F, 2) for lines, (F, 1) for points."""
        every, location = self.accessors.document.all("accessors"), primitive.location.field("indices")
        index = primitive.index("indices", every, "accessors")
        if index is None:
            order = np.arange(count)
        else:
            order = self.accessors.integers(index, 1, location)[:, 0]
            if order.max(initial=-1) >= count:
                at = int(np.argmax(order >= count))
                raise location.item(at).error(
                    f"names vertex {order[at]}, but POSITION has {count:,} elements (0 to {count - 1}).",
                    "The file was written wrongly: export it anew.",
                )
        if mode == "points":
            return order[:, None]
        if mode == "lines":
            return order[: len(order) // 2 * 2].reshape(-1, 2)
        if mode in _STROKES:
            ends = np.roll(order, -1)
            return np.stack([order, ends], axis=1)[: None if mode == "line loop" else -1]
        if mode == "triangles":
            if len(order) % 3:
                self.accessors.document.notes.add("Vertices after the last whole triangle of a mesh.")
            return order[: len(order) // 3 * 3].reshape(-1, 3)
        if len(order) < 3:
            return np.zeros((0, 3), np.int64)
        i = np.arange(len(order) - 2)
        odd = i % 2
        corners = (i, i + 1 + odd, i + 2 - odd) if mode == "strip" else (i + 1, i + 2, np.zeros_like(i))
        return order[np.stack(corners, axis=1)]

    def _morphed(self, found: dict[str, NDArray[Any]], targets: Tables, morph: Float64) -> None:
        """Add the weighted morph targets to the attributes, in place."""
        every = self.accessors.document.all("accessors")
        changed = set()
        for target, weight in zip(targets, morph, strict=False):
            for name in found.keys() & _WIDTHS.keys() & target.values.keys() if weight else ():
                location = target.location.field(name)
                index = target.index(name, every, "accessors")
                assert index is not None, "its name is among the keys"
                offsets = self.accessors.attribute(name, index, _WIDTHS[name], location)
                if offsets.shape != found[name].shape:
                    raise location.error(
                        f"is of {offsets.shape[0]:,} x {offsets.shape[1]} numbers, but the mesh has "
                        f"{found[name].shape[0]:,} x {found[name].shape[1]}.",
                        "Export the file anew.",
                    )
                check_time()
                self.accessors.document.take(offsets.nbytes, location)  # targets may share one accessor
                found[name] = found[name] + weight * offsets
                changed.add(name)

    def _mesh(self, primitive: Table, found: dict[str, NDArray[Any]], uv_sets: frozenset[int]) -> Mesh | None:
        document, location = self.accessors.document, primitive.location
        if found["faces"].shape[1] < 3:
            if not len(found["faces"]):
                return None
            found = self._stroked(found, location)
        vertices, faces = found["POSITION"], found["faces"]
        document.take(16 * len(vertices) * 12 + 24 * len(faces), location)
        uv: list[Float64 | None] = []
        for number in (0, 1):
            given = found.get(f"TEXCOORD_{number}")
            if given is None and number in uv_sets:
                document.notes.add("Textures of meshes without texture coordinates: each shows one of its texels.")
                given = np.zeros((len(vertices), 2))
            uv.append(None if given is None else np.stack([given[:, 0], 1.0 - given[:, 1]], axis=1))
        colours = found.get("COLOR_0")
        if colours is not None:
            colours = np.clip(colours, 0.0, 1.0)
            if colours.shape[1] == 3:
                colours = np.concatenate([colours, np.ones((len(colours), 1))], axis=1)
        mesh = Mesh(
            np.ascontiguousarray(vertices, np.float64),
            faces.astype(np.int32),
            uv[0],
            unit_normals(found["NORMAL"]) if "NORMAL" in found else None,
            uv[1],
            colours,
        )
        flat = without_area(mesh.vertices[mesh.faces]) if len(mesh.faces) else np.zeros(0, np.bool_)
        if flat.all():
            document.notes.add("Meshes of which no triangle has an area.")
            return None
        # In triangle strips (mode 5), triangles without an area are normal, because they join strips.
        if flat.any() and primitive.values.get("mode", 4) != 5:
            document.notes.add("Triangles without an area.")
        return mesh.without_faces(flat)

    def _stroked(self, found: dict[str, NDArray[Any]], location: SourceLocation) -> dict[str, NDArray[Any]]:
        """Replace points by balls, or lines by rods, and return the attributes of their triangles."""
        points, faces = found["POSITION"], found["faces"]
        used = used_points(len(points), faces)
        is_points = faces.shape[1] == 1
        self._count_strokes(ball_triangles(len(used)) if is_points else rod_triangles(points, faces), location)
        if is_points:
            radius = point_radius(points[used])
            vertices, made, normals, of = balls(points[used], radius)
            of = used[of]
        else:
            radius = line_radius(points[used])
            vertices, made, normals, of = rods(points, faces, radius)
        self.radii.append(radius)
        others = {
            name: values[of] for name, values in found.items() if name not in ("faces", "POSITION", "TANGENT")
        }
        return {**others, "POSITION": vertices, "NORMAL": normals, "faces": made}

    def _count_strokes(self, triangles: int, location: SourceLocation) -> None:
        """Count triangles of balls and rods that are about to be made. Raises SceneError above the limit."""
        self._stroke_triangles += triangles
        document = self.accessors.document
        allowed = document.allowed(limits.ALWAYS_STROKE_TRIANGLES, limits.MAX_TRIANGLES_RATIO, limits.MAX_TRIANGLES)
        if self._stroke_triangles > allowed:
            raise location.error(
                f"brings the points and lines, drawn as balls and rods, to {self._stroke_triangles:,} triangles, "
                f"but files of {document.stored:,} bytes may have {allowed:,}.",
                "Use fewer points and lines.",
            )

    def _joint_sets(
        self, primitive: Table, found: Mapping[str, NDArray[Any]]
    ) -> list[tuple[NDArray[np.int64], Float64]]:
        """Return the joints (V, 4) and weights (V, 4) of each set of a primitive.

        found : attributes of the primitive, as `_attributes` returns them
        """
        attributes, count = primitive.table("attributes"), len(found["POSITION"])
        every = self.accessors.document.all("accessors")
        sets = []
        for number in range(_MAX_JOINT_SETS):
            names = [f"JOINTS_{number}", f"WEIGHTS_{number}"]
            joint: NDArray[np.int64] | None = found.get(names[0])
            weight: Float64 | None = found.get(names[1])
            first, second = (attributes.index(name, every, "accessors") for name in names)
            if joint is None and first is not None:
                joint = self.accessors.integers(first, 4, attributes.location.field(names[0]))
            if weight is None and second is not None:
                weight = self.accessors.floats(second, (4,), attributes.location.field(names[1]))
            if joint is None or weight is None:
                break
            if len(joint) != count or len(weight) != count:
                raise attributes.location.field(names[0]).error(
                    f"has {len(joint):,} elements, {names[1]} {len(weight):,}, but POSITION has {count:,}."
                )
            sets.append((joint, weight))
        if not sets:
            raise attributes.location.error(
                "has no JOINTS_0 and WEIGHTS_0, but its node has a skin.", "Export the file anew."
            )
        return sets


def _vertex_maps(
    primitive: Table, skin: Skin, sets: list[tuple[NDArray[np.int64], Float64]], part: slice
) -> Float64:
    """Return the (V, 3, 4) transforms from mesh to world space, weighted means of the joints' transforms.

    sets : joints and weights, as `_joint_sets` returns them
    part : range of vertices
    """
    joint = np.concatenate([joint[part] for joint, _ in sets], axis=1)
    weight = np.maximum(np.concatenate([weight[part] for _, weight in sets], axis=1), 0.0)
    beyond = (joint >= len(skin.world_from_mesh)) & (weight > 0)
    if beyond.any():
        row, column = np.argwhere(beyond)[0]
        raise (
            primitive.location.field("attributes")
            .field("JOINTS_0")
            .item(part.start + int(row))
            .error(
                f"names joint {joint[row, column]}, but the skin has {len(skin.world_from_mesh)}.",
                "Export the file anew.",
            )
        )
    joint = np.where(weight > 0, joint, 0)
    total = weight.sum(axis=1, keepdims=True)
    weight = np.where(total > 0, weight / np.where(total > 0, total, 1.0), np.eye(1, weight.shape[1]))
    maps = np.zeros((len(joint), 3, 4))
    for column in range(joint.shape[1]):
        maps += weight[:, column, None, None] * skin.world_from_mesh[joint[:, column], :3]
    return maps


def skin_of(table: Table, nodes_world: Float64, accessors: Accessors) -> Skin:
    """Return a skin of the document with its joints at their world transforms."""
    joints = table.indices("joints", range(len(nodes_world)), "nodes")
    if not joints:
        raise table.location.field("joints").error(
            "is empty, but a skin has at least one joint.", "Export the file anew."
        )
    world = nodes_world[joints]
    index = table.index("inverseBindMatrices", accessors.document.all("accessors"), "accessors")
    if index is not None:
        location = table.location.field("inverseBindMatrices")
        inverse = accessors.floats(index, (16,), location)
        if len(inverse) < len(joints):
            raise location.error(
                f"has {len(inverse)} matrices, but the skin has {len(joints)} joints.", "Export the file anew."
            )
        world = world @ inverse[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
    return Skin(world)


def is_open(mesh: Mesh) -> bool:
    """Return True if an edge has a triangle on one side only, so that backs can be seen.

    Vertices at the same position count as one vertex.
    """
    points = np.ascontiguousarray(mesh.vertices + 0.0)  # turns -0 into 0
    _, number = np.unique(points.view(np.dtype((np.void, 24))).ravel(), return_inverse=True)
    a = number[mesh.faces].astype(np.int64)
    b, count = np.roll(a, -1, axis=1), len(points)
    return not np.array_equal(np.sort((a * count + b).ravel()), np.sort((b * count + a).ravel()))


def is_solid(mesh: Mesh) -> bool:
    """Return True if the mesh is closed, with its fronts outward."""
    a, b, c = (mesh.vertices - mesh.vertices.mean(axis=0))[mesh.faces].transpose(1, 0, 2)
    return not is_open(mesh) and float(np.einsum("ij,ij->", a, np.cross(b, c))) > 0
