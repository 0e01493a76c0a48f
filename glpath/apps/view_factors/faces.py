"""Read and check the faces for which view factors are computed, from a scene, a mesh, or arrays."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.accel.bvh import build_bvh
from glpath.apps.view_factors.convex import CORNERS
from glpath.apps.view_factors.facets import (
    ROUNDING,
    Outline,
    convex_parts,
    merged,
    planar_regions,
    polygons_of,
)
from glpath.apps.view_factors.records import Polygons, Tree
from glpath.errors import SceneError, UsageError, warn
from glpath.io import load_scene
from glpath.io.completed import aside
from glpath.io.meshes import FORMATS, read_mesh_file
from glpath.scene import Scene, path_traceable
from glpath.scene.source_location import SourceLocation
from glpath.system.arguments import short_repr

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

#: Maximum distance of a face's corner from its plane, as a fraction of the face's size.
_FLAT = 1e-4
_LISTED = 3


@dataclass(frozen=True, eq=False)
class Faces:
    """Flat one-sided polygons, and the row of the matrix that each belongs to.

    vertices : (V, 3) float64, scene units, without duplicates
    outlines : vertex indices of the corners of each face with an area, counter-clockwise seen from the front
    rows     : (F,) int64, matrix row of each face; if each face is a row, its index among the given faces
    given    : number of given faces, including faces without an area
    names    : names of the rows; empty if rows are the faces, in their order
    source   : name of the input in error messages
    """

    vertices: Float64
    outlines: tuple[Outline, ...]
    rows: Int64
    given: int
    names: tuple[str, ...] = ()
    source: str = "faces"

    @property
    def row_count(self) -> int:
        return len(self.names) or self.given

    def row_geometry(self) -> tuple[Float64, Float64]:
        """Return the centroids and unit normals of the rows, each (N, 3); NaN for rows without an area.

        The normal of several faces is the direction of their summed area vectors, NaN if these cancel out.
        """
        sides = np.array([len(outline) for outline in self.outlines], np.int64)
        flat = np.fromiter((corner for outline in self.outlines for corner in outline), np.int64, int(sides.sum()))
        first = np.concatenate([[0], np.cumsum(sides)[:-1]]) if len(sides) else sides
        face = np.repeat(np.arange(len(sides)), sides - 2)  # index of the face of each fan triangle
        step = np.arange(len(face)) - np.repeat(np.cumsum(sides - 2) - (sides - 2), sides - 2)
        a, b, c = (self.vertices[flat[first[face] + at]] for at in (0, step + 1, step + 2))
        doubled = np.cross(b - a, c - a)
        of_face = _sums(face, doubled, len(sides))
        # Triangles of a fan outside a concave face have negative weight.
        unit = of_face / np.maximum(np.linalg.norm(of_face, axis=1, keepdims=True), np.finfo(float).tiny)
        weight = np.einsum("ij,ij->i", doubled, unit[face])
        moments = _sums(face, weight[:, None] * (a + b + c) / 3, len(sides))
        n, tiny = self.row_count, 1e-12
        area = np.bincount(self.rows, np.linalg.norm(of_face, axis=1), n)[:, None]
        vector = _sums(self.rows, of_face, n)
        length = np.linalg.norm(vector, axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            centroids = np.where(area > 0, _sums(self.rows, moments, n) / area, np.nan)
            return centroids, np.where(length > tiny * area, vector / length, np.nan)

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hex) of all inputs that the matrix depends on."""
        flat = np.array([v for outline in self.outlines for v in (*outline, -1)], np.int64)
        parts = (self.vertices, flat, self.rows)
        return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def _sums(group: Int64, values: Float64, count: int) -> Float64:
    """Return the sums (count, 3) of values (M, 3) by group, where `group` (M,) is each value's group."""
    return np.stack([np.bincount(group, column, count) for column in values.T], axis=1)


def faces_of(given: Any, groups: str | ArrayLike = "faces", flip: bool = False) -> Faces:
    """Convert the arguments of `glpath.view_factors` to faces. Raises SceneError and UsageError."""
    shape_of: Int64 | None = None
    shape_names: list[str] = []
    by_shape = isinstance(groups, str) and groups == "shapes"  # `==` on an array of labels would give an array
    if isinstance(given, np.ndarray | list):
        corners = _array(given, "faces", "(N, k, 3): N faces, k >= 3")
        if corners.ndim != 3 or corners.shape[2] != 3 or corners.shape[1] < 3:
            raise UsageError(
                f"view_factors: an array of shape {corners.shape}; allowed is (N, k, 3): N faces, k >= 3.",
                "Faces with different numbers of corners are (vertices, faces), a list of numbers for each.",
            )
        source, n, k = "faces", *corners.shape[:2]
        vertices = corners.reshape(-1, 3)
        outlines: list[Any] = np.arange(n * k).reshape(n, k).tolist()
    elif isinstance(given, tuple) and len(given) == 2:
        source, (vertices, outlines) = "faces", _indexed(*given)
    elif hasattr(given, "vertices") and hasattr(given, "faces") and not isinstance(given, Scene):
        source, (vertices, outlines) = "mesh", _indexed(given.vertices, given.faces)
    elif isinstance(given, str | Path) and Path(given).suffix.lower() in FORMATS and not by_shape:
        source = str(given)  # not loaded as a scene, because scenes leave out triangles without area
        file = read_mesh_file(Path(given), SourceLocation(source), colours=False)
        meshes = file.meshes
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        outlines = [
            face for mesh, start in zip(meshes, first, strict=False) for face in (mesh.faces + start).tolist()
        ]
    else:
        with geometry_alone():
            loaded = given if isinstance(given, Scene) else load_scene(given)
            scene = path_traceable(loaded.still(), centred=False)
        source = scene.source or scene.name
        vertices = scene.triangles.reshape(-1, 3)
        outlines = np.arange(len(vertices)).reshape(-1, 3).tolist()
        shape_of = np.asarray(scene.triangle_shape, np.int64)
        shape_names = [shape.name or f"shape {i}" for i, shape in enumerate(scene.shapes)]
    if flip:
        outlines = [outline[::-1] for outline in outlines]
    checked = _checked(np.asarray(vertices, np.float64), outlines, source)
    rows, names = _rows(checked, groups, shape_of, shape_names)
    return Faces(checked.vertices, checked.outlines, rows, checked.given, names, source)


def _array(given: Any, what: str, allowed: str) -> Float64:
    """Return `given` as float64. Raises UsageError unless it holds real numbers in rows of equal length."""
    try:
        array = np.asarray(given)
        if array.dtype.kind in "biuf":
            return np.asarray(array, np.float64)
    except (TypeError, ValueError):  # rows of different lengths
        pass
    raise UsageError(
        f"view_factors: {what} are no array of numbers; allowed is {allowed}.",
        "Faces with different numbers of corners are (vertices, faces), a list of numbers for each.",
    )


def _indexed(vertices: Any, faces: Any) -> tuple[Float64, list[list[int]]]:
    """Return the vertices (V, 3), and the vertex indices of each face. Raises UsageError."""
    array, outlines = _array(vertices, "vertices", "(V, 3)"), _outlines(faces)
    if array.ndim != 2 or array.shape[1] != 3:
        raise UsageError(f"view_factors: vertices of shape {array.shape}; allowed is (V, 3).")
    return array, outlines


def _outlines(given: Any) -> list[list[int]]:
    """Return the faces as lists of int. Raises UsageError if vertex indices are not whole numbers."""
    if isinstance(given, np.ndarray) and given.ndim == 2 and given.dtype.kind in "iu":
        return [list(face) for face in given.tolist()]
    try:
        outlines = [[(int(v), v) for v in face] for face in given]
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            "view_factors: faces are no lists of numbers of vertices; allowed are three or more for each face."
        ) from None
    for i, outline in enumerate(outlines):
        for whole, number in outline:
            if whole != number:
                raise UsageError(
                    f"view_factors: faces[{i}] names vertex {number}; allowed are whole numbers, from 0 on."
                )
    return [[whole for whole, _ in outline] for outline in outlines]


@contextmanager
def geometry_alone() -> Iterator[None]:
    """Context in which scenes load without warnings or errors about a missing camera or light."""
    with aside("camera", "light"):
        yield


def _rows(
    faces: Faces, groups: str | ArrayLike, shape_of: Int64 | None, shape_names: list[str]
) -> tuple[Int64, tuple[str, ...]]:
    count, kept = faces.given, faces.rows
    if isinstance(groups, str):
        if groups == "faces":
            return kept, ()
        if groups == "planar":
            labels = planar_regions(faces.vertices, faces.outlines, _size(faces.vertices))
            return labels, tuple(f"plane {i}" for i in range(int(labels.max()) + 1))
        if groups == "shapes":
            if shape_of is None:
                raise UsageError(
                    "view_factors: groups is shapes, but arrays and meshes have none.",
                    "Give a label for each face instead, or a scene.",
                )
            used, labels = np.unique(shape_of[kept], return_inverse=True)
            return labels.astype(np.int64), _distinct([shape_names[i] for i in used])
        raise UsageError(
            f"view_factors: groups is {short_repr(groups)}; allowed are faces, planar, shapes, or a label "
            "for each face."
        )
    try:
        given = np.asarray(groups)
    except ValueError:  # lists of different lengths
        given = np.empty(0)
    if given.dtype.kind == "O" and given.shape == (count,):
        given = given.astype(np.str_)
    if given.shape != (count,):
        raise UsageError(
            f"view_factors: groups of shape {given.shape}, but there are {count} faces: a label for each."
        )
    used_labels, labels = np.unique(given, return_inverse=True)
    return labels.astype(np.int64)[kept], tuple(map(str, used_labels.tolist()))


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Return the names, with a number appended to repeated names."""
    return tuple(
        f"{name} {names[:i].count(name) + 1}" if names.count(name) > 1 else name for i, name in enumerate(names)
    )


def _size(vertices: Float64) -> float:
    return float(np.ptp(vertices, axis=0).max()) / 2


def _checked(vertices: Float64, outlines: list[list[int]], source: str) -> Faces:
    if not outlines:
        raise SceneError(f"{source}: there are no faces; view factors are between two at least.")
    for i, outline in enumerate(outlines):
        if len(outline) < 3 or min(outline) < 0 or max(outline) >= len(vertices):
            wrong = [v for v in outline if not 0 <= v < len(vertices)]
            found = f"names vertex {short_repr(wrong[0])}" if wrong else f"has {len(outline)} corners"
            raise SceneError(
                f"{source}: faces[{i}] {found}; a face is three or more of the vertices 0 to {len(vertices) - 1}."
            )
    lengths = np.fromiter(map(len, outlines), np.int64, len(outlines))
    flat = np.fromiter(chain.from_iterable(outlines), np.int64, int(lengths.sum()))
    ends = np.cumsum(lengths)
    used = np.zeros(len(vertices), np.bool_)
    used[flat] = True
    if (bad := np.flatnonzero(used & ~np.isfinite(vertices).all(axis=1))).size:
        at = int(bad[0])
        face = next(i for i, outline in enumerate(outlines) if at in outline)
        raise SceneError(
            f"{source}: faces[{face}]: vertex {at} is {vertices[at].tolist()}; coordinates must be finite numbers.",
            f"{len(bad)} vertices of faces are not." if len(bad) > 1 else "",
        )
    # Merge vertices that are equal except for rounding, because neighbouring faces are found by common vertices.
    low, high = vertices[used].min(axis=0), vertices[used].max(axis=0)
    step = max(float((high - low).max()), np.finfo(float).tiny) * 1e-12
    keys = np.round((np.where(used[:, None], vertices, low) - low) / step).astype(np.int64)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    unique, number = vertices[first], number.ravel()
    size = _size(unique)
    merged_flat = number[flat]
    before = np.roll(merged_flat, 1)
    before[ends - lengths] = merged_flat[ends - 1]
    kept = tuple(map(tuple, _divided(merged_flat.tolist(), ends.tolist())))
    if (merged_flat == before).any():
        kept = tuple(map(_without_repeats, kept))
    counts = np.array(list(map(len, kept)))
    degenerate = np.flatnonzero(counts < 3).tolist()
    bent: list[int] = []
    for count in np.unique(counts[counts > 2]):
        which = np.flatnonzero(counts == count)
        corners = unique[np.array([kept[i] for i in which])]
        centred = corners - corners.mean(axis=1, keepdims=True)
        normals = 0.5 * np.cross(centred, np.roll(centred, -1, axis=1)).sum(axis=1)
        areas, extents = np.linalg.norm(normals, axis=1), np.abs(centred).max(axis=(1, 2))
        flawed = (areas <= 1e-9 * extents**2) | (extents <= ROUNDING * size)
        degenerate += which[flawed].tolist()
        units = normals / np.where(flawed, 1.0, areas)[:, None]
        heights = np.abs(np.einsum("nkj,nj->nk", centred, units)).max(axis=1)
        bent += which[~flawed & (heights > _FLAT * extents)].tolist()
    degenerate.sort()
    bent.sort()
    if bent:
        more = f"{len(bent)} faces are so: {_listed(bent)}. " if len(bent) > 1 else ""
        raise SceneError(
            f"{source}: faces[{bent[0]}] is not flat: a corner is more than {_FLAT:g} of its size off its plane.",
            more + "Split it in triangles.",
        )
    if len(degenerate) == len(kept):
        raise SceneError(f"{source}: faces[0] has no area, nor has any other.", "Check the coordinates.")
    if degenerate:
        warn(
            f"{source}: {len(degenerate):,} of {len(kept):,} faces have no area ({_listed(degenerate)}): as "
            "rows of their own they see nothing, and are zeros."
        )
    rows = np.delete(np.arange(len(kept)), degenerate)
    return Faces(unique, tuple(kept[i] for i in rows.tolist()), rows, len(kept), (), source)


def _listed(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers[:_LISTED])) + (" ..." if len(numbers) > _LISTED else "")


def _divided(flat: list[int], ends: list[int]) -> Iterator[list[int]]:
    return (flat[begin:end] for begin, end in pairwise((0, *ends)))


def _without_repeats(outline: Outline) -> Outline:
    return tuple(v for k, v in enumerate(outline) if v != outline[k - 1])


@dataclass(frozen=True, eq=False)
class Geometry:
    """Facets and occluders, as input for the kernels. Coordinates are relative to the centre of the bounding box.

    facets    : convex parts of the faces, in the order of the BVH
    row       : (n,) int64, matrix row of each facet
    tree      : BVH of the facets
    occluders : convex polygons that are merged from faces of all rows
    depth     : depth of the BVH
    eps       : length up to which distances are treated as rounding errors
    areas, perimeters : (rows,) float64, summed over the facets of each row
    """

    facets: Polygons
    row: Int64
    tree: Tree
    occluders: Polygons
    depth: int
    eps: float
    areas: Float64
    perimeters: Float64

    @classmethod
    def of(cls, faces: Faces) -> Geometry:
        vertices = faces.vertices - 0.5 * (faces.vertices.min(axis=0) + faces.vertices.max(axis=0))
        size = _size(vertices)
        outlines: list[Outline] = []
        rows: list[int] = []
        for row, outline in zip(faces.rows.tolist(), faces.outlines, strict=True):
            for part in convex_parts(vertices, outline, CORNERS):
                outlines.append(part)
                rows.append(row)
        if faces.names or len(outlines) > len(faces.outlines):
            found, first = merged(vertices, outlines, rows, size)
            joined = [tuple(outline) for outline in found]
            of_row = np.array(rows)[first]
        else:
            joined, of_row = outlines, np.array(rows)
        walls, _ = merged(vertices, outlines, [0] * len(outlines), size)
        # Keep one of two walls with the same vertices, because either side of a thin sheet occludes.
        walls = list({frozenset(wall): wall for wall in walls}.values())
        plain = polygons_of(vertices, joined)
        bvh = build_bvh(plain.boxes[:, :3], plain.boxes[:, 3:], leaf_size=1)
        facets = plain.select(bvh.order)
        row = of_row[bvh.order].astype(np.int64)
        areas = np.bincount(row, facets.areas, faces.row_count).astype(np.float64)
        around = np.linalg.norm(np.roll(facets.corners, -1, axis=1) - facets.corners, axis=2).sum(axis=1)
        perimeters = np.bincount(row, around, faces.row_count).astype(np.float64)
        return cls(
            facets,
            row,
            Tree.of(bvh),
            polygons_of(vertices, walls),
            bvh.depth,
            ROUNDING * size,
            areas,
            perimeters,
        )
