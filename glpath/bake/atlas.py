"""An atlas: where each side of each triangle lies on the pages of a lightmap, by xatlas or by the file's own uv.

Coordinates are texels of a page, x to the right and y downwards from the top left corner: texel (row, column) is
the square from (column, row) to (column + 1, row + 1).

Cost:     xatlas takes some 4 s for 15,000 triangles of 1800 charts, most of it for packing.
Poor at:  triangle soups, each triangle of which becomes a chart with its gutter.
Source:   xatlas (Young 2018 to 2022), https://github.com/jpcy/xatlas, which is optional: `glpath[bake]`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError, SceneError, UsageError, warn
from glpath.scene import Scene
from glpath.scene.geometry import Float64, Mesh

Int64 = NDArray[np.int64]

MAX_SIZE = 8192
#: Texels between charts: as far as bilinear look-ups of the first mipmap levels go.
PADDING = 4
# What a single look-up needs, where charts are so many that wider gutters leave them less than this of a page.
_LEAST_PADDING, _COVERED = 2, 1 / 3
#: A page that is as large as it has to be is of a power of two between these.
_LEAST_PAGE, _LARGEST_PAGE = 64, 4096
#: Share of a page that charts may fill at the most, and the least step by which they shrink until they fit.
_FILLED, _STEP, _TRIALS = 0.95, 0.985, 30
#: Areas of triangles that xatlas has charts for, and the least unit for their sake, in extents of the scene.
_LEAST_AREA, _LEAST_UNIT = 4 * float(np.finfo(np.float32).eps), 1e-4
#: After so many steps charts of so small a share of their size are tried, which are little more than their gutters.
_PATIENCE, _NEXT_TO_NONE = 2, 1e-3


@dataclass(frozen=True, eq=False)
class Atlas:
    """Sides of triangles on pages; F of them.

    triangle : (F,) number of a triangle of the scene
    side     : (F,) 0 for its front, 1 for its back
    page     : (F,) from 0
    chart    : (F,) from 0, on through all pages: what hangs together on a page
    uv       : (F, 3, 2) float64, texels, of corners in the order of the triangle's
    size     : (width, height) of every page, texels
    pages    : how many
    texels   : per scene unit, where charts are not stretched; 0 of the file's own coordinates
    """

    triangle: Int64
    side: Int64
    page: Int64
    chart: Int64
    uv: Float64
    size: tuple[int, int]
    pages: int
    texels: float

    @cached_property
    def areas(self) -> Float64:
        """(F,) of the faces on their pages, texels^2."""
        a, b = self.uv[:, 1] - self.uv[:, 0], self.uv[:, 2] - self.uv[:, 0]
        return np.asarray(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))

    def normals(self, scene: Scene) -> Float64:
        """(F, 3) unit, of the faces, out of the side that is baked."""
        return np.asarray(scene.normals[self.triangle] * (1 - 2 * self.side)[:, None])

    def corner_normals(self, scene: Scene) -> Float64:
        """(F, 3, 3) unit: the smooth normals of the corners, or the face's where one has none."""
        shapes, plain = scene.shapes, self.normals(scene)
        corners = shapes.vertex_normals[shapes.faces[self.triangle]] * (1 - 2 * self.side)[:, None, None]
        flat = ~(np.abs(corners).sum(axis=2) > 0).all(axis=1)
        corners[flat] = plain[flat, None]
        return np.asarray(corners)


def require_xatlas() -> Any:
    """The module `xatlas`. Raises GlpathError with the line to type where it is missing."""
    try:
        import xatlas
    except ImportError as error:
        raise GlpathError(
            f"xatlas cannot be imported ({error}); it cuts surfaces into the charts of a lightmap.",
            'pip install "glpath[bake]"; or keep the texture coordinates of the file: uv "keep".',
        ) from error
    return xatlas


def packed(scene: Scene, shown: NDArray[np.bool_], texels: float | None, size: int | None) -> Atlas:
    """The atlas of a scene in triangles, cut and packed by xatlas.

    shown  : (T, 2) bool: sides that get texels
    texels : per scene unit, on as many pages as that takes; None: what fits one page
    size   : of a page; None with texels: the least power of two up to 4096 that takes all, or else several of it
    """
    xatlas = require_xatlas()
    parts = _parts(scene, shown)
    if not parts:
        raise SceneError(
            f"{scene.source or scene.name}: light gets to no side of any surface, so there is nothing to bake.",
            "Give the scene a light or a sky.",
        )
    if texels is None:
        assert size is not None, "one of both"
        return _fitted(xatlas, scene, parts, size)
    if size is None:
        alone = _packed(xatlas, scene, parts, texels, None)
        longest = max(alone.size)
        size = min(max(_LEAST_PAGE, 2 ** math.ceil(math.log2(longest))), _LARGEST_PAGE)
        if longest <= size:
            return replace(alone, size=(size, size))
    atlas = _packed(xatlas, scene, parts, texels, size)
    _warn_of_large_charts(scene, atlas)
    return atlas


def _warn_of_large_charts(scene: Scene, atlas: Atlas) -> None:
    """xatlas shrinks what does not fit a page."""
    count = int(atlas.chart.max()) + 1
    wide = np.bincount(atlas.chart, scene.areas[atlas.triangle], count)
    found = np.sqrt(np.bincount(atlas.chart, atlas.areas, count) / np.maximum(wide, np.finfo(float).tiny))
    shrunken = (found < 0.75 * atlas.texels) & (found * np.sqrt(wide) > 0.25 * max(atlas.size))
    if shrunken.any():
        warn(
            f"{scene.source or scene.name}: {shrunken.sum()} of {count} charts are larger than a page of "
            f"{atlas.size[0]} x {atlas.size[1]} and have {found[shrunken].min():.3g} texels per scene unit in "
            f"place of {atlas.texels:g}: give a larger size, or fewer texels."
        )


def _parts(scene: Scene, shown: NDArray[np.bool_]) -> list[tuple[Int64, int]]:
    """Triangles and side of each mesh's that gets texels."""
    parts, first = [], 0
    for _, mesh, _ in scene.shapes.mesh_instances():
        some = np.arange(first, first + len(mesh.faces))
        first += len(mesh.faces)
        for side in range(2):
            wanted = some[shown[some, side]]
            if len(wanted):
                parts.append((wanted, side))
    return parts


def _fitted(xatlas: Any, scene: Scene, parts: list[tuple[Int64, int]], size: int) -> Atlas:
    """On one page, with as many texels a scene unit as fit."""
    area = sum(float(scene.areas[triangles].sum()) for triangles, _ in parts)
    found: Atlas | None = None
    for padding in (PADDING, _LEAST_PADDING):
        texels = math.sqrt(_FILLED * size * size / area)
        for trial in range(_TRIALS):
            atlas = _packed(xatlas, scene, parts, texels, None, padding)
            if max(atlas.size) <= size:
                found = replace(atlas, size=(size, size))
                break
            if trial == _PATIENCE:
                # Minutes of trials are in vain where gutters alone are too much.
                gutters = _packed(xatlas, scene, parts, _NEXT_TO_NONE * texels, None, padding)
                if max(gutters.size) > size:
                    break
            texels *= min(_STEP, size / max(atlas.size))
        if found is not None and found.texels**2 * area >= _COVERED * size * size:
            break
    if found is not None:
        return found
    raise UsageError(
        f"a page of {size} x {size} texels is too small: {int(atlas.chart.max()) + 1} charts with their gutters do "
        "not fit.",
        "Give a larger size; or texels per scene unit, which take as many pages as they need.",
    )


def _packed(
    xatlas: Any,
    scene: Scene,
    parts: list[tuple[Int64, int]],
    texels: float,
    size: int | None,
    padding: int = PADDING,
) -> Atlas:
    """On pages of a size; None: on one that is as large as it has to be."""
    atlas = xatlas.Atlas()
    unit = _unit(scene, parts)
    for triangles, side in parts:
        corners = scene.triangles[triangles] / unit
        points, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        faces = faces.reshape(-1, 3)
        atlas.add_mesh(points.astype(np.float32), (faces[:, ::-1] if side else faces).astype(np.uint32))
    pack = xatlas.PackOptions()
    pack.texels_per_unit, pack.padding = texels * unit, padding
    pack.resolution = 0 if size is None else size
    atlas.generate(pack_options=pack)
    made: list[tuple[Any, ...]] = []
    for i, (triangles, side) in enumerate(parts):
        _, faces, uv = atlas[i]
        page_of, chart_of = atlas.get_mesh_vertex_assignment(i)
        faces = faces.reshape(-1, 3)
        assert len(faces) == len(triangles), "xatlas keeps faces"
        corners = (uv.astype(np.float64) * [atlas.width, atlas.height])[faces]
        made.append(
            (
                triangles,
                np.full(len(triangles), side),
                page_of[faces[:, 0]].astype(np.int64),
                np.stack([np.full(len(triangles), i), chart_of[faces[:, 0]]], axis=1),
                corners[:, ::-1] if side else corners,
            )
        )
    columns = [np.concatenate(column) for column in zip(*made, strict=True)]
    on_a_page = columns[2] < int(atlas.atlas_count)  # what xatlas takes for no area has another number
    triangle, side_of, page, chart, corners = (column[on_a_page] for column in columns)
    _, number = np.unique(chart, axis=0, return_inverse=True)
    page_size = (int(atlas.width), int(atlas.height))
    return Atlas(triangle, side_of, page, number.ravel(), corners, page_size, int(atlas.atlas_count), texels)


def _unit(scene: Scene, parts: list[tuple[Int64, int]]) -> float:
    """Scene units of one of xatlas's: their extent, or less for the smallest areas, which it takes for none."""
    extent = float(np.max(np.ptp(np.stack(scene.bounds), axis=0)))
    least = min(float(scene.areas[triangles].min()) for triangles, _ in parts)
    return min(extent, max(math.sqrt(least / _LEAST_AREA), _LEAST_UNIT * extent))


def kept(scene: Scene, shown: NDArray[np.bool_], size: int) -> Atlas:
    """The atlas of the second texture coordinates that all meshes have.

    Raises SceneError where they are no unwrapping: missing, beyond 0 to 1, or twice at one place.
    """
    place = scene.source or scene.name
    for shape in scene.shapes:
        mesh = shape.geometry
        assert isinstance(mesh, Mesh)
        if mesh.uv1 is None:
            raise SceneError(
                f'{place}: the shape "{shape.name}" has no second texture coordinates (TEXCOORD_1) to keep.',
                'Leave out uv="keep": they are made.',
            )
    # One side of each triangle: the front, but where light gets to the back alone.
    side = np.where(~shown[:, 0] & shown[:, 1], 1, 0)
    triangle = np.flatnonzero(shown.any(axis=1))
    uv = scene.shapes.vertex_uv1[scene.shapes.faces[triangle]]
    outside = np.flatnonzero(((uv < -1e-6) | (uv > 1 + 1e-6)).any(axis=(1, 2)))
    if len(outside):
        name = scene.shapes[scene.triangle_shape[triangle[outside[0]]]].name
        raise SceneError(
            f'{place}: the second texture coordinates of {len(outside)} triangles, first of the shape "{name}", '
            "are not within 0 to 1, which those of a lightmap are.",
            'Leave out uv="keep": others are made.',
        )
    texels = np.clip(uv, 0.0, 1.0) * size
    texels[..., 1] = size - texels[..., 1]
    chart = _hanging_together(scene, triangle, texels)
    atlas = Atlas(triangle, side[triangle], np.zeros(len(triangle), np.int64), chart, texels, (size, size), 1, 0.0)
    _check_apart(scene, atlas, place)
    return atlas


def _hanging_together(scene: Scene, triangle: Int64, uv: Float64) -> Int64:
    """(F,): the number of the chart, of faces that share corners in space and on the page."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows = np.concatenate([scene.triangles[triangle], np.round(uv, 4)], axis=2).reshape(-1, 5)
    _, which = np.unique(rows, axis=0, return_inverse=True)
    which = which.reshape(-1, 3)
    count = int(which.max()) + 1
    ends = np.concatenate([which[:, :2], which[:, 1:]])
    graph = coo_array((np.ones(len(ends), np.int8), tuple(ends.T)), shape=(count, count))
    _, chart = np.unique(connected_components(graph, directed=False)[1][which[:, 0]], return_inverse=True)
    return np.asarray(chart, np.int64)


def _check_apart(scene: Scene, atlas: Atlas, place: str) -> None:
    """Raise SceneError where the middles of texels are in several triangles."""
    from glpath.bake.texels import covering

    twice = covering(atlas)
    if twice is None:
        return
    names = [scene.shapes[scene.triangle_shape[atlas.triangle[f]]].name for f in twice]
    raise SceneError(
        f'{place}: the second texture coordinates of the shapes "{names[0]}" and "{names[1]}" overlap, so that one '
        "texel would be two places (that is so for every mesh with several instances, too).",
        'Leave out uv="keep": others are made.',
    )
