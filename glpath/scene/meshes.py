"""Meshes: inline vertices and faces, and OBJ, PLY and STL files [trimesh].

trimesh takes most of a second to import, so it is imported when the first mesh file is read.
The geometry, the texture coordinates and the normals of vertices in a file are used: its materials and pictures are
not, and no normals are made up where it has none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.scene.model import Float64, Mesh
from glpath.scene.place import Place
from glpath.scene.tessellate import split_faces
from glpath.scene.values import nearby_files

FORMATS = (".obj", ".ply", ".stl")


def inline_mesh(vertices: list[tuple[float, float, float]], faces: list[list[int]], place: Place) -> Mesh:
    """Of vertices, and faces of three or four of them; `place` is the shape's. Raises SceneError."""
    for name, given in (("vertices", vertices), ("faces", faces)):
        if not given:
            raise place.field(name).error("is empty, but a mesh needs three vertices and one face.")
    for index, face in enumerate(faces):
        for vertex in face:
            if not 0 <= vertex < len(vertices):
                raise _no_such_vertex(place.field("faces").item(index), vertex, len(vertices))
    return Mesh(np.array(vertices, np.float64), split_faces(faces))


def read_mesh(path: Path, place: Place) -> Mesh:
    """The mesh of a file, with texture coordinates where the file has them for all faces, and so with normals.

    `place` is where the scene names the file. Raises SceneError for a file that is missing, of another format,
    broken, without triangles, or whose faces name vertices it does not have.
    """
    if path.suffix.lower() not in FORMATS:
        raise place.wrong(
            str(path), f"a mesh file that ends in {', '.join(FORMATS)}", "Convert the mesh, e.g. in Blender."
        )
    if not path.is_file():
        raise place.error(
            f"names the mesh file {path}, which {'is not a file' if path.exists() else 'does not exist'}.",
            nearby_files("Mesh files", path, FORMATS),
        )
    try:
        vertices, faces, uv, normals = _parse(path)
    except SceneError:
        raise
    except Exception as error:  # trimesh raises whatever its parsers run into
        raise place.error(
            f"names {path}, which cannot be read as {path.suffix[1:].upper()}: {type(error).__name__}: {error}.",
            "Open the file in another program to see whether it is whole, and write it anew.",
        ) from error
    if len(faces) == 0:
        raise place.error(
            f"names {path}, in which no triangle was found.",
            "The file is empty, broken, of another format than its suffix says, or holds points only.",
        )
    beyond = np.argwhere((faces < 0) | (faces >= len(vertices)))
    if len(beyond):
        face, corner = beyond[0]
        raise _no_such_vertex(Place(str(path), f"face {face}"), int(faces[face, corner]), len(vertices))
    for name, values in (("vertex", vertices), ("texture coordinate", uv), ("normal of vertex", normals)):
        if values is not None and not np.isfinite(values).all():
            number = np.flatnonzero(~np.isfinite(values).all(axis=1))[0]
            raise Place(str(path), f"{name} {number}").wrong(
                values[number], f"{'two' if values is uv else 'three'} finite numbers", "Mend the file."
            )
    return Mesh(vertices, faces.astype(np.int32), uv, None if normals is None else _unit(normals))


def _unit(normals: Float64) -> Float64:
    """Of length 1, and zero where they are."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(length > 0, length, 1.0))


def _parse(path: Path) -> tuple[Float64, NDArray[np.int64], Float64 | None, Float64 | None]:
    """Vertices (V, 3), faces (F, 3), texture coordinates (V, 2) and normals (V, 3), each as the file has them."""
    import trimesh

    options: dict[str, Any] = {}
    if path.suffix.lower() == ".obj":
        _check_obj_indices(path)
        options = {"skip_materials": True}
    loaded = trimesh.load_scene(str(path), process=False, **options)
    # As `load_mesh` joins them, which forgets the normals.
    meshes = [loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry]
    meshes = [mesh for mesh in meshes if isinstance(mesh, trimesh.Trimesh)]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces.astype(np.int64) + start for mesh, start in zip(meshes, first, strict=False)]
    # The attribute `vertex_normals` makes up normals; the cache has them only where the file has (trimesh's own
    # exporters ask in this way).
    normals = [mesh.vertex_normals if "vertex_normals" in mesh._cache else None for mesh in meshes]
    return (
        np.concatenate([np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        _of_all([getattr(mesh.visual, "uv", None) for mesh in meshes], meshes, 2),
        _of_all(normals, meshes, 3),
    )


def _of_all(parts: list[ArrayLike | None], meshes: list[Any], width: int) -> Float64 | None:
    """(V, width) of all meshes' vertices; None where it is missing for one of them."""
    complete = [np.array(p, np.float64) for p, mesh in zip(parts, meshes, strict=True)
                if p is not None and np.shape(p) == (len(mesh.vertices), width)]  # fmt: skip
    return np.concatenate(complete) if complete and len(complete) == len(meshes) else None


def _check_obj_indices(path: Path) -> None:
    """OBJ counts from 1, or backwards from -1. trimesh takes an index 0 for the last vertex without a word."""
    lines = path.read_text(errors="replace").splitlines()
    total = sum(line.startswith("v ") for line in lines)
    seen = 0
    for number, line in enumerate(lines, start=1):
        if line.startswith("v "):
            seen += 1
        elif line.startswith("f "):
            for corner in line.split()[1:]:
                index = int(corner.split("/", 1)[0])
                if not (1 <= index <= total or -seen <= index <= -1):
                    raise Place(str(path), f"line {number}").error(
                        f"names vertex {index}, but the file has {total} vertices (1 to {total}).",
                        "Vertex indices of OBJ files count from 1.",
                    )


def _no_such_vertex(place: Place, vertex: int, count: int) -> SceneError:
    return place.error(
        f"names vertex {vertex}, but the mesh has {count} vertices (0 to {count - 1}).",
        "Face indices count from 0; OBJ files count from 1.",
    )
