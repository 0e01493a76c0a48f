"""Meshes: inline vertices and faces, objects of trimesh, and files of `FORMATS`.

A shape of a scene uses the geometry, the texture coordinates and the vertex normals of its mesh file. It does not
use the materials, colours and pictures in the file, and a SceneWarning reports this; `mesh_models` uses them.
Missing normals are computed only for faces in smoothing groups of an OBJ.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError, SceneWarning, warn
from glpath.io import obj
from glpath.io.off import read_off
from glpath.io.ply import read_header
from glpath.io.ply_mesh import PlyMesh, read_ply_mesh
from glpath.io.polygons import polygon_errors_at, split_faces, split_polygons, warn_of_crossing
from glpath.io.precision import step_at, warn_of_steps
from glpath.io.stl import read_stl
from glpath.io.stored_colours import colours_of_facets, linear
from glpath.io.strokes import balls, line_radius, point_radius, rods, used_points
from glpath.io.values import LARGEST, finite_rows, nearby_files, no_such_vertex, warn_of_left_out
from glpath.scene.model import Float64, Mesh
from glpath.scene.source_location import SourceLocation
from glpath.system.bounded_reading import reading_file
from glpath.system.files import absence_of, read_bytes
from glpath.system.private_interfaces import given_trimesh_normals
from glpath.system.vectors import unit_normals

FORMATS = (".obj", ".ply", ".stl", ".off")
#: Names of the formats for messages: "OBJ, PLY, STL or OFF".
NAMES = " or ".join(", ".join(suffix[1:].upper() for suffix in FORMATS).rsplit(", ", 1))
#: Note on textures of meshes with faces without texture coordinates.
UV_GAPS = "Textures of faces without texture coordinates: each shows one of its texels."
#: Keys of a dictionary that hold the geometry of a mesh.
MESH_KEYS = ("mesh", "vertices", "faces", "uv")


def inline_mesh(
    vertices: list[tuple[float, float, float]], faces: list[list[int]], location: SourceLocation
) -> Mesh:
    """Return the mesh of vertices and of faces with three or more corners. Raises SceneError.

    location : location of the shape
    """
    for name, given in (("vertices", vertices), ("faces", faces)):
        if not given:
            raise location.field(name).error("is empty, but a mesh needs three vertices and one face.")
    for index, face in enumerate(faces):
        for vertex in face:
            if not 0 <= vertex < len(vertices):
                raise no_such_vertex(location.field("faces").item(index), vertex, len(vertices))
    positions = np.array(vertices, np.float64)
    with polygon_errors_at(location.field("faces")):
        triangles, crossing = split_faces(positions, faces)
    warn_of_crossing(str(location.field("faces")), crossing)
    return Mesh(positions, triangles)


def is_kind(table: Mapping[str, Any], kind: str) -> bool:
    """Return True if a shape's table has this type or none; False for a type that is no text, such as an array."""
    given = table.get("type", kind)
    return isinstance(given, str) and given == kind


def mesh_of_table(table: Mapping[str, Any], location: SourceLocation, known: dict[int, Mesh]) -> Mesh | None:
    """Return the mesh of a shape's table if its geometry is an object or arrays; None if it is lists or a file.

    location : location of the shape
    known    : cache of meshes by id() of the trimesh object, to which new meshes are added
    """
    if not is_kind(table, "mesh"):
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
    """Return the triangles of a trimesh mesh, with its texture coordinates and vertex normals if it has them.

    Missing normals are not computed.
    """
    uv = _of_each(getattr(mesh.visual, "uv", None), mesh, 2)
    made = mesh_of_arrays(np.asarray(mesh.vertices), np.asarray(mesh.faces), uv, location)
    normals = _of_each(given_trimesh_normals(mesh), mesh, 3)
    if normals is None:
        return made
    left_out: dict[str, int] = {}
    normals = finite_rows(normals, "normals", left_out)
    warn_of_left_out(str(location), left_out)
    return replace(made, normals=unit_normals(normals))


def mesh_of_arrays(
    vertices: NDArray[Any], faces: NDArray[Any], uv: NDArray[Any] | None, location: SourceLocation
) -> Mesh:
    """Return the mesh of vertices (V, 3), faces (F, 3) or (F, 4), and texture coordinates (V, 2).

    location : location of the shape

    Raises SceneError.
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
        raise no_such_vertex(location.field("faces").item(int(row)), int(faces[row, column]), len(vertices))
    if uv is not None and len(uv) != len(vertices):
        raise location.field("uv").error(
            f"has {len(uv)} pairs, but the mesh has {len(vertices)} vertices.",
            "List one pair [u, v] for each vertex, in the same order.",
        )
    positions, corners = np.array(vertices, np.float64), faces.astype(np.int32).ravel()
    with polygon_errors_at(location.field("faces")):
        split = split_polygons(positions, corners, np.full(len(faces), faces.shape[1]))
    warn_of_crossing(str(location.field("faces")), split.crossing)
    return Mesh(positions, corners[split.triangles], None if uv is None else np.array(uv, np.float64))


def read_mesh(path: Path, location: SourceLocation) -> Mesh:
    """Return the mesh of a file. Texture coordinates are NaN, and normals zero, for faces without them.

    location : location in the scene that names the file

    Raises SceneError for a file that is missing, of another format, broken, or without triangles, and for faces
    that name missing vertices. Warns of colours and materials in the file, which are not used.
    """
    file = read_mesh_file(path, location, colours=False, smooth=True)
    _warn_of_what_is_dropped(path, file)
    return Mesh.joined(_with_equal_attributes(file.meshes))


def _with_equal_attributes(meshes: list[Mesh]) -> list[Mesh]:
    """Return the meshes with uv NaN and with normals zero, if they lack them but others have them."""
    has_uv, has_normals = (
        any(mesh.uv is not None for mesh in meshes),
        any(mesh.normals is not None for mesh in meshes),
    )
    return [
        replace(
            mesh,
            uv=np.full((len(mesh.vertices), 2), np.nan) if has_uv and mesh.uv is None else mesh.uv,
            normals=np.zeros((len(mesh.vertices), 3)) if has_normals and mesh.normals is None else mesh.normals,
        )
        for mesh in meshes
    ]


def has_uv_gaps(mesh: Mesh) -> bool:
    """Return True if only some vertices of a mesh have texture coordinates; those of the others are NaN."""
    return mesh.uv is not None and bool(np.isnan(mesh.uv).any())


def without_uv_gaps(mesh: Mesh) -> Mesh:
    """Return the mesh with texture coordinates (0, 1), a texture's first texel, for vertices without any."""
    if mesh.uv is None or not has_uv_gaps(mesh):
        return mesh
    return replace(mesh, uv=np.where(np.isnan(mesh.uv), (0.0, 1.0), mesh.uv))


@dataclass(frozen=True)
class MeshFile:
    """Meshes of a file, in the order in which the file first uses their materials.

    meshes    : meshes with faces, and with colours if these are requested; texture coordinates may have gaps
    materials : index of each mesh's material in an OBJ, or -1
    obj       : contents of the file if it is an OBJ
    ply       : contents of the file if it is a PLY
    coloured  : "vertex colours", "face colours", "colours", or "" if the file has none
    single    : True if the file stores positions as 32-bit numbers
    """

    meshes: list[Mesh]
    materials: list[int] = field(default_factory=list)
    obj: obj.ObjFile | None = None
    ply: PlyMesh | None = None
    coloured: str = ""
    single: bool = False


def read_mesh_file(path: Path, location: SourceLocation, *, colours: bool, smooth: bool = False) -> MeshFile:
    """Return the contents of a file. `location` and errors are those of `read_mesh`.

    colours : True reads colours, and turns the points or lines of a file without faces into meshes
    smooth  : True computes the missing normals of faces in smoothing groups of an OBJ
    """
    if path.suffix.lower() not in FORMATS:
        raise location.wrong(
            str(path), f"a mesh file that ends in {', '.join(FORMATS)}", "Convert the mesh, e.g. in Blender."
        )
    if not os.path.isfile(path):  # Path.is_file may raise if the name is too long
        raise location.error(
            f"names the mesh file {path}, which {absence_of(path)}.",
            nearby_files("Mesh files", path, FORMATS),
        )
    try:
        with reading_file(path.name):
            file = _parse(path, colours, smooth)
    except (GlpathError, SceneWarning):
        raise
    except Exception as error:  # parsers may raise anything for a damaged file
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        reason = f"{kind}{error}".rstrip(" .!")
        raise location.error(
            f"{which(path, location)}cannot be read as {path.suffix[1:].upper()}: {reason}.",
            "Open the file in another program to see whether it is whole, and write it anew.",
        ) from error
    if not file.meshes:
        raise location.error(
            f"{which(path, location)}has no triangles.",
            "The file is empty, broken, of another format than its suffix says, or holds points or lines only. "
            "In a file that is a model of its own, points and lines of .obj, .ply and glTF are drawn.",
        )
    if file.single:
        corners = np.array([(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in file.meshes])
        if np.isfinite(corners).all():
            low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
            source = location if location == SourceLocation(str(path)) else f"{location} names {path}:"
            warn_of_steps(source, step_at(low, high), low, high)
    return file


def which(path: Path, location: SourceLocation) -> str:
    """Return the beginning of an error text: "names PATH, which ", or "" if `location` is the file itself."""
    return "" if location == SourceLocation(str(path)) else f"names {path}, which "


def _of_each(values: Any, mesh: Any, width: int) -> Float64 | None:
    """Return values as (V, width) float64; None if they are missing or of another shape."""
    if values is None or np.shape(values) != (len(mesh.vertices), width):
        return None
    return np.array(values, np.float64)


def _parse(path: Path, colours: bool, smooth: bool) -> MeshFile:
    suffix, content = path.suffix.lower(), read_bytes(path)
    if suffix == ".ply":
        return _ply(content, path, colours)
    if suffix == ".obj":
        return _obj(obj.read_obj(content, str(path), smooth=smooth), path, colours)
    if suffix == ".off":
        mesh, has_colours = read_off(content, str(path))
        meshes = [mesh] if len(mesh.faces) else []
        return MeshFile(meshes, [-1] * len(meshes), coloured="colours" if has_colours else "")
    return _stl(content, path, colours)


def _stl(content: bytes, path: Path, colours: bool) -> MeshFile:
    solids = [each for each in read_stl(content, str(path)) if len(each.corners)]
    meshes, coloured = [], ""
    for solid in solids:
        mesh = Mesh.of_triangles(solid.corners)
        rgba = None if solid.attributes is None else colours_of_facets(solid.attributes, solid.header)
        if rgba is None and solid.attributes is not None and solid.attributes.max() >> 15:
            warn(f"{path}: the numbers behind its facets are not taken for colours, as those of some have no mark.")
        if rgba is not None:
            coloured = "face colours"
            mesh = replace(mesh, colours=np.repeat(rgba, 3, axis=0)) if colours else mesh
        meshes.append(mesh)
    single = any(each.attributes is not None for each in solids)
    return MeshFile(meshes, [-1] * len(meshes), coloured=coloured, single=single)


def _obj(plain: obj.ObjFile, path: Path, colours: bool) -> MeshFile:
    """Return the contents of an OBJ; vertex colours are included if `colours` is True."""
    meshes, materials = [], [part.material for part in plain.parts]
    for part in plain.parts:
        normals = None if part.normals is None else unit_normals(part.normals)
        rgba = linear(part.colours) if colours and part.colours is not None else None
        meshes.append(Mesh(part.positions, part.faces.astype(np.int32), part.uv, normals, colours=rgba))
    if colours and not meshes:
        rgba = None if plain.colours is None else linear(plain.colours)
        meshes = _strokes(path, plain.positions, plain.lines, rgba)
        materials = [-1] * len(meshes)
    return MeshFile(meshes, materials, plain, coloured="vertex colours" if plain.coloured else "")


def _strokes(path: Path, points: Float64, lines: NDArray[Any], colours: Float64 | None) -> list[Mesh]:
    """Return a mesh of rods for the lines of a file without faces, or else of balls for its points.

    Lines with the same ends are drawn once.

    colours : (N, 4) colours of the points, which the mesh takes over; None if the file has none
    """
    is_finite = np.asarray(np.isfinite(points).all(axis=1))
    if not is_finite.any():
        return []
    lines = lines[is_finite[lines].all(axis=1)]
    ends = np.sort(lines, axis=1)
    lines = lines[np.sort(np.unique(ends @ [len(points), 1], return_index=True)[1])]  # each line once
    if len(lines):
        radius = line_radius(points[used_points(len(points), lines)])
        made = rods(points, lines, radius)
        drawn = f"{len(lines):,} lines are drawn as rods"
    else:
        points, colours = points[is_finite], None if colours is None else colours[is_finite]
        radius = point_radius(points)
        made = balls(points, radius)
        drawn = f"{len(points):,} points are drawn as balls"
    warn(f"{path}: has no triangles, so its {drawn} of radius {radius:.3g}.")
    vertices, faces, normals, of = made
    colours = None if colours is None else colours[of]
    return [Mesh(vertices, faces.astype(np.int32), normals=normals, colours=colours)]


def _ply(content: bytes, path: Path, colours: bool) -> MeshFile:
    """Return the contents of a PLY.

    colours : True if a file without faces becomes rods along its edges, or balls at its points if it has no edges;
              False if it is empty
    """
    header = read_header(content)
    if not colours and not header.count("face", "tristrips"):
        return MeshFile([])
    read = read_ply_mesh(content, header, str(path), looks=colours)
    meshes = [read.mesh]
    if not len(read.mesh.faces):
        if header.count("face", "tristrips"):
            return MeshFile([])
        meshes = _strokes(path, read.mesh.vertices, read.edges, read.mesh.colours)
    return MeshFile(meshes, [-1] * len(meshes), ply=read, coloured=read.coloured, single=read.single)


def _warn_of_what_is_dropped(path: Path, file: MeshFile) -> None:
    dropped = {file.coloured} - {""}
    if file.ply is not None and file.ply.textures:
        dropped.add("a texture")
    if file.obj is not None and (file.obj.materials or file.obj.libraries):
        dropped.add("materials")
    if dropped:
        warn(
            f"{path}: {' and '.join(sorted(dropped))} in it are not used: the shape has the material that the "
            "scene gives it. In an [[assets]] table the file has its own."
        )
