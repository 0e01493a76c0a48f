"""Meshes of Mitsuba's shapes: files, and its built-in rectangles, cubes, disks and cylinders.

As in Mitsuba, files without normals get smooth normals, unless `face_normals` is set. v is flipped to point
upwards.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.export.geometry import v_downwards
from glpath.io.meshes import read_mesh_file
from glpath.io.mitsuba.plugin import Plugin
from glpath.io.ply_mesh import PlyMesh
from glpath.io.polygons import split_finite
from glpath.io.stored_colours import fractions
from glpath.io.values import as_float64, finite_rows, warn_of_left_out
from glpath.scene.geometry import Float64, Mesh, placed
from glpath.scene.tessellate import quad_mesh
from glpath.system.colour import decode_srgb
from glpath.system.files import read_bytes, reason_of
from glpath.system.vectors import unit_normals

_SEGMENTS = 128  # number of segments around a disk or a cylinder
# Corners of each face of a cube with uv (0, 1), (1, 1), (1, 0) and (0, 0), v downwards.
_CUBE = np.array(
    [
        [(1, -1, -1), (1, -1, 1), (-1, -1, 1), (-1, -1, -1)],
        [(1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1)],
        [(1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)],
        [(1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, -1, 1)],
        [(-1, -1, 1), (-1, 1, 1), (-1, 1, -1), (-1, -1, -1)],
        [(1, 1, -1), (1, -1, -1), (-1, -1, -1), (-1, 1, -1)],
    ],
    np.float64,
).reshape(24, 3)
_CUBE_UV = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float64)
_CUBE_FACES = np.concatenate([np.array([(0, 1, 2), (3, 0, 2)], np.int32) + 4 * face for face in range(6)])
# Maximum colour value without a warning. Values up to it exceed 1 only by rounding.
_MAX_REFLECTANCE = 1.0 + 1e-6
_SERIALIZED = 0x041C
# Number of unpacked bytes at the start of a mesh within which its flags, name and counts must lie.
_SERIALIZED_HEAD = 4096
# Unpacked size of a mesh that is always allowed, bytes.
_SERIALIZED_SMALL = 2**24
# Unpacked size of all meshes of a scene that is always allowed, bytes.
_SERIALIZED_TOTAL = 2**26
# Maximum ratio of unpacked to packed bytes for meshes larger than _SERIALIZED_SMALL, and for scenes larger
# than _SERIALIZED_TOTAL. Meshes of surfaces have ratios from 2 to 10.
_SERIALIZED_RATIO = 32
# Number of packed bytes that are unpacked at once.
_SERIALIZED_PIECE = 2**16


@dataclass
class SerializedFiles:
    """Files in Mitsuba's own format, each read once, with a limit of their unpacked size for the whole scene."""

    _contents: dict[Path, bytes] = field(default_factory=dict)
    _stored: int = 0
    _unfolded: int = 0

    def content(self, path: Path) -> bytes:
        """Return the bytes of a file. Raises OSError."""
        if path not in self._contents:
            self._contents[path] = read_bytes(path)
            self._stored += len(self._contents[path])
        return self._contents[path]

    def count(self, size: int, packed: int) -> None:
        """Count a mesh before it is unpacked. Raises ValueError if it or the scene unfolds to too much.

        size, packed : unpacked size of the mesh, and maximum packed size, bytes
        """
        if size > max(_SERIALIZED_SMALL, _SERIALIZED_RATIO * packed):
            raise ValueError(f"{packed:,} bytes in it unfold to {size:,}, more than {_SERIALIZED_RATIO} times")
        self._unfolded += size
        if self._unfolded > max(_SERIALIZED_TOTAL, _SERIALIZED_RATIO * self._stored):
            raise ValueError(
                f"with the meshes before it, {self._stored:,} bytes unfold to {self._unfolded:,}, more than "
                f"{_SERIALIZED_RATIO} times"
            )


class _Unpacked:
    """Stream of unpacked bytes. Only small pieces of the packed bytes are copied, because meshes may share them."""

    def __init__(self, packed: memoryview) -> None:
        self._packed, self._position, self._unpack = packed, 0, zlib.decompressobj()

    def read(self, size: int) -> bytes:
        """Return the next bytes, at most `size`; fewer at the end of the stream. Raises zlib.error."""
        data = bytearray()
        while len(data) < size and not self._unpack.eof:
            piece: bytes | memoryview = self._unpack.unconsumed_tail
            if not piece:
                piece = self._packed[self._position : self._position + _SERIALIZED_PIECE]
                self._position += len(piece)
            unpacked = self._unpack.decompress(piece, size - len(data))
            if not piece and not unpacked:
                break
            data += unpacked
        return bytes(data)


def read_file(plugin: Plugin, suffix: str, files: SerializedFiles, *, attribute: str = "") -> tuple[Mesh, bool]:
    """Return the mesh of an OBJ, PLY or serialized file, and True if the file has normals.

    Raises SceneError.

    files     : serialized files that the scene has read
    attribute : attribute in the file that supplies the colours, such as vertex_color or face_color; empty for none
    """
    name = plugin.text("filename")
    where = plugin.where("filename")
    if not name:
        raise plugin.location.error("lacks the parameter `filename`, which must be there.")
    path = plugin.element.file(name)
    flips = plugin.flag("flip_tex_coords", suffix == ".obj")
    stored = None
    if suffix == ".serialized":
        mesh = _serialized(plugin, path, files)
    else:
        if path.suffix.lower() != suffix:
            raise where.error(f"names {name}, but must be a file that ends in {suffix}.")
        # Materials in the file are ignored, as in Mitsuba.
        file = read_mesh_file(path, where, colours=False)
        stored = file.ply
        mesh = Mesh.joined(_alike(file.meshes))
    if mesh.uv is not None and not flips:
        mesh = replace(mesh, uv=v_downwards(mesh.uv))
    is_flat = plugin.flag("face_normals", False)
    has_normals = mesh.normals is not None and not is_flat
    if not has_normals:
        mesh = replace(mesh, normals=None if is_flat else smooth_normals(mesh))
    if not attribute:
        return mesh, has_normals
    of_faces = attribute.startswith("face_")
    colours = None if stored is None else _ply_attribute(stored, attribute, str(path))
    if colours is None:
        element, _, stem = attribute.partition("_")
        raise where.error(
            f"names {name}, whose {element} elements have no {stem}_0, {stem}_1 and {stem}_2, but its surface asks "
            f"for {attribute}.",
            "Write the file with them, or give the surface a colour.",
        )
    colours = np.concatenate([colours, np.ones((len(colours), 1))], axis=1)
    if not of_faces:
        return replace(mesh, colours=colours), has_normals
    return replace(mesh.unshared(), colours=np.repeat(colours, 3, axis=0)), has_normals


def _alike(meshes: list[Mesh]) -> list[Mesh]:
    """Return the meshes. If any has texture coordinates, meshes without them get NaN as texture coordinates."""
    if all(mesh.uv is None for mesh in meshes):
        return meshes
    return [
        replace(mesh, uv=np.full((len(mesh.vertices), 2), np.nan)) if mesh.uv is None else mesh for mesh in meshes
    ]


def with_uv_of_triangles(mesh: Mesh) -> Mesh:
    """Return a mesh with Mitsuba's default texture coordinates: each triangle has (0, 0), (1, 0) and (0, 1)."""
    apart = mesh.unshared()
    return replace(apart, uv=v_downwards(np.tile([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], (len(mesh.faces), 1))))


def uv_lengths(mesh: Mesh, world_from_mesh: Float64) -> tuple[float, float]:
    """Return the scene units per unit of u and of v, area-weighted means over a mesh; 1 if the mesh has no uv."""
    if mesh.uv is None:
        return 1.0, 1.0
    corners = placed(mesh.vertices, world_from_mesh)[mesh.faces]
    uv = mesh.uv[mesh.faces]
    sides, uv_sides = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    valid = np.abs(np.linalg.det(uv_sides)) > 1e-12
    if not area[valid].sum() > 0:
        return 1.0, 1.0
    along = np.linalg.norm(np.linalg.solve(uv_sides[valid], sides[valid]), axis=2)
    u, v = np.average(along, axis=0, weights=area[valid])
    return float(u), float(v)


def rectangle() -> Mesh:
    """Return a square from -1 to 1 in x and y, its front towards +z."""
    return _v_down(quad_mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]))


def cube() -> Mesh:
    """Return a cube from -1 to 1 in x, y and z, fronts outward."""
    return Mesh(_CUBE, _CUBE_FACES, uv=v_downwards(np.tile(_CUBE_UV, (6, 1))))


def disk() -> Mesh:
    """Return a disk of radius 1 in x and y, its front towards +z, as a polygon of equal area.

    u is the radius, v the angle.
    """
    turn = 2.0 * np.pi / _SEGMENTS
    angles = turn * np.arange(_SEGMENTS + 1)
    radius = np.sqrt(turn / np.sin(turn))
    rim = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    middles = angles[:-1] + 0.5 * turn
    vertices = np.concatenate([rim, np.zeros((_SEGMENTS, 3))])
    uv = np.concatenate(
        [np.stack([np.ones_like(angles), angles], axis=1), np.stack([np.zeros_like(middles), middles], axis=1)]
    ) / [1.0, 2.0 * np.pi]
    number = np.arange(_SEGMENTS)
    faces = np.stack([_SEGMENTS + 1 + number, number, number + 1], axis=1).astype(np.int32)
    return _v_down(Mesh(vertices, faces, uv=uv))


def cylinder(start: Float64, end: Float64, radius: float) -> Mesh:
    """Return a tube between two points without caps, its front outside. u is the angle, v runs along the axis."""
    angles = 2.0 * np.pi * np.arange(_SEGMENTS + 1) / _SEGMENTS
    axis = end - start
    length = float(np.linalg.norm(axis))
    # Mitsuba's frame about the axis [Duff et al. 2017].
    x, y, z = axis / length
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    frame = np.array([[sign * x * x * a + 1.0, sign * b, -sign * x], [b, y * y * a + sign, -y]])
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ frame
    # The mean radius of the polygon is the radius of the circle.
    rim = radius * (np.pi / _SEGMENTS) / np.sin(np.pi / _SEGMENTS) * normals
    u = np.arange(_SEGMENTS + 1) / _SEGMENTS
    uv = np.concatenate([np.stack([u, np.full_like(u, v)], axis=1) for v in (0.0, 1.0)])
    low = np.arange(_SEGMENTS)
    high = low + _SEGMENTS + 1
    faces = np.concatenate([np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)])
    vertices = np.concatenate([start + rim, end + rim])
    return _v_down(Mesh(vertices, faces.astype(np.int32), uv, np.concatenate([normals, normals])))


def smooth_normals(mesh: Mesh) -> Float64:
    """Return (V, 3) unit normals: means of the face normals around each vertex, weighted by angle."""
    corners = mesh.vertices[mesh.faces]
    normals = unit_normals(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    total = np.zeros_like(mesh.vertices)
    for corner in range(3):
        one, other = (unit_normals(corners[:, (corner + k) % 3] - corners[:, corner]) for k in (1, 2))
        angle = np.arccos(np.clip(np.einsum("ij,ij->i", one, other), -1.0, 1.0))
        np.add.at(total, mesh.faces[:, corner], angle[:, None] * normals)
    return unit_normals(total)


def _v_down(mesh: Mesh) -> Mesh:
    assert mesh.uv is not None
    return replace(mesh, uv=v_downwards(mesh.uv))


def _ply_attribute(stored: PlyMesh, attribute: str, source: str) -> Float64 | None:
    """Return the (N, 3) colours of the vertices or triangles; None if the file lacks them.

    The columns are NAME_0 to NAME_2, NAME_0 alone, or r, g and b. Integers are fractions of white in sRGB, as in
    Mitsuba for 16 bits. Warns of colours below 0 or above 1.

    attribute : vertex_NAME or face_NAME
    source    : name of the file, for warnings
    """
    element, _, stem = attribute.lower().partition("_")
    rows = stored.faces if element == "face" else stored.vertices
    numbers = stored.polygon_of if element == "face" else stored.vertex_of
    of_colour = (("r", "g", "b"), ("red", "green", "blue")) if stem == "color" else ()
    names = rows.first_of(*of_colour, (f"{stem}_0", f"{stem}_1", f"{stem}_2"), (f"{stem}_0",) * 3)
    if not names or (numbers < 0).any():
        return None
    values, kind = rows.stacked(names), rows.types[names[0]]
    colours = _reflectances(values, source) if kind[0] == "f" else decode_srgb(fractions(values, kind)[0])
    return colours[numbers]


def _reflectances(colours: Float64, source: str) -> Float64:
    """Return colours (N, 3) in [0, 1]; negative or non-finite colours become white. Warns of them."""
    broken = ~np.asarray((np.isfinite(colours) & (colours >= 0)).all(axis=1))
    bright = ~broken & (colours > _MAX_REFLECTANCE).any(axis=1)
    counts = {
        "colours that are negative or not finite": int(np.count_nonzero(broken)),
        "parts above 1 of colours": int(np.count_nonzero(bright)),
    }
    warn_of_left_out(source, counts)
    return np.where(broken[:, None], 1.0, np.minimum(colours, 1.0))


def _serialized(plugin: Plugin, path: Path, files: SerializedFiles) -> Mesh:
    """Return the mesh `shape_index` of a file in Mitsuba's own format. Raises SceneError."""
    where, index = plugin.where("filename"), plugin.whole("shape_index", 0)
    try:
        content = files.content(path)
        (count,) = struct.unpack("<I", content[-4:])
        version = struct.unpack("<H", content[2:4])[0]
        width = 8 if version >= 4 else 4
        if not index < count:
            raise plugin.where("shape_index").error(f"is {index}, but {path} has {count} meshes, from 0 on.")
        table = len(content) - 4 - width * count
        starts = np.frombuffer(content, f"<u{width}", count, table)
        start = int(starts[index])
        kind, _ = struct.unpack("<HH", content[start : start + 4])
        if kind != _SERIALIZED:
            raise ValueError("it does not begin as one")
        return _of_stream(memoryview(content)[start + 4 :], version, str(path), files)
    except (OSError, ValueError, struct.error, zlib.error, IndexError) as error:
        raise where.error(
            f"names {path}, which cannot be read as meshes of Mitsuba: {reason_of(error)}.",
            "Write it anew, as PLY.",
        ) from error


def _of_stream(packed: memoryview, version: int, source: str, files: SerializedFiles) -> Mesh:
    """Return the mesh of a packed stream: flags, name, counts, then the arrays in sequence.

    packed : bytes from the start of the stream to the end of the file
    source : name of the file, for warnings
    files  : sizes of the meshes before it
    """
    stream = _Unpacked(packed)
    data = stream.read(_SERIALIZED_HEAD)
    (flags,) = struct.unpack("<I", data[:4])
    at = 4
    if version >= 4:
        end = data.find(b"\0", at, _SERIALIZED_HEAD - 16)
        if end < 0:
            raise ValueError(f"the name of a mesh has more than {_SERIALIZED_HEAD - 21:,} bytes, or no end")
        at = end + 1
    vertex_count, face_count = struct.unpack("<QQ", data[at : at + 16])
    at += 16
    number = "<f8" if flags & 0x2000 else "<f4"
    numbers = 3 + 3 * bool(flags & 0x0001) + 2 * bool(flags & 0x0002) + 3 * bool(flags & 0x0008)
    size = at + vertex_count * numbers * int(number[-1]) + 3 * face_count * (8 if vertex_count > 0xFFFFFFFF else 4)
    files.count(size, len(packed))
    if size > len(data):
        data += stream.read(size - len(data))

    def array(kind: str, rows: int, columns: int) -> NDArray[Any]:
        nonlocal at
        values = np.frombuffer(data, kind, rows * columns, at).reshape(rows, columns)
        at += values.nbytes
        return values

    vertices = as_float64(array(number, vertex_count, 3))
    normals = as_float64(array(number, vertex_count, 3)) if flags & 0x0001 else None
    uv = as_float64(array(number, vertex_count, 2)) if flags & 0x0002 else None
    if flags & 0x0008:
        array(number, vertex_count, 3)  # skip the colours: they have no name by which a surface could use them
    faces = array("<u8" if vertex_count > 0xFFFFFFFF else "<u4", face_count, 3)
    if not face_count or faces.max() >= vertex_count:
        raise ValueError("its faces name vertices that it does not have")
    return _finite(Mesh(vertices, faces.astype(np.int32), uv, normals), source)


def _finite(mesh: Mesh, source: str) -> Mesh:
    """Return a mesh with unit normals and only finite values. Warns of values that are not finite.

    Faces with such vertices are removed; such normals and texture coordinates become zero.
    """
    left_out: dict[str, int] = {}
    uv = None if mesh.uv is None else finite_rows(mesh.uv, "texture coordinates", left_out)
    normals = None if mesh.normals is None else unit_normals(finite_rows(mesh.normals, "normals", left_out))
    corners = mesh.faces.ravel()
    split = split_finite(source, mesh.vertices, corners, np.full(len(mesh.faces), 3), left_out)
    if not len(split.triangles):
        raise ValueError("all of its faces have a vertex that is not finite")
    return replace(mesh, faces=corners[split.triangles], uv=uv, normals=normals)
