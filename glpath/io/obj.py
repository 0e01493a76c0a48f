"""Read OBJ files as arrays: all polygons that the format allows, in the variants that exporters write.

Indices count from 1, or backwards from the last vertex so far if they are negative. The module `text` has the rules
for lines and comments. Normals, texture coordinates and vertices that are NaN or infinite are left out, and so are
faces with such a vertex. One warning reports all of these. Faces of a smoothing group get smooth normals, if these
are requested and the file has none for them.

Source: Wavefront's Advanced Visualizer manual, appendix B1 (Object Files).
"""

from __future__ import annotations

import re
from array import array
from collections import Counter
from dataclasses import dataclass, field
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.errors import SceneError
from glpath.io.polygons import split_finite
from glpath.io.stored_colours import fractions
from glpath.io.text import decoded, parse_lines, parse_numbers, statements
from glpath.io.values import MAX_PARTS, finite_rows
from glpath.scene.source_location import SourceLocation, shown
from glpath.system.numerals import whole
from glpath.system.time_limit import check_time
from glpath.system.vectors import unit_normals

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

_NAMES = {"v": "vertex", "vt": "texture coordinate", "vn": "normal"}
_PLURALS = {"v": "vertices", "vt": "texture coordinates", "vn": "normals"}
_FACES = ("f", "fo")  # "fo" is an older name of "f"
_FLAT = ("off", "0")  # smoothing groups of faces without smoothing
_UNUSED = {"curv": "curves", "curv2": "trimming curves", "surf": "surfaces", "usemap": "texture maps of usemap"}
_MRGB = re.compile(rb"^#MRGB[ \t]+((?:[0-9a-fA-F]{8})+)[ \t]*\r?$", re.MULTILINE)
_DIGITS = b"0123456789"
# Maximum ratio of the file's vertices to a part's corners at which the part's vertices are found by a table with an
# entry for every vertex of the file. Above it, sorting the corners is faster.
_MAX_SPARSENESS = 4


@dataclass(frozen=True)
class Part:
    """Triangles of an OBJ file that share one material.

    material  : index into `ObjFile.materials`; -1 without a material
    positions : (V, 3)
    faces     : (F, 3) indices of positions
    uv        : (V, 2), NaN for vertices without texture coordinates; None if no corner has any
    normals   : (V, 3), zeros for vertices without a normal; None if no corner has one
    colours   : (V, 3) in [0, 1]; None if the file has none
    """

    material: int
    positions: Float64
    faces: Int64
    uv: Float64 | None
    normals: Float64 | None
    colours: Float64 | None


@dataclass(frozen=True)
class ObjFile:
    """Contents of an OBJ file.

    positions : (V, 3)
    colours   : (V, 3) in [0, 1]; None unless all vertices have one
    parts     : triangles by material, those without a material first
    materials : names of the materials that faces use
    libraries : names of the MTL files
    coloured  : True if any vertex has a colour; `colours` is None if only some have
    guess     : description of how the scale of colours was guessed; empty if they are fractions
    lines     : (L, 2) vertex indices, from 0, at the ends of line segments
    """

    positions: Float64
    colours: Float64 | None
    parts: list[Part]
    materials: tuple[str, ...]
    libraries: tuple[str, ...]
    coloured: bool
    guess: str
    lines: Int64


class _Tables(NamedTuple):
    """Coordinates in the statements v, vt and vn, one row for each statement."""

    v: Float64
    vt: Float64
    vn: Float64


@dataclass
class _Rows:
    """Statements of one kind, v, vt or vn, whose numbers are still text."""

    kind: str
    texts: list[str] = field(default_factory=list)
    lines: array[int] = field(default_factory=lambda: array("q"))
    widths: set[int] = field(default_factory=set)

    def append(self, line: int, values: list[str]) -> None:
        if self.kind == "vt" and len(values) == 1:
            values = [*values, "0"]  # v is 0, because a one-dimensional texture coordinate has none
        self.texts.append(" ".join(values))
        self.lines.append(line)
        self.widths.add(len(values))

    def table(self, source: str) -> Float64:
        """Return (N, W) numbers. W is the length of the shortest row; longer rows are cut. Raises SceneError."""
        width, needed = min(self.widths, default=3), 2 if self.kind == "vt" else 3
        if width < needed:
            row = next(row for row, text in enumerate(self.texts) if len(text.split()) == width)
            raise SourceLocation(source, f"line {self.lines[row]}").error(
                f"has {width} numbers, but a {_NAMES[self.kind]} has at least {needed}."
            )
        texts = self.texts if len(self.widths) < 2 else [" ".join(text.split()[:width]) for text in self.texts]
        return parse_lines(texts, self.lines, source).reshape(-1, width)


def read_obj(content: bytes, source: str, *, smooth: bool = False) -> ObjFile:
    """Return the contents of a file.

    source : name of the file, for errors
    smooth : True to compute the missing normals of faces in smoothing groups

    Raises SceneError with the line for an index that does not exist, and for a word that is not a number.
    """
    rows = {kind: _Rows(kind) for kind in _NAMES}
    face_texts: list[str] = []
    sizes: list[int] = []
    used: list[tuple[int, int]] = [(0, -1)]  # number of faces before a usemtl, and its material
    smoothing: list[tuple[int, int]] = [(0, 0)]  # number of faces before an s, and its group; 0 is none
    smoothing_groups: dict[str, int] = {}
    drawn: list[tuple[int, int, int]] = []  # vertices at the ends of a segment, and line number
    materials: dict[str, int] = {}
    libraries: dict[str, None] = {}
    unused: Counter[str] = Counter()
    for number, words in statements(decoded(content)):
        kind, values = words[0], words[1:]
        if kind in rows:
            rows[kind].append(number, values)
        elif kind in _FACES:
            text = " ".join(values)
            if "-" in text:
                text = " ".join(
                    _counted_from_one(value, rows, SourceLocation(source, f"line {number}")) for value in values
                )
            face_texts.append(text)
            sizes.append(len(values))
        elif kind == "l":
            location = SourceLocation(source, f"line {number}")
            points = [int(_counted_from_one(value, rows, location).partition("/")[0]) for value in values]
            drawn += ((*pair, number) for pair in pairwise(points))
        elif kind == "usemtl":
            name = " ".join(" ".join(values).split())
            used.append((len(sizes), materials.setdefault(name, len(materials))))
            if len(materials) > MAX_PARTS:
                raise SourceLocation(source, f"line {number}").error(
                    f"names a material after {MAX_PARTS:,} others; no more are read.", "Join materials."
                )
        elif kind == "s" and values:
            word = values[0].lower()
            group = 0 if word in _FLAT else smoothing_groups.setdefault(word, len(smoothing_groups) + 1)
            smoothing.append((len(sizes), group))
        elif kind == "mtllib":
            libraries[" ".join(values)] = None
        elif kind == "p" or (kind in _UNUSED and values != ["off"]):
            unused[kind] += 1
    check_time()
    tables = _Tables(*(each.table(source) for each in rows.values()))
    left_out = {name: unused[kind] for kind, name in _UNUSED.items()}
    polypaint = _polypaint(content)
    if len(polypaint) == len(tables.v) and tables.v.shape[1] < 6:
        tables = tables._replace(v=np.column_stack([tables.v[:, :3], polypaint]))
    else:
        left_out["colours in #MRGB"] = len(polypaint)
    corners = _corners(face_texts, sizes, source, content)
    _check_corners(corners, sizes, tables, source, content)
    lines = np.array(drawn, np.int64).reshape(-1, 3)
    for row, column in np.argwhere((lines[:, :2] < 1) | (lines[:, :2] > len(tables.v)))[:1]:
        location = SourceLocation(source, f"line {lines[row, 2]}")
        raise _no_such(location, "v", str(lines[row, column]), len(tables.v))
    material_of = _of_faces(used, len(sizes))
    if smooth and smoothing_groups:
        tables = _with_smooth_normals(tables, corners, np.array(sizes, np.int64), _of_faces(smoothing, len(sizes)))
    colours, guess = _colours(tables.v)
    if sizes:
        left_out["lines beside faces"] = len(lines)
    if sizes or len(lines):
        left_out["points beside faces or lines"] = unused["p"]
    return ObjFile(
        tables.v[:, :3],
        colours,
        _parts(tables, corners, np.array(sizes, np.int64), material_of, source, left_out),
        tuple(materials),
        tuple(libraries),
        max([*rows["v"].widths, tables.v.shape[1]]) >= 6,
        guess,
        lines[:, :2] - 1,
    )


def _of_faces(changes: list[tuple[int, int]], count: int) -> Int64:
    """Return the (count,) number of each face. A change is the number of faces before it, and the new number."""
    starts, numbers = (np.array(each, np.int64) for each in zip(*changes, strict=True))
    return np.repeat(numbers, np.diff(starts, append=count))


def _with_smooth_normals(tables: _Tables, corners: Int64, sizes: Int64, groups: Int64) -> _Tables:
    """Return the tables with normals for corners of smoothing groups; `corners` gets their indices.

    The normal of a vertex is the mean of the normals of the group's faces around it, weighted by their areas.
    Corners keep the normals that the file gives.

    sizes, groups : (F,) number of corners, and smoothing group or 0, of each face
    """
    of = np.repeat(np.arange(len(sizes)), sizes)
    is_smooth = groups[of] > 0
    if not (is_smooth & (corners[:, 2] < 0)).any():
        return tables
    positions = tables.v[corners[:, 0], :3]
    # The sum of the cross products of a polygon's edges, as seen from its first corner, is twice its area vector.
    ends = np.cumsum(sizes)
    following = np.arange(1, len(of) + 1)
    following[ends[sizes > 0] - 1] = (ends - sizes)[sizes > 0]
    origin = positions[(ends - sizes)[of]]
    with np.errstate(invalid="ignore", over="ignore"):
        crosses = np.cross(positions - origin, positions[following] - origin)
        areas = _sums(of, crosses, len(sizes))
    areas[~np.isfinite(areas).all(axis=1)] = 0.0
    check_time()
    keys = corners[is_smooth, 0] * (groups.max() + 1) + groups[of[is_smooth]]
    _, rows = np.unique(keys, return_inverse=True)
    normals = _sums(rows, areas[of[is_smooth]], int(rows.max()) + 1)
    index = len(tables.vn) + rows
    corners[is_smooth, 2] = np.where(corners[is_smooth, 2] < 0, index, corners[is_smooth, 2])
    return tables._replace(vn=np.concatenate([tables.vn[:, :3], unit_normals(normals)]))


def _sums(rows: Int64, vectors: Float64, count: int) -> Float64:
    """Return the (count, 3) sums of the vectors (N, 3) that have the same row index."""
    return np.stack([np.bincount(rows, column, count) for column in vectors.T], axis=1)


def _polypaint(content: bytes) -> Float64:
    """Return ZBrush's vertex colours as (N, 3) fractions.

    Comments `#MRGB` hold each colour as eight hexadecimal digits MMRRGGBB, where MM is a mask.
    """
    digits = b"".join(_MRGB.findall(content)) if b"#MRGB" in content else b""
    return np.frombuffer(bytes.fromhex(digits.decode()), np.uint8).reshape(-1, 4)[:, 1:] / 255.0


def _colours(rows: Float64) -> tuple[Float64 | None, str]:
    """Return the colours (V, 3) of vertices, or None, and a note if their scale had to be guessed."""
    stored = _stored_colours(rows)
    return fractions(stored, "f8") if stored.size else (None, "")


def _stored_colours(rows: Float64) -> Float64:
    """Return the (V, 3) colours of rows x y z r g b [a] or x y z weight r g b; (V, 0) if they have none.

    Seven numbers are x y z r g b a, unless the fourth, but not the seventh, is 1 for all vertices.
    """
    if rows.shape[1] < 6:
        return rows[:, :0]
    first = 4 if rows.shape[1] >= 7 and (rows[:, 3] == 1).all() and not (rows[:, 6] == 1).all() else 3
    return rows[:, first : first + 3]


def _counted_from_one(text: str, rows: dict[str, _Rows], location: SourceLocation) -> str:
    """Return a corner, such as -1/-1/-1, with its negative indices replaced by indices that count from 1."""
    indices: list[str] = []
    for (kind, each), word in zip(rows.items(), text.split("/"), strict=False):
        try:
            index = _index(word)
        except ValueError as error:
            raise _no_index(text, location) from error
        if index == 0 and not indices:
            raise _no_such(location, kind, word, len(each.texts)) if word else _no_index(text, location)
        if index < 0 and (each.texts or kind == "v"):  # exporters write indices of vt and vn that they omit
            index += len(each.texts) + 1
            if index < 1:
                raise _no_such(location, kind, word, len(each.texts))
        indices.append(str(max(index, 0) or ""))
    return "/".join(indices).rstrip("/")


def _index(word: str) -> int:
    """Return the index that a word holds; 0 if the word is empty. Raises ValueError."""
    return whole(word) if word else 0


def _no_index(corner: str, location: SourceLocation) -> SceneError:
    return location.error(
        f"has the corner {shown(corner)}, but indices are whole numbers of plain digits.",
        "Corners are v, v/vt, v//vn or v/vt/vn.",
    )


def _corners(texts: list[str], sizes: list[int], source: str, content: bytes) -> Int64:
    """Return (C, 3) indices, from 0, of the position, texture coordinate and normal of each corner; -1 for none.

    texts : corners of each face in the form v, v/vt, v//vn or v/vt/vn, separated by blanks

    Raises SceneError.
    """
    text, count = " ".join(texts), sum(sizes)
    corners = np.full((count, 3), -1, np.int64)
    if not count:
        return corners
    pattern, doubled = text.encode().translate(None, _DIGITS), text.count("//")
    for columns, between, slashes in (
        ([0], b" ", 0),
        ([0, 1], b"/ ", 0),
        ([0, 1, 2], b"// ", 0),
        ([0, 2], b"// ", count),
    ):
        if doubled == slashes and pattern == (between * count)[:-1]:
            numbers = parse_numbers(text.replace("/", " "))
            if numbers.size != count * len(columns):  # a slash may end a corner
                break
            corners[:, columns] = numbers.reshape(count, -1) - 1
            return corners
    known: dict[str, tuple[int, ...]] = {}
    words = text.split()
    for corner, word in enumerate(words):
        if word not in known:
            try:
                indices = [_index(index) - 1 for index in word.split("/")[:3]]
            except ValueError as error:
                raise _no_index(word, _location_of_corner(corner, sizes, source, content)) from error
            known[word] = (*indices, *[-1] * (3 - len(indices)))
    corners[:] = [known[word] for word in words]
    return corners


def _check_corners(corners: Int64, sizes: list[int], tables: _Tables, source: str, content: bytes) -> None:
    """Raise SceneError for an index that does not exist. Indices of omitted vt or vn statements become -1."""
    for column, (kind, table) in enumerate(zip(_NAMES, tables, strict=True)):
        if column and not len(table):  # some exporters write indices of normals that they omit
            corners[:, column] = -1
        wrong = (corners[:, column] >= len(table)) | (corners[:, column] < (-1 if column else 0))
        if wrong.any():
            corner = int(np.argmax(wrong))
            location = _location_of_corner(corner, sizes, source, content)
            raise _no_such(location, kind, str(corners[corner, column] + 1), len(table))


def _location_of_corner(corner: int, sizes: list[int], source: str, content: bytes) -> SourceLocation:
    """Return the line of the face that has a corner. The corners of all faces are numbered in order, from 0."""
    face = int(np.searchsorted(np.cumsum(sizes), corner, "right"))
    faces = (number for number, words in statements(decoded(content)) if words[0] in _FACES)
    return SourceLocation(source, f"line {next(islice(faces, face, None))}")


def _no_such(location: SourceLocation, kind: str, index: str, total: int) -> SceneError:
    above = " above it" if index.startswith("-") else ""
    allowed = f" (1 to {total})" if total else ""
    return location.error(
        f"names {_NAMES[kind]} {index}, but the file has {total} {_PLURALS[kind]}{above}{allowed}.",
        "Vertex indices of OBJ files count from 1.",
    )


def _parts(
    tables: _Tables, corners: Int64, sizes: Int64, material_of: Int64, source: str, others: dict[str, int]
) -> list[Part]:
    """Return the triangles of faces with `sizes` corners each, grouped by material. Warns of all parts left out.

    others : counts of other parts that are left out, by name; the function adds to it
    """
    uv = finite_rows(tables.vt, "texture coordinates", others)
    normals = finite_rows(tables.vn, "normals", others)
    finite_rows(_stored_colours(tables.v), "colours", others)
    split = split_finite(source, tables.v[:, :3], corners[:, 0], sizes, others)
    triangles, materials = corners[split.triangles], material_of[split.polygons]
    colours, _ = _colours(tables.v)
    uv, normals = np.vstack([uv[:, :2], np.full(2, np.nan)]), np.vstack([normals[:, :3], np.zeros(3)])
    vertices = _Attributes(tables.v[:, :3], uv, normals, colours)
    if len(materials) and (materials == materials[0]).all():
        return [_part(int(materials[0]), triangles, vertices)]
    order = np.argsort(materials, kind="stable")
    numbers, starts = np.unique(materials[order], return_index=True)
    groups = np.split(triangles[order], starts[1:])
    return [_part(number, group, vertices) for number, group in zip(numbers.tolist(), groups, strict=False)]


class _Attributes(NamedTuple):
    """Vertex attributes by row, for the indices in corners.

    Index -1 selects the last row, which is NaN in `uv` and zero in `normals`.
    """

    positions: Float64
    uv: Float64
    normals: Float64
    colours: Float64 | None


def _part(material: int, triangles: Int64, rows: _Attributes) -> Part:
    """Return the part for triangles (T, 3 corners, 3 indices), with one vertex for each distinct corner."""
    check_time()
    corners = triangles.reshape(-1, 3)
    has_uv, has_normals = (bool((corners[:, column] >= 0).any()) for column in (1, 2))
    # A table of all vertices of the file is worthwhile only if the part uses a large fraction of them.
    key, is_vertex = corners[:, 0], _MAX_SPARSENESS * len(corners) >= len(rows.positions)
    for column, count in [(1, len(rows.uv) - 1)] * has_uv + [(2, len(rows.normals) - 1)] * has_normals:
        if not np.array_equal(corners[:, column], corners[:, 0]):
            _, key = np.unique(key, return_inverse=True)
            key, is_vertex = key * (count + 1) + corners[:, column] + 1, False
    if is_vertex:
        first = np.full(len(rows.positions), -1, np.int64)
        first[key[::-1]] = np.arange(len(key))[::-1]
        is_used = first >= 0
        first, faces = first[is_used], (np.cumsum(is_used) - 1)[key]
    else:
        _, first, faces = np.unique(key, return_index=True, return_inverse=True)
    vertices = corners[first]
    return Part(
        material,
        rows.positions[vertices[:, 0]],
        faces.reshape(-1, 3),
        rows.uv[vertices[:, 1]] if has_uv else None,
        rows.normals[vertices[:, 2]] if has_normals else None,
        None if rows.colours is None else rows.colours[vertices[:, 0]],
    )
