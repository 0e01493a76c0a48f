"""Meshes: inline vertices and faces, and files of `FORMATS` [trimesh].

trimesh takes most of a second to import, so it is imported when the first mesh file is read.
Of a mesh that is a shape of a scene, the geometry, the texture coordinates and normals of vertices are used; the
materials, colours and pictures in its file are not (`mesh_models` uses them), which a SceneWarning says. No normals
are made up where it has none.
"""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError, SceneWarning, warn
from glpath.io import obj
from glpath.io.off import read_off
from glpath.io.polygons import split_faces, split_polygons, warn_of_crossing
from glpath.io.precision import step_at, warn_of_steps
from glpath.io.stl import read_stl
from glpath.io.strokes import balls, line_radius, point_radius, rods
from glpath.io.text import decoded
from glpath.io.values import LARGEST, nearby_files
from glpath.scene.geometry import unit_normals
from glpath.scene.model import Float64, Mesh
from glpath.scene.source_location import SourceLocation
from glpath.system.files import read_bytes
from glpath.system.private_interfaces import given_trimesh_normals

FORMATS = (".obj", ".ply", ".stl", ".off")
#: The same for a reader.
NAMES = " or ".join(", ".join(suffix[1:].upper() for suffix in FORMATS).rsplit(", ", 1))
# In the header of a PLY.
_RED = re.compile(rb"^property\s+\S+\s+red\s*$", re.MULTILINE)
_POINTS = re.compile(rb"\belement\s+vertex\s+[1-9]")
_TRIANGLES = re.compile(rb"\belement\s+(?:face|tristrips)\s+0*[1-9]")
_SINGLE = re.compile(rb"^property\s+(?:float|float32)\s+[xyz]\s*$", re.MULTILINE)
_COORDINATES = re.compile(rb"^(property\s.*\s)((?:texture_)?[uv]|s|t|texcoord)(?=\s*$)", re.MULTILINE)
#: Keys of the geometry of a mesh in a dictionary.
MESH_KEYS = ("mesh", "vertices", "faces", "uv")


def inline_mesh(
    vertices: list[tuple[float, float, float]], faces: list[list[int]], location: SourceLocation
) -> Mesh:
    """The mesh of vertices, and faces of three or more of them; `location` is the shape's. Raises SceneError."""
    for name, given in (("vertices", vertices), ("faces", faces)):
        if not given:
            raise location.field(name).error("is empty, but a mesh needs three vertices and one face.")
    for index, face in enumerate(faces):
        for vertex in face:
            if not 0 <= vertex < len(vertices):
                raise _no_such_vertex(location.field("faces").item(index), vertex, len(vertices))
    positions = np.array(vertices, np.float64)
    triangles, crossing = split_faces(positions, faces)
    warn_of_crossing(str(location.field("faces")), crossing)
    return Mesh(positions, triangles)


def mesh_of_table(table: Mapping[str, Any], location: SourceLocation, known: dict[int, Mesh]) -> Mesh | None:
    """The mesh of a shape's table where it is an object or arrays; None where it is described by plain values.

    location : the shape's
    known : meshes of trimesh's, by identity, which grows
    """
    if table.get("type", "mesh") != "mesh":
        return None
    given = table.get("mesh")
    if given is not None:
        others = [key for key in (*MESH_KEYS[1:], "file") if key in table]
        if others:
            raise location.error(
                f"has mesh and {' and '.join(others)}, but a mesh is one of them.", "Leave one away."
            )
        if isinstance(given, Mesh):
            return given
        trimesh = sys.modules.get("trimesh")
        if trimesh is None or not isinstance(given, trimesh.Trimesh):
            raise location.field("mesh").error(
                f"is a {type(given).__name__}, but must be a trimesh.Trimesh.",
                "Arrays go into `vertices` and `faces`; a trimesh.Scene is a scene: load_scene(it).",
            )
        if id(given) not in known:
            known[id(given)] = mesh_of_trimesh(given, location.field("mesh"))
        return known[id(given)]
    arrays = [table.get(key) for key in MESH_KEYS[1:]]
    if (
        "file" in table
        or not all(isinstance(each, np.ndarray) for each in arrays[:2])
        or not isinstance(arrays[2], np.ndarray | None)
    ):
        return None
    return mesh_of_arrays(arrays[0], arrays[1], arrays[2], location)  # type: ignore[arg-type]


def mesh_of_trimesh(mesh: Any, location: SourceLocation) -> Mesh:
    """Its triangles, with texture coordinates and vertex normals where it has them; none are made up."""
    uv = _of_each(getattr(mesh.visual, "uv", None), mesh, 2)
    made = mesh_of_arrays(np.asarray(mesh.vertices), np.asarray(mesh.faces), uv, location)
    normals = _of_each(given_trimesh_normals(mesh), mesh, 3)
    return made if normals is None else replace(made, normals=unit_normals(normals))


def mesh_of_arrays(
    vertices: NDArray[Any], faces: NDArray[Any], uv: NDArray[Any] | None, location: SourceLocation
) -> Mesh:
    """The mesh of vertices (V, 3), faces (F, 3) or (F, 4), texture coordinates (V, 2). Raises SceneError.

    `location` is the shape's.
    """
    numbers, whole = "numbers", "whole numbers"
    for name, array, columns, kinds, what in (
        ("vertices", vertices, (3,), "fiu", numbers),
        ("faces", faces, (3, 4), "iu", whole),
        ("uv", uv, (2,), "fiu", numbers),
    ):
        if array is None:
            continue
        if array.ndim != 2 or array.shape[1] not in columns or array.dtype.kind not in kinds or not len(array):
            allowed = " or ".join(f"(n, {width})" for width in columns)
            raise location.field(name).error(
                f"is an array of shape {array.shape} and type {array.dtype}, but must be {what} of shape "
                f"{allowed}, n at least 1.",
                "One row for each face, of vertices counted from 0." if name == "faces" else "",
            )
        beyond = np.argwhere(~(np.abs(array) <= LARGEST))
        if name != "faces" and len(beyond):
            row, column = beyond[0]
            raise (
                location.field(name)
                .item(int(row))
                .item(int(column))
                .wrong(float(array[row, column]), f"a finite number between -{LARGEST:g} and {LARGEST:g}")
            )
    beyond = np.argwhere((faces < 0) | (faces >= len(vertices)))
    if len(beyond):
        row, column = beyond[0]
        raise _no_such_vertex(location.field("faces").item(int(row)), int(faces[row, column]), len(vertices))
    if uv is not None and len(uv) != len(vertices):
        raise location.field("uv").error(
            f"has {len(uv)} pairs, but the mesh has {len(vertices)} vertices.",
            "List one pair [u, v] for each vertex, in the same order.",
        )
    positions, corners = np.array(vertices, np.float64), faces.astype(np.int32).ravel()
    split = split_polygons(positions, corners, np.full(len(faces), faces.shape[1]))
    warn_of_crossing(str(location.field("faces")), split.crossing)
    return Mesh(positions, corners[split.triangles], None if uv is None else np.array(uv, np.float64))


def read_mesh(path: Path, location: SourceLocation) -> Mesh:
    """The mesh of a file, with texture coordinates where the file has them for all faces, and so with normals.

    `location` is where the scene names the file. Raises SceneError for a file that is missing, of another format,
    broken, without triangles, or whose faces name vertices it does not have. Warns of colours and materials in it.
    """
    file = read_mesh_file(path, location, colours=False)
    _warn_of_what_is_dropped(path, file)
    meshes = [mesh_of_loaded(mesh, path) for mesh in file.meshes]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + np.int32(start) for mesh, start in zip(meshes, first, strict=False)]
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(faces),
        _joined([mesh.uv for mesh in meshes]),
        _joined([mesh.normals for mesh in meshes]),
    )


def _joined(parts: list[Float64 | None]) -> Float64 | None:
    """One array of all; None where a mesh has none."""
    there = [part for part in parts if part is not None]
    return np.concatenate(there) if len(there) == len(parts) else None


@dataclass(frozen=True)
class MeshFile:
    """A file as trimesh loads it.

    meshes   : objects of trimesh, each with faces
    obj      : the contents of an OBJ file
    texture  : the name of the picture that a PLY has
    coloured : vertices or faces have colours, in the file
    single   : its vertices are numbers of 32 bits
    """

    meshes: list[Any]
    obj: obj.ObjFile | None = None
    texture: str | None = None
    coloured: bool = False
    single: bool = False


def read_mesh_file(path: Path, location: SourceLocation, *, colours: bool) -> MeshFile:
    """The contents of a file. `location` and errors as of `read_mesh`.

    colours : those of a PLY without a texture are wanted, not its texture coordinates: trimesh has one or the other
    """
    if path.suffix.lower() not in FORMATS:
        raise location.wrong(
            str(path), f"a mesh file that ends in {', '.join(FORMATS)}", "Convert the mesh, e.g. in Blender."
        )
    if not os.path.isfile(path):  # unlike Path.is_file, also where the name is too long
        raise location.error(
            f"names the mesh file {path}, which {'is not a file' if os.path.exists(path) else 'does not exist'}.",
            nearby_files("Mesh files", path, FORMATS),
        )
    try:
        file = _parse(path, colours)
    except (SceneError, SceneWarning):
        raise
    except Exception as error:  # trimesh raises whatever its parsers run into
        reason = f"{type(error).__name__}: {error}".rstrip(" .!")
        raise location.error(
            f"{which(path, location)}cannot be read as {path.suffix[1:].upper()}: {reason}.",
            "Open the file in another program to see whether it is whole, and write it anew.",
        ) from error
    if not file.meshes:
        raise location.error(
            f"{which(path, location)}has no triangles.",
            "The file is empty, broken, of another format than its suffix says, or holds points or lines only. "
            "In a file that is a model of its own, points of .ply and points and lines of .obj and glTF are drawn.",
        )
    if file.single:
        corners = np.array([(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in file.meshes])
        if np.isfinite(corners).all():
            low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
            source = location if location == SourceLocation(str(path)) else f"{location} names {path}:"
            warn_of_steps(source, step_at(low, high), low, high)
    return file


def which(path: Path, location: SourceLocation) -> str:
    """How a sentence about a file begins where `location` names it: with its name, but not of a model alone."""
    return "" if location == SourceLocation(str(path)) else f"names {path}, which "


def mesh_of_loaded(mesh: Any, path: Path) -> Mesh:
    """A mesh of trimesh's that was read from a file, without its colours. Raises SceneError for what is broken."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    beyond = np.argwhere((faces < 0) | (faces >= len(vertices)))
    if len(beyond):
        face, corner = beyond[0]
        raise _no_such_vertex(SourceLocation(str(path), f"face {face}"), int(faces[face, corner]), len(vertices))
    uv = _of_each(getattr(mesh.visual, "uv", None), mesh, 2)
    normals = _of_each(given_trimesh_normals(mesh), mesh, 3)
    for name, values in (("vertex", vertices), ("texture coordinate", uv), ("normal of vertex", normals)):
        if values is not None and not np.isfinite(values).all():
            number = np.flatnonzero(~np.isfinite(values).all(axis=1))[0]
            raise SourceLocation(str(path), f"{name} {number}").wrong(
                values[number], f"{'two' if values is uv else 'three'} finite numbers", "Mend the file."
            )
    return Mesh(vertices, faces.astype(np.int32), uv, None if normals is None else unit_normals(normals))


def _of_each(values: Any, mesh: Any, width: int) -> Float64 | None:
    """(V, width) of a mesh's vertices; None where they are not of all."""
    if values is None or np.shape(values) != (len(mesh.vertices), width):
        return None
    return np.array(values, np.float64)


def _parse(path: Path, colours: bool) -> MeshFile:
    import trimesh

    suffix, content = path.suffix.lower(), read_bytes(path)
    texture = None
    options: dict[str, Any] = {}
    if suffix == ".obj":
        plain = obj.read_obj(content, str(path))
        meshes = [_loaded(part) for part in plain.parts]
        if colours and not meshes:
            meshes = _strokes_of_obj(plain, path)
        return MeshFile(meshes, plain, coloured=plain.coloured)
    if suffix == ".off":
        positions, triangles, has_colours = read_off(content, str(path))
        meshes = [trimesh.Trimesh(positions, triangles, process=False)] if len(triangles) else []
        return MeshFile(meshes, coloured=has_colours)
    if suffix == ".stl":
        solids = [each for each in read_stl(content, str(path)) if len(each.corners)]
        meshes = [
            trimesh.Trimesh(
                each.corners.reshape(-1, 3), np.arange(3 * len(each.corners)).reshape(-1, 3), process=False
            )
            for each in solids
        ]
        return MeshFile(meshes, single=any(each.attributes is not None for each in solids))
    if suffix == ".ply":
        header, end, _ = content.partition(b"end_header")
        if end and not _TRIANGLES.search(header):  # trimesh takes the points of some for a broken file
            return MeshFile(_points_of_ply(content, path) if colours else [])
        content, texture = _plain_ply(content, colours)
        options = {"skip_materials": True}
    loaded = trimesh.load_scene(io.BytesIO(content), file_type=suffix[1:], process=False, **options)
    # One by one, as `load_mesh` joins them and forgets the normals.
    meshes = [loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry]
    meshes = [mesh for mesh in meshes if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    for mesh in meshes:
        for array in (mesh.vertices, mesh.faces):
            if np.ndim(array) != 2 or np.shape(array)[1] != 3:
                raise ValueError(f"its vertices or faces have {np.shape(array)} numbers, not three each")
    coloured = False
    if suffix == ".ply":
        coloured = _RED.search(content.partition(b"end_header")[0]) is not None
    # Of text as well, which trimesh takes at its word.
    single = suffix == ".ply" and _SINGLE.search(content.partition(b"end_header")[0]) is not None
    return MeshFile(meshes, None, texture, coloured, single)


def _loaded(part: obj.Part) -> Any:
    """A mesh of trimesh's of a part of an OBJ."""
    import trimesh

    visual = None if part.uv is None else trimesh.visual.TextureVisuals(uv=part.uv)  # type: ignore[no-untyped-call]
    return trimesh.Trimesh(
        part.positions,
        part.faces,
        vertex_normals=part.normals,
        vertex_colors=part.colours,
        visual=visual,
        metadata={"material": part.material},
        process=False,
    )


def _strokes_of_obj(plain: obj.ObjFile, path: Path) -> list[Any]:
    """The lines of a file without faces as a mesh of rods, else its vertices as balls; with their colours."""
    points, colours = plain.positions, plain.colours
    is_finite = np.asarray(np.isfinite(points).all(axis=1))
    if not is_finite.any():
        return []
    lines = plain.lines[is_finite[plain.lines].all(axis=1)]
    if len(lines):
        used = np.unique(lines)
        radius = line_radius(points[used])
        made = rods(points, lines, radius)
        drawn = f"{len(lines):,} lines are drawn as rods"
    else:
        points, colours = points[is_finite], None if colours is None else colours[is_finite]
        radius = point_radius(points)
        made = balls(points, radius)
        drawn = f"{len(points):,} points are drawn as balls"
    warn(f"{path}: has no triangles, so its {drawn} of radius {radius:.3g}.")
    return [_stroked(*made, colours)]


def _stroked(vertices: Float64, faces: NDArray[Any], normals: Float64, of: NDArray[Any], colours: Any) -> Any:
    """A mesh of trimesh's from what `balls` and `rods` return, and colours of their points, or None."""
    import trimesh

    given = {} if colours is None else {"vertex_colors": np.asarray(colours)[of]}
    return trimesh.Trimesh(vertices, faces, vertex_normals=normals, process=False, **given)


def _points_of_ply(content: bytes, path: Path) -> list[Any]:
    """A cloud of points as a mesh of balls, with its colours; none where there is nothing to draw."""
    import trimesh

    header = content.partition(b"end_header")[0]
    if not _POINTS.search(header):
        return []
    cloud: Any = trimesh.load(io.BytesIO(content), file_type="ply")
    points = np.asarray(cloud.vertices, np.float64)
    if points.ndim != 2 or not len(points) or not np.isfinite(points).all():
        return []
    radius = point_radius(points)
    colours: Any = getattr(cloud, "colors", None)
    warn(f"{path}: has no triangles, so its {len(points):,} points are drawn as balls of radius {radius:.3g}.")
    return [_stroked(*balls(points, radius), colours if np.shape(colours) == (len(points), 4) else None)]


def _plain_ply(content: bytes, colours: bool) -> tuple[bytes, str | None]:
    """The file with an ASCII header (comments may hold names that are not), and the name of its texture."""
    header, end, rest = content.partition(b"end_header")
    named = re.search(rb"^comment TextureFile\s+(.*?)\s*$", header, re.MULTILINE)
    texture = decoded(named[1]) if named else None
    if colours and texture is None and _RED.search(header):
        header = _COORDINATES.sub(rb"\1unused_\2", header)
    return header.decode("ascii", errors="replace").encode("ascii", errors="replace") + end + rest, texture


def _warn_of_what_is_dropped(path: Path, file: MeshFile) -> None:
    kinds = {getattr(mesh.visual, "kind", None) for mesh in file.meshes}
    dropped = {f"{kind} colours" for kind in kinds if kind in ("vertex", "face")}
    if file.texture is not None:
        dropped.add("a texture")
    if file.obj is not None and (file.obj.materials or file.obj.libraries):
        dropped.add("materials")
    if file.coloured and not dropped & {"vertex colours", "face colours"}:
        dropped.add("colours" if file.obj is None else "vertex colours")
    if dropped:
        warn(
            f"{path}: {' and '.join(sorted(dropped))} in it are not used: the shape has the material that the "
            "scene gives it. In an [[assets]] table the file has its own."
        )


def _no_such_vertex(location: SourceLocation, vertex: int, count: int) -> SceneError:
    return location.error(
        f"names vertex {vertex}, but the mesh has {count} vertices (0 to {count - 1}).",
        "Face indices count from 0; OBJ files count from 1.",
    )
