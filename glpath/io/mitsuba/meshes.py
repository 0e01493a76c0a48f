"""The meshes of Mitsuba's shapes: files, and the squares, cubes and disks that it knows by name.

As Mitsuba does, smooth normals are made for files without, unless `face_normals`. v is turned upwards.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.io.export.geometry import v_downwards
from glpath.io.meshes import mesh_of_loaded, read_mesh_file
from glpath.io.mitsuba.plugin import Plugin
from glpath.scene.geometry import Float64, Mesh, unit_normals
from glpath.scene.tessellate import quad_mesh
from glpath.system.files import read_bytes

_SEGMENTS = 128  # of a disk
# Of a cube's faces the corners where uv is (0, 1), (1, 1), (1, 0) and (0, 0), v downwards.
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
_SERIALIZED = 0x041C
_PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_PLY_TYPES |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_PLY_TYPES |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
_PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


def read_file(plugin: Plugin, suffix: str, *, coloured: bool) -> Mesh:
    """The mesh of an OBJ, PLY or serialized file. Raises SceneError.

    coloured : with the colours of its vertices, which it must have
    """
    name = plugin.text("filename")
    where = plugin.where("filename")
    if not name:
        raise plugin.location.error("lacks the parameter `filename`, which must be there.")
    path = plugin.element.file(name)
    flips = plugin.flag("flip_tex_coords", suffix == ".obj")
    if suffix == ".serialized":
        mesh = _serialized(plugin, path)
    else:
        if path.suffix.lower() != suffix:
            raise where.error(f"names {name}, but must be a file that ends in {suffix}.")
        # Materials in it are not used, in Mitsuba neither.
        file = read_mesh_file(path, where, colours=False)
        mesh = _joined([mesh_of_loaded(each, path) for each in file.meshes])
    if mesh.uv is not None and not flips:
        mesh = replace(mesh, uv=v_downwards(mesh.uv))
    if plugin.flag("face_normals", False):
        mesh = replace(mesh, normals=None)
    elif mesh.normals is None:
        mesh = replace(mesh, normals=smooth_normals(mesh))
    if not coloured:
        return mesh
    colours = _ply_colours(read_bytes(path)) if suffix == ".ply" else None
    if colours is None or len(colours) != len(mesh.vertices):
        raise where.error(
            f"names {name}, whose vertices have no colours r, g and b, but its surface asks for vertex_color.",
            "Write the file with them, or give the surface a colour.",
        )
    return replace(mesh, colours=np.concatenate([colours, np.ones((len(colours), 1))], axis=1))


def rectangle() -> Mesh:
    """From -1 to 1 in x and y, its front towards +z."""
    return _v_down(quad_mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]))


def cube() -> Mesh:
    """From -1 to 1 in x, y and z, fronts outward."""
    return Mesh(_CUBE, _CUBE_FACES, uv=v_downwards(np.tile(_CUBE_UV, (6, 1))))


def disk() -> Mesh:
    """Of radius 1 in x and y, its front towards +z: a polygon of the same area. u is the radius, v the angle."""
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


def smooth_normals(mesh: Mesh) -> Float64:
    """(V, 3) unit: the mean of the faces' normals about each vertex, by their angles there."""
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


def _joined(meshes: list[Mesh]) -> Mesh:
    """One mesh of all."""
    if len(meshes) == 1:
        return meshes[0]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])

    def of_all(values: list[Any]) -> Any:
        return None if any(each is None for each in values) else np.concatenate(values)

    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, first, strict=False)]),
        of_all([mesh.uv for mesh in meshes]),
        of_all([mesh.normals for mesh in meshes]),
    )


def _ply_colours(content: bytes) -> Float64 | None:
    """(V, 3) of the properties r, g and b of a PLY's vertices, numbers of any kind; None without.

    trimesh knows colours of bytes only.
    """
    header, _, body = content.partition(b"end_header")
    body = body[body.index(b"\n") + 1 :]
    lines = header.decode("ascii", errors="replace").splitlines()
    order = next((line.split()[1] for line in lines if line.startswith("format ")), "")
    names: list[tuple[str, str]] = []
    count, in_vertices = 0, False
    for words in (line.split() for line in lines):
        if words[:1] == ["element"]:
            in_vertices = words[1] == "vertex"
            if not in_vertices and not count:
                return None  # vertices that are not first
            count = int(words[2]) if in_vertices else count
        elif words[:1] == ["property"] and in_vertices:
            if words[1] not in _PLY_TYPES:
                return None
            names.append((words[2], _PLY_TYPES[words[1]]))
    if not {"r", "g", "b"} <= {name for name, _ in names}:
        return None
    if order == "ascii":
        rows = np.loadtxt(body.decode("ascii").splitlines()[:count], ndmin=2)
        columns = [rows[:, [name for name, _ in names].index(letter)] for letter in "rgb"]
    elif order in _PLY_ORDERS:
        dtype = np.dtype([(name, _PLY_ORDERS[order] + kind) for name, kind in names])
        if len(body) < count * dtype.itemsize:
            return None
        table = np.frombuffer(body, dtype, count)
        columns = [table[letter] for letter in "rgb"]
    else:
        return None
    return np.stack(columns, axis=1).astype(np.float64)


def _serialized(plugin: Plugin, path: Path) -> Mesh:
    """One of the meshes of Mitsuba's own format, `shape_index`. Raises SceneError."""
    where, index = plugin.where("filename"), plugin.whole("shape_index", 0)
    try:
        content = read_bytes(path)
        count = struct.unpack("<I", content[-4:])[0]
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
        return _of_stream(zlib.decompressobj().decompress(content[start + 4 :]), version)
    except (OSError, ValueError, struct.error, zlib.error, IndexError) as error:
        raise where.error(
            f"names {path}, which cannot be read as meshes of Mitsuba: {error}.", "Write it anew, as PLY."
        ) from error


def _of_stream(data: bytes, version: int) -> Mesh:
    """The mesh of an unpacked stream: flags, name, counts, then arrays one after the other."""
    (flags,) = struct.unpack("<I", data[:4])
    at = 4
    if version >= 4:
        at = data.index(b"\0", at) + 1
    vertex_count, face_count = struct.unpack("<QQ", data[at : at + 16])
    at += 16
    number = "<f8" if flags & 0x2000 else "<f4"

    def array(kind: str, rows: int, columns: int) -> NDArray[Any]:
        nonlocal at
        values = np.frombuffer(data, kind, rows * columns, at).reshape(rows, columns)
        at += values.nbytes
        return values

    vertices = array(number, vertex_count, 3).astype(np.float64)
    normals = array(number, vertex_count, 3).astype(np.float64) if flags & 0x0001 else None
    uv = array(number, vertex_count, 2).astype(np.float64) if flags & 0x0002 else None
    if flags & 0x0008:
        array(number, vertex_count, 3)  # colours, of no use without a name
    faces = array("<u8" if vertex_count > 0xFFFFFFFF else "<u4", face_count, 3)
    if not face_count or faces.max() >= vertex_count:
        raise ValueError("its faces name vertices that it does not have")
    flat = None if normals is None or flags & 0x0010 else unit_normals(normals)
    return Mesh(vertices, faces.astype(np.int32), uv, flat)
