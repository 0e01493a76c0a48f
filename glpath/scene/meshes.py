"""Meshes: inline vertices and faces, and OBJ, PLY and STL files [trimesh].

trimesh takes most of a second to import, so it is imported when the first mesh file is read.
The geometry and the texture coordinates of a file are used: its materials, pictures and normals are not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from glpath.errors import SceneError
from glpath.scene.model import Float64
from glpath.scene.place import Place
from glpath.scene.tessellate import Int64, split_faces
from glpath.scene.values import nearby_files

FORMATS = (".obj", ".ply", ".stl")


def inline_mesh(
    vertices: list[tuple[float, float, float]], faces: list[list[int]], place: Place
) -> tuple[Float64, Int64]:
    """(V, 3) float64 vertices and (F, 3) int64 triangles; `place` is the shape's. Raises SceneError."""
    for name, given in (("vertices", vertices), ("faces", faces)):
        if not given:
            raise place.field(name).error("is empty, but a mesh needs three vertices and one face.")
    for index, face in enumerate(faces):
        for vertex in face:
            if not 0 <= vertex < len(vertices):
                raise _no_such_vertex(place.field("faces").item(index), vertex, len(vertices))
    return np.array(vertices, np.float64), split_faces(faces)


def read_mesh(path: Path, place: Place) -> tuple[Float64, Int64, Float64 | None]:
    """The triangles of a mesh file.

    Returns (V, 3) float64 vertices, (F, 3) int64 faces, and (V, 2) float64 texture coordinates, or None where the
    file has none or not for all faces.

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
        vertices, faces, uv = _parse(path)
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
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(broken):
        raise Place(str(path), f"vertex {broken[0]}").wrong(
            vertices[broken[0]], "three finite numbers", "Mend the file."
        )
    if uv is not None and not np.isfinite(uv).all():
        vertex = np.flatnonzero(~np.isfinite(uv).all(axis=1))[0]
        raise Place(str(path), f"texture coordinate {vertex}").wrong(
            uv[vertex], "two finite numbers", "Mend the file."
        )
    return vertices, faces, uv


def _parse(path: Path) -> tuple[Float64, Int64, Float64 | None]:
    import trimesh

    options = {}
    if path.suffix.lower() == ".obj":
        _check_obj_indices(path)
        options = {"skip_materials": True}
    mesh = trimesh.load_mesh(str(path), process=False, **options)
    vertices = np.array(getattr(mesh, "vertices", ()), np.float64).reshape(-1, 3)
    faces = np.array(getattr(mesh, "faces", ()), np.int64).reshape(-1, 3)
    uv = getattr(getattr(mesh, "visual", None), "uv", None)
    if uv is None or np.shape(uv) != (len(vertices), 2):
        return vertices, faces, None
    return vertices, faces, np.array(uv, np.float64)


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
