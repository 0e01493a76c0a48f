"""Geometry of shapes: meshes that share vertices, exact spheres and planes, and the affine maps of their instances.

A shape is a geometry with maps to world space. `Shapes` derives the arrays that engines need, each on first use: a
pool of vertices in world space with faces, or separate corners.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, pairwise
from types import NoneType
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError, UsageError
from glpath.scene.motion import Motion, moved_plane
from glpath.scene.stream import Stream
from glpath.system.arguments import short_repr
from glpath.system.digest import digest_of
from glpath.system.time_limit import check_time
from glpath.system.vectors import LARGEST, vector

Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]

#: Kind of a shape's primitives. Streamed triangles are a kind of their own, because no array holds them.
Primitive = Literal["triangle", "sphere", "plane", "stream"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles that share vertices. A mesh is equal only to itself; shapes with the same mesh are its instances.

    vertices : (V, 3) float64
    faces : (F, 3) int32 vertex indices, counter-clockwise seen from the front
    uv       : (V, 2) float64 texture coordinates of the vertices, or None
    normals  : (V, 3) float64 unit shading normals on the front's side, or None; zeros stand for the face normal
    uv1      : (V, 2) float64 second texture coordinates, or None
    colours  : (V, 4) float64, linear Rec. 709 and alpha, which multiply those of the material; or None
    """

    vertices: Float64
    faces: Int32
    uv: Float64 | None = None
    normals: Float64 | None = None
    uv1: Float64 | None = None
    colours: Float64 | None = None

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hex) of everything that changes the image; see `glpath.system.digest`."""
        return digest_of(self.vertices, self.faces, *self.of_vertices.values())

    @cached_property
    def used_vertices(self) -> Float64:
        """Vertices (V', 3) float64 that are corners of a triangle; `vertices` itself if all are corners."""
        return _used_rows(self.vertices, self.faces)

    @property
    def of_vertices(self) -> dict[str, Float64 | None]:
        """Vertex attributes by field name."""
        return {name: getattr(self, name) for name in ("uv", "normals", "uv1", "colours")}

    @classmethod
    def of_triangles(cls, corners: ArrayLike, uv: ArrayLike | None = None) -> Mesh:
        """Return a mesh of triangles (F, 3, 3) that share no vertices.

        uv : (F, 3, 2) texture coordinates of the corners
        """
        vertices = np.ascontiguousarray(corners, np.float64).reshape(-1, 3)
        return cls(
            vertices, _apart(len(vertices) // 3), None if uv is None else np.array(uv, np.float64).reshape(-1, 2)
        )

    @classmethod
    def joined(cls, meshes: Sequence[Mesh]) -> Mesh:
        """Return one mesh of several, in order, with the attributes that all have; a single mesh is unchanged."""
        if len(meshes) == 1:
            return meshes[0]
        first = accumulate((len(mesh.vertices) for mesh in meshes), initial=0)
        faces = [mesh.faces + np.int32(start) for mesh, start in zip(meshes, first, strict=False)]
        attributes: dict[str, Float64 | None] = {}
        for name in meshes[0].of_vertices:
            parts = [part for mesh in meshes if (part := getattr(mesh, name)) is not None]
            attributes[name] = np.concatenate(parts) if len(parts) == len(meshes) else None
        return cls(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces), **attributes)

    def unshared(self) -> Mesh:
        """Return the mesh with three separate vertices for each face."""
        return replace(self._with_vertices(self.faces.ravel()), faces=_apart(len(self.faces)))

    def welded(self) -> Mesh:
        """Return the mesh with vertices merged if they are bit-identical in all attributes."""
        parts = [part for part in (self.vertices, *self.of_vertices.values()) if part is not None]
        rows = np.ascontiguousarray(np.concatenate(parts, axis=1))
        _, first, which = np.unique(
            rows.view(np.dtype((np.void, rows.strides[0]))).ravel(), return_index=True, return_inverse=True
        )
        return replace(self._with_vertices(first), faces=which.astype(np.int32)[self.faces])

    def without_faces(self, dropped: NDArray[np.bool_]) -> Mesh:
        """Return the mesh without some faces and without unused vertices; the same mesh if nothing is removed.

        dropped : (F,) bool
        """
        return (replace(self, faces=self.faces[~dropped]) if dropped.any() else self).without_unused_vertices()

    def without_unused_vertices(self) -> Mesh:
        """Return the mesh without vertices that no triangle uses; the same mesh if all are used."""
        check_time()
        used = _are_used(len(self.vertices), self.faces)
        if used.all():
            return self
        number = np.cumsum(used, dtype=np.int32) - 1
        return replace(self._with_vertices(np.flatnonzero(used)), faces=number[self.faces].astype(np.int32))

    def turned(self) -> Mesh:
        """Return the mesh with fronts and backs exchanged."""
        return replace(
            self, faces=self.faces[:, ::-1].copy(), normals=None if self.normals is None else -self.normals
        )

    def _with_vertices(self, which: NDArray[np.integer[Any]]) -> Mesh:
        selected = {name: None if values is None else values[which] for name, values in self.of_vertices.items()}
        return Mesh(self.vertices[which], self.faces, **selected)


IDENTITY = np.eye(3, 4)
# Number of points that `instance_boxes` transforms at once, so that they fit into a cache.
_TOGETHER = 1 << 15
IDENTITY.flags.writeable = False
# Geometries of a shape that are no meshes and no streams.
_EXACT = ("sphere", "plane")
# Names, types and descriptions of a shape's fields; `vector` checks the emission.
_FIELDS: tuple[tuple[str, tuple[type, ...], str], ...] = (
    ("name", (str,), "text"),
    ("geometry", (Mesh, Stream, str), 'a Mesh, a Stream, "sphere" or "plane"'),
    ("material", (int, np.integer), "an index into Scene.materials"),
    ("world_from_object", (np.ndarray,), "an array of the shape (N, 3, 4)"),
    ("emission_two_sided", (bool, np.bool_), "True or False"),
    ("subdivisions", (int, np.integer), "a whole number"),
    ("kind", (str,), "text"),
    ("motion", (NoneType, Motion), "a Motion or None"),
    ("maintenance_factor", (NoneType, int, float), "a number or None"),
    ("keeps_flux", (bool, np.bool_), "True or False"),
)
# Types of all fields in order, for shapes that are already checked.
_ALLOWED_TYPES: set[tuple[type, ...]] = set()


@dataclass(frozen=True, eq=False)
class Shape:
    """Named geometry of one material, with one or more instances; an object in the paper TB.

    geometry           : mesh; exact unit "sphere" or "plane", see `Scene.spheres` and `Scene.planes`; or stream,
                         which is already in world space
    material           : index into `Scene.materials`
    world_from_object  : (N, 3, 4) float64, an affine map for each instance, last column the translation. A map that
                         mirrors exchanges fronts and backs, so a mirrored sphere has its front inside
    emission           : (3,) float64 radiance, linear Rec. 709, in the unit of the scene; zeros for a shape that is
                         not a light
    emission_two_sided : True if both sides emit; False if only the side of the normal emits
    subdivisions       : number of times that a sphere's triangles are split if the sphere has to be tessellated
    kind               : kind in the file: quad, box, mesh, sphere, plane or stream
    maintenance_factor : factor that `emission` already contains; None if none was given
    motion             : motion of the instances; `world_from_object` is then their pose when the shutter opens.
                         None: they do not move
    keeps_flux         : True if a sphere's triangles have its flux instead of its radiance, because flux was given
    """

    name: str
    geometry: Mesh | Stream | Literal["sphere", "plane"]
    material: int
    world_from_object: Float64 = field(default_factory=lambda: IDENTITY[None])
    emission: Float64 = field(default_factory=lambda: np.zeros(3))
    emission_two_sided: bool = False
    subdivisions: int = 4
    kind: str = ""
    motion: Motion | None = None
    maintenance_factor: float | None = None
    keeps_flux: bool = False

    def __post_init__(self) -> None:
        self._check_fields()
        if not self.kind:
            object.__setattr__(self, "kind", "mesh" if isinstance(self.geometry, Mesh) else self.primitive)

    def _check_fields(self) -> None:
        """Raise GlpathError for wrong types, wrong values of the emission, or transforms not of the size (N, 3, 4).

        This does not use `checked_fields`, which would take a tenth of the time to load a shape.
        """
        types = tuple(map(type, vars(self).values()))
        if types not in _ALLOWED_TYPES:
            for name, kinds, allowed in _FIELDS:
                if not isinstance(getattr(self, name), kinds):
                    raise self._wrong(name, allowed)
            converted = (type(self.material), type(self.emission)) != (int, np.ndarray)
            object.__setattr__(self, "material", int(self.material))
            object.__setattr__(self, "emission", vector(f'shape "{self.name}": emission', self.emission, 0.0))
            if not converted:
                _ALLOWED_TYPES.add(types)
        geometry: object = self.geometry
        emission = self.emission
        if type(geometry) is str and geometry not in _EXACT:
            raise self._wrong("geometry", 'a Mesh, a Stream, "sphere" or "plane"')
        red, green, blue = emission.tolist() if emission.shape == (3,) else (-1.0, -1.0, -1.0)
        usable = emission.dtype.char == "d" and 0 <= red <= LARGEST and 0 <= green <= LARGEST
        if not (usable and 0 <= blue <= LARGEST):
            object.__setattr__(self, "emission", vector(f'shape "{self.name}": emission', emission, 0.0))
        if self.world_from_object.shape[1:] != (3, 4):
            raise self._wrong("world_from_object", "an array of the shape (N, 3, 4)")

    def _wrong(self, name: str, allowed: str) -> UsageError:
        where = f"Shape.{name}" if name == "name" else f"shape {short_repr(self.name)}: {name}"
        return UsageError(f"{where}: {short_repr(getattr(self, name))} where {allowed} is needed")

    @property
    def primitive(self) -> Primitive:
        """Kind of the geometry's primitives."""
        if isinstance(self.geometry, Stream):
            return "stream"
        return "triangle" if isinstance(self.geometry, Mesh) else self.geometry

    @property
    def count(self) -> int:
        """Number of primitives in all instances; for a stream, number of triangles."""
        if isinstance(self.geometry, Stream):
            return self.geometry.count
        each = len(self.geometry.faces) if isinstance(self.geometry, Mesh) else 1
        return len(self.world_from_object) * each

    @property
    def emits(self) -> bool:
        return bool(np.any(self.emission > 0))

    def at(self, time: float) -> Shape:
        """Return the shape at a time in seconds, without motion."""
        if self.motion is None:
            return self
        if self.geometry == "plane":
            motion = self.motion.map_at(time)
            maps = np.array([moved_plane(frame, motion) for frame in self.motion.placed])
        else:
            maps = self.motion.at(time)
        return replace(self, world_from_object=maps, motion=None)


_Number = TypeVar("_Number", np.float64, np.int32)


class Shapes(tuple[Shape, ...]):
    """Shapes of a scene in order, and the arrays derived from them. The arrays are read-only.

    Triangles, spheres and planes are numbered separately, shape by shape and instance by instance.
    """

    @classmethod
    def of(cls, shapes: Iterable[Shape]) -> Shapes:
        """Return `shapes` as `Shapes`.

        An argument of type `Shapes` is returned unchanged, with its cached arrays.
        """
        return shapes if isinstance(shapes, Shapes) else cls(shapes)

    def check_maps(self) -> None:
        """Raise SceneError if a number of a shape's `world_from_object` is not finite; see `_broken_map`."""
        if self._broken_map is not None:
            shape = self[self._broken_map]
            raise SceneError(f"shape {short_repr(shape.name)}: world_from_object has a number that is not finite.")

    @cached_property
    def _broken_map(self) -> int | None:
        """Index of a shape whose `world_from_object` has a number that is not finite; None if there is none."""
        step = _TOGETHER >> 3
        for start in range(0, len(self), step):
            some = [shape.world_from_object for shape in self[start : start + step]]
            # All at once, because numpy takes long for each small array.
            if not np.isfinite(np.concatenate(some) if len(some) > 1 else some[0]).all():
                return next(start + i for i, maps in enumerate(some) if not np.isfinite(maps).all())
        return None

    def __reduce__(self) -> tuple[object, ...]:
        return Shapes, (tuple(self),)  # without the derived arrays

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hex) of everything that changes the image; see `glpath.system.digest`."""
        return digest_of(tuple(self))

    @cached_property
    def ranges(self) -> tuple[slice, ...]:
        """Range of each shape's triangles, spheres, planes or streamed triangles."""
        end: dict[Primitive, int] = {"triangle": 0, "sphere": 0, "plane": 0, "stream": 0}
        ranges = []
        for shape in self:
            first = end[shape.primitive]
            end[shape.primitive] += shape.count
            ranges.append(slice(first, end[shape.primitive]))
        return tuple(ranges)

    @cached_property
    def meshes(self) -> tuple[Mesh, ...]:
        """Distinct meshes in the order of first use."""
        return tuple(dict.fromkeys(shape.geometry for shape in self if isinstance(shape.geometry, Mesh)))

    @cached_property
    def streams(self) -> tuple[tuple[int, Stream], ...]:
        """Shape index and stream of each streamed shape, in order."""
        return tuple((i, shape.geometry) for i, shape in enumerate(self) if isinstance(shape.geometry, Stream))

    def mesh_instances(self) -> Iterator[tuple[int, Mesh, Float64]]:
        """Yield shape index, mesh and world_from_mesh (3, 4) of each instance, in the order of triangles."""
        for index, shape in enumerate(self):
            if isinstance(shape.geometry, Mesh):
                for world_from_mesh in shape.world_from_object:
                    yield index, shape.geometry, world_from_mesh

    @cached_property
    def vertices(self) -> Float64:
        """Vertices (V, 3) float64 in world space, one instance after the other."""
        return _joined([placed(mesh.vertices, m) for _, mesh, m in self.mesh_instances()], np.zeros((0, 3)))

    @property
    def used_vertices(self) -> Float64:
        """Rows of `vertices`, (V', 3) float64, that are corners of a triangle."""
        return _used_rows(self.vertices, self.faces)

    def triangles_of(self, index: int, which: NDArray[np.bool_] | None = None) -> Iterator[Float64]:
        """Yield (n, 3, 3) float64 corners of a shape's triangles, instance by instance to save memory.

        which : (N,) bool mask of its instances; None: all
        """
        shape = self[index]
        if not isinstance(shape.geometry, Mesh):
            return
        for number, world_from_mesh in enumerate(shape.world_from_object):
            if which is None or which[number]:
                yield placed(shape.geometry.vertices, world_from_mesh)[shape.geometry.faces]

    @cached_property
    def faces(self) -> Int32:
        """Indices (T, 3) int32 into `vertices`, counter-clockwise seen from the front."""
        meshes = [mesh for _, mesh, _ in self.mesh_instances()]
        first = accumulate((len(mesh.vertices) for mesh in meshes), initial=0)
        parts = [
            mesh.faces + np.int32(start) if start else mesh.faces
            for mesh, start in zip(meshes, first, strict=False)
        ]
        return _joined(parts, np.zeros((0, 3), np.int32))

    @cached_property
    def vertex_uv(self) -> Float64:
        """Texture coordinates (V, 2) float64 of `vertices`; zeros if a mesh has none."""
        return _joined(
            [_or_zeros(mesh.uv, len(mesh.vertices), 2) for _, mesh, _ in self.mesh_instances()], np.zeros((0, 2))
        )

    @cached_property
    def vertex_uv1(self) -> Float64:
        """Second texture coordinates (V, 2) float64 of `vertices`; zeros if a mesh has none."""
        return _joined(
            [_or_zeros(mesh.uv1, len(mesh.vertices), 2) for _, mesh, _ in self.mesh_instances()], np.zeros((0, 2))
        )

    @cached_property
    def vertex_colours(self) -> Float64:
        """Colours (V, 4) float64 of `vertices`, linear Rec. 709 and alpha; ones if a mesh has none."""
        meshes = (mesh for _, mesh, _ in self.mesh_instances())
        parts = [np.broadcast_to(1.0, (len(m.vertices), 4)) if m.colours is None else m.colours for m in meshes]
        return _joined(parts, np.zeros((0, 4)))

    @cached_property
    def vertex_normals(self) -> Float64:
        """Unit shading normals (V, 3) float64 of `vertices` in world space; zeros stand for the face normal."""
        return _joined([_world_normals(mesh, m) for _, mesh, m in self.mesh_instances()], np.zeros((0, 3)))

    @cached_property
    def triangles(self) -> Float64:
        """Corners (T, 3, 3) float64 of triangles in world space."""
        parts = []
        for _, mesh, m in self.mesh_instances():
            check_time()
            vertices = placed(mesh.vertices, m)
            apart = 3 * len(mesh.faces) == len(vertices) and np.array_equal(mesh.faces, _apart(len(mesh.faces)))
            parts.append(vertices.reshape(-1, 3, 3) if apart else vertices[mesh.faces])
        return _joined(parts, np.zeros((0, 3, 3)))

    @cached_property
    def boxes(self) -> tuple[Float64, Float64]:
        """Lower and upper corners, (N, 3) each, of boxes around shapes' triangles; lower > upper if empty."""
        lower, upper = np.full((len(self), 3), np.inf), np.full((len(self), 3), -np.inf)
        for index, shape in enumerate(self):
            if isinstance(shape.geometry, Mesh) and shape.count:
                low, high = instance_boxes(shape.geometry, shape.world_from_object)
                lower[index], upper[index] = low.min(axis=0), high.max(axis=0)
        return lower, upper

    @cached_property
    def triangle_uv(self) -> Float64:
        """Texture coordinates (T, 3, 2) float64 of the triangles' corners; zeros if a mesh has none."""
        meshes = (mesh for _, mesh, _ in self.mesh_instances())
        parts = [_or_zeros(None if m.uv is None else m.uv[m.faces], len(m.faces), 3, 2) for m in meshes]
        return _joined(parts, np.zeros((0, 3, 2)))

    @cached_property
    def spheres(self) -> Float64:
        """Affine maps (S, 3, 4) float64 of the spheres, see `Scene.spheres`."""
        return _joined([s.world_from_object for s in self if s.geometry == "sphere"], np.zeros((0, 3, 4)))

    @cached_property
    def planes(self) -> Float64:
        """Affine maps (P, 3, 4) float64 of the planes, see `Scene.planes`."""
        return _joined([s.world_from_object for s in self if s.geometry == "plane"], np.zeros((0, 3, 4)))

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """Lower and upper corner of the scene's box, see `Scene.bounds`."""
        extent, centre = sphere_extent(self.spheres), self.spheres[:, :, 3]
        lower, upper = self.boxes
        meshes = lower[:, 0] <= upper[:, 0]
        points = np.concatenate([lower[meshes], upper[meshes], centre - extent, centre + extent])
        for _, stream in self.streams:
            points = np.concatenate([points, *(corner[None] for corner in stream.bounds)])
        if not len(points):
            points = self.planes[:, :, 3] if len(self.planes) else np.zeros((1, 3))
        return _box(points)

    def total(self, primitive: Primitive) -> int:
        """Return the number of triangles, spheres, planes or streamed triangles."""
        return sum(shape.count for shape in self if shape.primitive == primitive)

    def primitive_shape(self, primitive: Primitive) -> Int32:
        """Return the shape index of each triangle (T,), sphere (S,) or plane (P,), int32."""
        counts = [shape.count if shape.primitive == primitive else 0 for shape in self]
        return np.repeat(np.arange(len(self), dtype=np.int32), counts)


def _are_used(vertices: int, faces: Int32) -> NDArray[np.bool_]:
    """Return (V,) bool: True for vertices that are corners of a face."""
    used = np.zeros(vertices, np.bool_)
    used[faces] = True
    return used


def _used_rows(vertices: Float64, faces: Int32) -> Float64:
    used = _are_used(len(vertices), faces)
    return vertices if used.all() else vertices[used]


def _apart(faces: int) -> Int32:
    """Return (F, 3) faces that share no vertices."""
    return np.arange(3 * faces, dtype=np.int32).reshape(-1, 3)


def placed(points: Float64, world_from_object: Float64) -> Float64:
    """Return points (..., 3) transformed by an affine map (3, 4); the same array if the map is the identity.

    Products are summed in a fixed order, so that the bits of a point do not depend on the other points.
    """
    if np.array_equal(world_from_object, IDENTITY):
        return points
    x, y, z = (points[..., axis, None] for axis in range(3))
    m = world_from_object
    return np.asarray(x * m[:, 0] + y * m[:, 1] + z * m[:, 2] + m[:, 3])


def instance_boxes(mesh: Mesh, world_from_mesh: Float64) -> tuple[Float64, Float64]:
    """Return (N, 3) lower and (N, 3) upper corners of boxes around a mesh under affine maps (N, 3, 4)."""
    points, count = mesh.used_vertices, len(world_from_mesh)
    lower, upper = np.empty((count, 3)), np.empty((count, 3))
    if count == 1:
        lower[0], upper[0] = _box(placed(points, world_from_mesh[0]))
        return lower, upper
    x, y, z = points.T
    step = max(1, _TOGETHER // max(len(points), 1))
    for part in (slice(start, start + step) for start in range(0, count, step)):
        m = world_from_mesh[part, :, :, None]
        for axis in range(3):  # same order of sums as in `placed`
            found = x * m[:, axis, 0] + y * m[:, axis, 1] + z * m[:, axis, 2] + m[:, axis, 3]
            lower[part, axis], upper[part, axis] = found.min(axis=1), found.max(axis=1)
    return lower, upper


def _box(points: Float64) -> tuple[Float64, Float64]:
    """Return the (3,) lower and (3,) upper corner of the box around points (N, 3)."""
    # Column by column, because numpy is twenty times slower with all columns at once.
    columns = points.T
    return np.array([column.min() for column in columns]), np.array([column.max() for column in columns])


def sphere_extent(spheres: Float64) -> Float64:
    """Return the (S, 3) float64 half widths of spheres (S, 3, 4) along each axis.

    The half width of an ellipsoid along an axis is the length of that axis' row in its affine map.
    """
    linear = spheres[:, :, :3]
    return np.asarray(np.sqrt(np.einsum("nij,nij->ni", linear, linear)))


def sphere_areas(spheres: Float64) -> Float64:
    """Return the (S,) float64 surface areas of spheres (S, 3, 4), scene units squared.

    Areas of ellipsoids are exact to 1.1 % (Thomsen).
    """
    axes = np.linalg.svd(spheres[:, :, :3], compute_uv=False) ** 1.6075
    a, b, c = axes.T
    return np.asarray(4 * np.pi * ((a * b + b * c + c * a) / 3) ** (1 / 1.6075))


def ellipsoid_area(world_from_unit: Float64) -> float:
    """Return the area of the ellipsoid that a transform (3, 4) makes of the unit sphere, in scene units squared."""
    linear = world_from_unit[:, :3]
    z, weight = np.polynomial.legendre.leggauss(64)
    phi = 2 * np.pi * (np.arange(128) + 0.5) / 128
    r = np.sqrt(1 - z * z)[:, None]
    unit_sphere = np.stack([r * np.cos(phi), r * np.sin(phi), np.broadcast_to(z[:, None], (64, 128))], axis=-1)
    stretch = abs(np.linalg.det(linear)) * np.linalg.norm(unit_sphere @ np.linalg.inv(linear), axis=-1)
    return float(2 * np.pi * weight @ stretch.mean(axis=1))


def _or_zeros(values: Float64 | None, *shape: int) -> Float64:
    """Return `values`; if it is None, zeros of the given shape, as a broadcast that takes no memory."""
    return np.broadcast_to(0.0, shape) if values is None else values


def _world_normals(mesh: Mesh, world_from_mesh: Float64) -> Float64:
    """Return (V, 3) world normals, transformed by the matrix of cofactors, as cross products of edges are."""
    if mesh.normals is None or np.array_equal(world_from_mesh[:, :3], IDENTITY[:, :3]):
        return _or_zeros(mesh.normals, len(mesh.vertices), 3)
    a, b, c = world_from_mesh[:, :3]
    normals = mesh.normals @ np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]).T
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(length > 0, length, 1.0))


def _joined(parts: Sequence[NDArray[_Number]], empty: NDArray[_Number]) -> NDArray[_Number]:
    """Return one read-only array of all parts, without a copy if they are consecutive pieces of one array.

    empty : result if all parts are empty
    """
    parts = [part for part in parts if len(part)]
    if not parts:
        return empty
    shape: tuple[int, ...] = (sum(map(len, parts)), *parts[0].shape[1:])
    if not any(any(part.strides) for part in parts):  # zeros that take no memory
        return np.broadcast_to(parts[0].ravel()[0], shape)
    if all(_follows(before, after) for before, after in pairwise(parts)):
        # The strides of a part may be arbitrary along an axis of length 1, so they are not used.
        strides = np.empty((1, *shape[1:]), parts[0].dtype).strides
        whole = np.lib.stride_tricks.as_strided(parts[0], shape, strides)
    else:
        whole = np.concatenate(parts)
    whole = whole.view()
    whole.flags.writeable = False
    return whole


def _follows(before: NDArray[Any], after: NDArray[Any]) -> bool:
    """Return True if `after` begins in memory where `before` ends, in the same array."""
    return (
        before.base is not None
        and before.base is after.base
        and before.flags.c_contiguous
        and after.flags.c_contiguous
        and before.ctypes.data + before.nbytes == after.ctypes.data
    )
