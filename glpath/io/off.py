"""Read OFF files as meshes: vertices, then faces of any number of corners, both optionally with colours.

A line holds one vertex or one face. Comments and empty lines do not count.

Source: Geomview manual, section 4.2.5 (OFF). The number of vertices may follow the keyword, as in ModelNet.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from glpath.errors import warn
from glpath.io.polygons import split_finite
from glpath.io.text import decoded, parse_lines, statements
from glpath.io.values import finite_rows
from glpath.scene.geometry import Float64, Mesh
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.numerals import whole
from glpath.system.vectors import unit_normals

Int64 = NDArray[np.int64]
#: Line number and words of each line.
Rows = list[tuple[int, list[str]]]

# ST, C and N mean that texture coordinates, colours and normals follow the position of each vertex. The prefixes n
# and 4 are refused, because the vertices of nOFF and 4OFF are not three-dimensional.
_KEYWORD = re.compile(r"((?:ST|C|N|st|c)*)(?:OFF|off)([0-9]*)")
_KEYWORDS = "OFF, COFF, NOFF or STOFF"


def read_off(content: bytes, source: str) -> tuple[Mesh, bool]:
    """Return the mesh of a file, and True if vertices or faces have colours, which are not read.

    Vertices without faces are left out silently, other parts with a warning. Raises ValueError, or SceneError with
    the line.

    source : name of the file, for errors and warnings
    """
    prefix, vertex_count, face_count, rows = _read_head(list(statements(decoded(content))), source)
    if len(rows) < vertex_count + face_count:
        raise ValueError(
            f"it announces {vertex_count} vertices and {face_count} faces, and has {len(rows)} lines for them"
        )
    if behind := len(rows) - vertex_count - face_count:
        warn(f"{source}: {behind:,} lines behind the last face are not read, as the file announces no more.")
    left_out: dict[str, int] = {}
    mesh, vertices_coloured = _read_vertices(rows[:vertex_count], prefix, source, left_out)
    corners, sizes, faces_coloured = _read_faces(rows[vertex_count:][:face_count], vertex_count, source)
    split = split_finite(source, mesh.vertices, corners, sizes, left_out)
    triangles = corners[split.triangles].astype(np.int32)
    mesh = Mesh(mesh.vertices, triangles, mesh.uv, mesh.normals)
    return mesh.without_unused_vertices(), vertices_coloured or faces_coloured


def _read_head(rows: Rows, source: str) -> tuple[str, int, int, Rows]:
    """Return the letters before OFF, the number of vertices, the number of faces, and the lines below."""
    first = rows[0][1] if rows else [""]
    keyword = _KEYWORD.fullmatch(first[0])
    if keyword is None:
        raise ValueError(f"it begins with {shown(first[0])}, but must begin with {_KEYWORDS}")
    if first[1:2] and first[1].upper() == "BINARY":
        raise ValueError("it is a binary OFF file, but only those of text are read")
    # The number of vertices may follow the keyword without a space.
    rows = [(rows[0][0], [keyword[2], *first[1:]] if keyword[2] else first[1:]), *rows[1:]]
    rows = rows if rows[0][1] else rows[1:]
    if not rows:
        raise ValueError("it ends before the numbers of vertices and faces")
    line, words = rows[0]
    try:
        vertex_count, face_count = (whole(word) for word in words[:2])
        if min(vertex_count, face_count) < 0:
            raise ValueError
    except ValueError as error:
        raise SourceLocation(source, f"line {line}").error(
            f"has {shown(' '.join(words))}, but must have the numbers of vertices, faces and edges.",
            "For example 8 6 12.",
        ) from error
    return keyword[1].upper(), vertex_count, face_count, rows[1:]


def _read_vertices(rows: Rows, prefix: str, source: str, left_out: dict[str, int]) -> tuple[Mesh, bool]:
    """Return vertices, texture coordinates and normals as a mesh without faces, and True if there are colours.

    prefix : letters before OFF in the first line
    """
    has_uv, has_normals = "ST" in prefix, "N" in prefix
    if has_normals and "C" in prefix:
        has_normals = False
        warn(f"{source}: its normals are not read, as programs write them before its colours or behind them.")
    first = 6 if has_normals else 3
    needed = first + 2 * has_uv
    for line, words in rows:
        if len(words) < needed:
            raise SourceLocation(source, f"line {line}").error(
                f"has {len(words)} numbers, but a vertex of {prefix}OFF has at least {needed}."
            )
    texts = [" ".join(words[:first] + (words[-2:] if has_uv else [])) for _, words in rows]
    table = parse_lines(texts, (line for line, _ in rows), source).reshape(-1, needed)
    uv = finite_rows(table[:, first:], "texture coordinates", left_out) if has_uv else None
    normals = unit_normals(finite_rows(table[:, 3:6], "normals", left_out)) if has_normals else None
    has_colours = any(len(words) > needed for _, words in rows)
    return Mesh(table[:, :3], np.zeros((0, 3), np.int32), uv, normals), has_colours


def _read_faces(rows: Rows, vertex_count: int, source: str) -> tuple[Int64, Int64, bool]:
    """Return the vertex indices of all faces in one array, the face sizes, and True if there are colours."""
    lines = np.array([line for line, _ in rows], np.int64)
    sizes = _whole_numbers(parse_lines([words[0] for _, words in rows], lines.tolist(), source), lines, source)
    numbers = np.array([len(words) - 1 for _, words in rows], np.int64)
    wrong = np.flatnonzero((sizes < 0) | (numbers < sizes))
    if len(wrong):
        face = wrong[0]
        raise SourceLocation(source, f"line {lines[face]}").error(
            f"announces {sizes[face]} corners and has {numbers[face]} numbers for them.",
            "A face has the number of its corners, then their vertices.",
        )
    texts = [" ".join(words[1 : 1 + size]) for (_, words), size in zip(rows, sizes.tolist(), strict=True)]
    line_of = np.repeat(lines, sizes)
    corners = _whole_numbers(parse_lines(texts, lines.tolist(), source), line_of, source)
    beyond = np.flatnonzero((corners < 0) | (corners >= vertex_count))
    if len(beyond):
        corner = beyond[0]
        raise SourceLocation(source, f"line {line_of[corner]}").error(
            f"names vertex {corners[corner]}, but the file has {vertex_count} vertices (0 to {vertex_count - 1}).",
            "Vertex indices of OFF files count from 0.",
        )
    return corners, sizes, bool((numbers > sizes).any())


def _whole_numbers(numbers: Float64, lines: Int64, source: str) -> Int64:
    """Return numbers (N,) as integers. Raises SceneError with the line of the first that is not whole."""
    wrong = np.flatnonzero((numbers != np.floor(numbers)) | ~(np.abs(numbers) < 2.0**53))
    if len(wrong):
        raise SourceLocation(source, f"line {lines[wrong[0]]}").error(
            f"has {numbers[wrong[0]]:g}, but counts of corners and vertices are whole numbers."
        )
    return numbers.astype(np.int64)
