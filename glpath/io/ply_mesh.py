"""Triangles or points of a PLY file, with the attributes of its vertices and faces.

These names of properties are read, in any case:

    positions            x y z
    normals              nx ny nz
    texture coordinates  u v, s t, texture_u texture_v, and similar
    colours              red green blue alpha, r g b a, diffuse_red ..., color_r ... and similar
    faces                lists vertex_indices or vertex_index, and texcoord for each corner
    strips               list tristrips, in which -1 separates strips
    edges                vertex1 vertex2
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import warn
from glpath.io.ply import Element, Header, Int64, Ragged, read_elements
from glpath.io.polygons import split_finite
from glpath.io.stored_colours import fractions, linear
from glpath.io.values import as_float64, finite_rows, no_such_vertex, warn_of_left_out
from glpath.scene.geometry import Float64, Mesh
from glpath.scene.source_location import SourceLocation
from glpath.system.vectors import unit_normals

# Elements that are read, and the camera, which is ignored without a note.
_ELEMENTS = ("vertex", "face", "tristrips", "camera")
_EDGE = ("vertex1", "vertex2")
_POSITION = ("x", "y", "z")
_NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
_UV = (
    ("texture_u", "texture_v"),
    ("u", "v"),
    ("s", "t"),
    ("texture_s", "texture_t"),
    ("texcoord_u", "texcoord_v"),
    ("texcoord_s", "texcoord_t"),
)
_COLOURS = tuple(
    (f"{prefix}{red}", f"{prefix}{green}", f"{prefix}{blue}", f"{prefix}{alpha}")
    for prefix in ("", "diffuse_", "diffuse", "color_", "colour_", "vertex_", "face_", "vertex_color_")
    for red, green, blue, alpha in (("red", "green", "blue", "alpha"), ("r", "g", "b", "a"))
) + tuple(tuple(f"{prefix}{index}" for index in range(4)) for prefix in ("color_", "colour_", "rgb_"))
# Names of properties that probably hold colours. A note lists those that are not read.
_COLOUR_LIKE = re.compile(r"red|green|blue|rgb|colou?r|^[rgb]$|f_dc_|intensity|gr[ae]y|luminance|reflectance")


@dataclass(frozen=True)
class PlyMesh:
    """Triangles of a file; if it has no faces, its vertices are a cloud of points.

    mesh       : mesh with vertex or face colours; triangles with face colours share no vertices
    textures   : names of the pictures
    coloured   : "vertex colours", "face colours" or ""
    single     : True if positions have 32 bits or fewer
    vertices   : element of the vertices, as stored
    faces      : element of the faces, as stored
    vertex_of  : (V,) row of `vertices` for each vertex of the mesh
    edges      : (L, 2) vertices of the mesh at the ends of edges, if the file has no faces
    polygon_of : (F,) row of `faces` for each triangle of the mesh; -1 for triangles of strips
    notes      : parts of the file that are not used, as sentences
    """

    mesh: Mesh
    textures: tuple[str, ...]
    coloured: str
    single: bool
    vertices: Element
    faces: Element
    vertex_of: Int64
    edges: Int64
    polygon_of: Int64
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Triangles:
    """Triangles of faces and strips.

    corners  : (F, 3) vertex indices
    polygons : (F,) row of the face of each triangle; -1 for triangles of strips
    uv       : (3 F, 2) texture coordinates of the corners; None if the file has none
    """

    corners: Int64
    polygons: Int64
    uv: Float64 | None


def read_ply_mesh(content: bytes, header: Header, source: str, *, looks: bool) -> PlyMesh:
    """Return the triangles of a file. Raises ValueError, or SceneError for faces with vertices that do not exist.

    Warns of faces, points and attributes that are dropped because their numbers are not finite.

    source : name of the file, for errors and warnings
    looks  : True if colours are used; only then a guessed scale and an alpha of 0 give a warning
    """
    elements, behind = read_elements(content, header)
    vertices, faces = elements.get("vertex", Element()), elements.get("face", Element())
    if not header.count("vertex") or not vertices.first_of(_POSITION):
        raise ValueError("its header announces no vertices with the properties x, y and z")
    if behind:
        unit = "numbers" if header.format == "ascii" else "bytes"
        warn(f"{source}: {behind:,} {unit} behind the last element are not read, as the header announces no more.")
    positions = vertices.stacked(_POSITION)
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    others = [
        f"{name} ({each.count:,})"
        for name, each in elements.items()
        if each.count and name not in _ELEMENTS and not each.first_of(_EDGE)
    ]
    notes = [f"Elements of other kinds: {', '.join(others)}."] if others else []
    left_out: dict[str, int] = {}
    edges = _edges(elements.get("edge", Element()), finite, source)
    if header.count("face", "tristrips"):
        left_out["edges beside faces"] = len(edges)
    uv = _attribute(vertices, _UV, "texture coordinates", left_out)
    normals = _attribute(vertices, _NORMALS, "normals", left_out)
    colours = _Colours(source, looks, notes, left_out)
    of_vertices, face_colours = colours.of(vertices), colours.of(faces)
    triangles = _triangles(elements, positions, finite, source, left_out)
    vertex_of = np.arange(len(positions))
    if len(triangles.corners):
        is_used = np.zeros(len(positions), np.bool_)
        is_used[triangles.corners] = True
        used = np.flatnonzero(is_used)
        if not finite.all():
            positions[~finite] = positions[used[0]]  # finite placeholders for vertices that no triangle uses
    else:
        used = vertex_of = vertex_of[finite]
    vertex_colours = of_vertices
    if of_vertices is not None and face_colours is not None:
        # MeshLab adds the same colour for all vertices to files with face colours. Such vertex colours are dropped.
        if len(used) and np.ptp(of_vertices[used], axis=0).any():
            notes.append("Colours of faces, beside those of vertices.")
            face_colours = None
        else:
            notes.append("Colours of vertices, beside those of faces.")
            vertex_colours = None
    coloured = (
        "face colours" if face_colours is not None else "vertex colours" if vertex_colours is not None else ""
    )
    normals = None if normals is None else unit_normals(normals)
    attributes = {"uv": uv, "normals": normals, "colours": vertex_colours if looks else None}
    selected = {name: None if values is None else values[vertex_of] for name, values in attributes.items()}
    mesh = Mesh(positions[vertex_of], triangles.corners.astype(np.int32), **selected)
    with_face_colours = face_colours is not None and looks
    if len(mesh.faces) and (with_face_colours or triangles.uv is not None):
        vertex_of, mesh = triangles.corners.ravel(), mesh.unshared()
        if triangles.uv is not None:
            mesh = replace(mesh, uv=triangles.uv)
        if with_face_colours:
            assert face_colours is not None
            of_triangles = np.concatenate([face_colours, np.ones((1, 4))])[triangles.polygons]  # row -1 is white
            mesh = replace(mesh, colours=np.repeat(of_triangles, 3, axis=0))
    if mesh.colours is not None:
        alpha = mesh.colours[:, 3]
        if not np.any(alpha[mesh.faces] if len(mesh.faces) else alpha):
            mesh.colours[:, 3] = 1.0
            warn(f"{source}: alpha is 0 everywhere, by which nothing could be seen: it is taken for opaque.")
    return PlyMesh(
        mesh,
        tuple(header.textures),
        coloured,
        any(vertices.types[name] in ("f2", "f4") for name in _POSITION),
        vertices,
        faces,
        vertex_of,
        edges,
        triangles.polygons,
        tuple(notes),
    )


def _triangles(
    elements: dict[str, Element],
    positions: Float64,
    finite: NDArray[np.bool_],
    source: str,
    left_out: dict[str, int],
) -> _Triangles:
    """Return the triangles whose vertices have finite positions. Warns of all parts that are left out."""
    faces, strips = elements.get("face", Element()), elements.get("tristrips", Element())
    lists = _vertex_lists(faces, "face")
    _check_vertices(lists, "face", len(positions), source, min_vertex=0)
    in_strips = _vertex_lists(strips, "tristrips")
    _check_vertices(in_strips, "tristrips", len(positions), source, min_vertex=-1)
    of_strips = _triangles_of_strips(in_strips)
    strips_finite = np.asarray(finite[of_strips].all(axis=1))
    left_out["triangles of strips with such a vertex"] = int(np.count_nonzero(~strips_finite))
    of_strips = of_strips[strips_finite]
    texcoord = faces.lists.get("texcoord")
    uv = None
    if texcoord is not None and np.array_equal(texcoord.counts, 2 * lists.counts) and not len(of_strips):
        uv = finite_rows(as_float64(texcoord.values.reshape(-1, 2)), "texture coordinates of corners", left_out)
    if not faces.count and not strips.count:
        left_out = {"points that are not finite": int(np.count_nonzero(~finite)), **left_out}
        warn_of_left_out(source, left_out)
        return _Triangles(np.zeros((0, 3), np.int64), np.zeros(0, np.int64), None)
    # Triangles of `split` are indices into `lists.values`.
    split = split_finite(source, positions, lists.values, lists.counts, left_out)
    return _Triangles(
        np.concatenate([lists.values[split.triangles], of_strips]),
        np.concatenate([split.polygons, np.full(len(of_strips), -1)]),
        None if uv is None else uv[split.triangles.ravel()],
    )


def _edges(edges: Element, finite: NDArray[np.bool_], source: str) -> Int64:
    """Return (L, 2) edges between finite vertices; indices count only finite vertices. Raises SceneError."""
    if not edges.first_of(_EDGE):
        return np.zeros((0, 2), np.int64)
    stored = np.nan_to_num(edges.stacked(_EDGE), nan=-1)
    wrong = np.argwhere((stored < 0) | (stored >= len(finite)))
    if len(wrong):
        row, column = wrong[0]
        raise no_such_vertex(SourceLocation(source, f"edge {row}"), int(stored[row, column]), len(finite))
    ends = stored.astype(np.int64)
    ends = ends[finite[ends].all(axis=1)]
    return np.asarray((np.cumsum(finite) - 1)[ends])


def _vertex_lists(element: Element, name: str) -> Ragged:
    """Return the vertex lists of faces or strips. Raises ValueError if they have none."""
    if not element.count:
        return Ragged(np.zeros(0, np.int64), np.zeros(0, np.int64))
    found = [each for key, each in element.lists.items() if key in ("vertex_indices", "vertex_index")]
    found = found or list(element.lists.values())[:1]
    if not found:
        raise ValueError(f"its element {name} has no property list with the name vertex_indices")
    values = found[0].values
    if values.dtype.kind == "f":
        wrong = np.flatnonzero((values != np.floor(values)) | ~(np.abs(values) < 2.0**62))
        if len(wrong):
            raise ValueError(f"its element {name} names vertex {values[wrong[0]]}, which is not a whole number")
    return Ragged(found[0].counts, values.astype(np.int64))


def _check_vertices(lists: Ragged, name: str, count: int, source: str, *, min_vertex: int) -> None:
    """Raise SceneError for a list with a vertex that does not exist."""
    wrong = np.flatnonzero((lists.values < min_vertex) | (lists.values >= count))
    if len(wrong):
        row = int(np.searchsorted(np.cumsum(lists.counts), wrong[0], side="right"))
        raise no_such_vertex(SourceLocation(source, f"{name} {row}"), int(lists.values[wrong[0]]), count)


def _triangles_of_strips(strips: Ragged) -> Int64:
    """Return (T, 3) vertices of the triangles of strips; every second triangle is flipped.

    Each vertex of a strip except the first two completes a triangle. Triangles that name a vertex twice are left
    out, because they only lead the strip to another position.
    """
    values = strips.values
    if len(values) < 3:
        return np.zeros((0, 3), np.int64)
    number = np.arange(len(values))
    starts = np.zeros(len(values) + 1, np.bool_)
    starts[np.cumsum(strips.counts) - strips.counts] = True
    starts[1:] |= values == -1
    begin = np.maximum.accumulate(np.where(starts[:-1], number, 0))
    last = np.flatnonzero((number - begin >= 2) & (values != -1))
    first, second = last - 2, last - 1
    odd = (last - begin[last]) % 2 == 1
    corners = np.stack([np.where(odd, second, first), np.where(odd, first, second), last], axis=1)
    triangles = values[corners]
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (c != a)])


def _attribute(
    element: Element, choices: tuple[tuple[str, ...], ...], name: str, left_out: dict[str, int]
) -> Float64 | None:
    """Return an attribute of all vertices, in which rows that are not finite are 0; None if the file has none."""
    names = element.first_of(*choices)
    return finite_rows(element.stacked(names), name, left_out) if names else None


def _kind(stored: NDArray[Any], declared: str) -> str:
    """Return the `declared` type of colours; float64 if an ASCII file declares integers but has fractions."""
    finite = stored[np.isfinite(stored)]
    return declared if declared[0] == "f" or (finite == np.floor(finite)).all() else "f8"


@dataclass(frozen=True)
class _Colours:
    """Reader of element colours, which collects notes and the counts of colours that are not finite."""

    source: str
    looks: bool
    notes: list[str]
    left_out: dict[str, int]

    def of(self, element: Element) -> Float64 | None:
        """Return (count, 4) linear Rec. 709 and alpha; None if the element has no colours."""
        names = element.first_of(*(each[:3] for each in _COLOURS))
        alpha = next((each[3] for each in _COLOURS if each[:3] == names), "alpha")
        alpha = alpha if alpha in element.columns else "alpha"
        found = (*element.columns, *element.lists)
        others = [name for name in found if _COLOUR_LIKE.search(name) and name not in (*names, alpha)]
        if others:
            listed = ", ".join(others[:6]) + (", ..." if len(others) > 6 else "")
            self.notes.append(f"Colours in the properties {listed}.")
        if not names or not element.count:
            return None
        stored = element.stacked(names)
        declared = element.types[names[0]]
        kind = _kind(stored, declared)
        values, guess = fractions(stored, kind)
        if kind != declared and not guess:
            guess = "they are fractions, although the header declares whole numbers"
        colours = linear(values)
        if alpha in element.columns:
            colours[:, 3], _ = fractions(
                element.columns[alpha], _kind(element.columns[alpha], element.types[alpha])
            )
            stored = np.column_stack([stored, element.columns[alpha]])
        if self.looks:
            finite_rows(stored, "colours", self.left_out)
        if guess and self.looks:
            warn(f"{self.source}: its colours {', '.join(names)}: {guess}.")
        return colours
