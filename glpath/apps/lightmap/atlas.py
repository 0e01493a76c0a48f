"""Texture atlas of a lightmap: page and uv of each triangle side, made by xatlas or taken from the file.

Coordinates are texels of a page, x to the right and y downwards from the top left corner: texel (row, column) is
the square from (column, row) to (column + 1, row + 1).

Cost:     xatlas takes about 4 s for 15,000 triangles of 1800 charts, most of it for packing. Above 20,000 sides,
          charts are made once, for all instances of a mesh together, and the trials for a page only pack them.
Poor at:  triangle soups, because each triangle becomes a chart with its own gutter.
Source:   xatlas (Young 2018 to 2022), https://github.com/jpcy/xatlas, which is optional: `glpath[bake]`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.lightmap.overlaps import overlapping
from glpath.apps.lightmap.steps import corners_in_steps, points_in_steps, power_of_two, rounded
from glpath.apps.lightmap.xatlas_workers import atlas_of
from glpath.errors import GlpathError, SceneError, UsageError, argument, warn
from glpath.scene import Scene
from glpath.scene.geometry import Float64, Mesh
from glpath.scene.pieces import pieces
from glpath.system.machine import core_count
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]
#: Part of a mesh: triangle indices, their side, and its texel density relative to `texels` (see `packed`).
Part = tuple[Int64, int, float]
#: Charts of a part: corners (V, 2) in the plane, corner indices of triangles (F, 3), and indices (F,) of these
#: triangles in the part.
Charts = tuple[NDArray[np.float32], NDArray[np.uint32], Int64]

MAX_SIZE = 8192
#: Texels between charts, enough for bilinear look-ups in the first mipmap levels.
PADDING = 4
# Texels between charts that suffice for one bilinear look-up.
_MIN_PADDING = 2
# Fraction of a page. If charts with `PADDING` fill less of a page, they are packed again with `_MIN_PADDING`.
_COVERED = 1 / 3
#: Smallest page side, a power of two, if the page size is chosen automatically.
_MIN_PAGE = 64
#: Largest page side, a power of two, if the page size is chosen automatically.
LARGEST_PAGE = 4096
#: Fraction of a page that charts are assumed to fill; it determines the density of the first trial.
_FILLED = 0.95
#: Ratio of a density that fits to a density that does not, above which trials end.
_STEP = 0.985
#: Minimum edge length of a packing, as a fraction of the page's, that ends the trials in a scene of many triangle
#: sides.
_LARGE_STEP = 0.95
#: Maximum number of trials for each padding.
_TRIALS = 30
#: Safety margin of the next trial, as a fraction of the gap between densities that fit and that do not.
_SHY = 0.05
#: Number of triangle sides in a scene above which charts are made once, and large parts are cut into patches.
_MANY = 20_000
#: Number of triangles above which a part is cut into patches in a scene with more than `_MANY` sides.
_WHOLE = 1024
#: Maximum number of triangles of a patch. The time for charts grows with the square of a part's size (0.5 ms per
#: triangle of 8,000, 0.05 ms per triangle of 250).
_PATCH = 250
#: Charts that are made once have at most this multiple of the density of the later packing.
_FINER = 2.0
#: Side in texels of a page that limits `_FINER`. The multiple is reduced, but not below 1, until charts fill at
#: most half of the page.
_CHART_PAGE = 4096
#: Measured core seconds for each triangle side over all trials, in scenes with few sides.
_SECONDS_EACH = 4e-4
#: Measured core seconds for each triangle side if charts are made once.
_SECONDS_LATER = 1.5e-4
#: Measured core seconds for each piece of a mesh that xatlas gets.
_SECONDS_PIECE = 2e-3
#: Maximum estimated core seconds of an atlas.
_MAX_SECONDS = 600.0
#: Estimated core seconds above which the estimate is reported.
_REPORTED_SECONDS = 10.0
#: Smallest triangle area for which xatlas makes charts, in square units of xatlas (see `_unit`).
_MIN_AREA = 4 * float(np.finfo(np.float32).eps)
#: Smallest unit of xatlas, as a fraction of the scene's extent.
_MIN_UNIT = 1e-4
#: Index of the trial after which, if no trial has fitted the page, the gutters alone are tested.
_PATIENCE = 2
#: Factor on the texel density in that test. It shrinks charts so far that only their gutters take space.
_NEXT_TO_NONE = 1e-3
_PACKING = "making the atlas"  # work named in errors of the time limit


class PageTooSmallError(UsageError):
    """Error if the charts of a scene do not fit one page."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """F triangle sides ("faces") with their pages and texture coordinates.

    triangle : (F,) index of the triangle in the scene
    side     : (F,) 0 for its front, 1 for its back
    page     : (F,) page index
    chart    : (F,) chart index, counted through all pages
    uv       : (F, 3, 2) float64, texels, in the order of the triangle's corners
    size     : (width, height) of each page, texels
    pages    : number of pages
    texels   : texels per scene unit in charts without stretch; 0 if the coordinates are the file's
    """

    triangle: Int64
    side: Int64
    page: Int64
    chart: Int64
    uv: Float64
    size: tuple[int, int]
    pages: int
    texels: float

    @property
    def of_file(self) -> bool:
        """True if the coordinates are the file's own. The atlas then has only one side of each triangle."""
        return self.texels == 0

    @cached_property
    def areas(self) -> Float64:
        """Area of each face on its page, (F,), texels^2."""
        a, b = self.uv[:, 1] - self.uv[:, 0], self.uv[:, 2] - self.uv[:, 0]
        return np.asarray(0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))

    def normals(self, scene: Scene) -> Float64:
        """Return (F, 3) unit normals of the faces, pointing out of the baked side."""
        return np.asarray(scene.normals[self.triangle] * (1 - 2 * self.side)[:, None])

    def corner_normals(self, scene: Scene) -> Float64:
        """Return (F, 3, 3) unit corner normals: smooth vertex normals, or the face normal if there are none."""
        shapes, plain = scene.shapes, self.normals(scene)
        corners = shapes.vertex_normals[shapes.faces[self.triangle]] * (1 - 2 * self.side)[:, None, None]
        flat = ~(np.abs(corners).sum(axis=2) > 0).all(axis=1)
        corners[flat] = plain[flat, None]
        return np.asarray(corners)


def require_xatlas() -> Any:
    """Return the module `xatlas`. Raises GlpathError with the install command if it is missing."""
    try:
        import xatlas
    except ImportError as error:
        raise GlpathError(
            f"xatlas cannot be imported ({error}); it cuts surfaces into the charts of a lightmap.",
            'pip install "glpath[bake]"; where there is no wheel of it, pip install xatlas builds it with a C++ '
            'compiler. Or keep the texture coordinates of the file: uv "keep".',
        ) from error
    return xatlas


def packed(
    scene: Scene,
    density: Float64,
    texels: float | None,
    size: int | None,
    say: Callable[[str], None] | None = None,
) -> Atlas:
    """Return the atlas of a triangulated scene, cut and packed by xatlas.

    density : (T, 2) density of each side relative to `texels`; 0 for sides without texels
    texels  : texels per scene unit, on as many pages as needed; None: the largest density that fits one page
    size    : side of a page; None with `texels`: the smallest power of two up to 4096 that holds all charts, or
              several such pages
    say     : called with an estimate of the time if the work takes more than some seconds

    A triangle that is too small for xatlas is mapped to a point of its neighbour.
    """
    xatlas = require_xatlas()
    parts = _parts(scene, density)
    _check_time(scene, parts, size, texels, say)
    if texels is None:
        assert size is not None, "one of both"
        return _with_splinters(scene, _fitted(xatlas, scene, parts, size), density)
    charts = _charts(xatlas, scene, parts, texels)
    if size is None:
        alone = _packed(xatlas, scene, parts, charts, texels, None)
        longest = max(alone.size)
        size = min(max(_MIN_PAGE, 2 ** math.ceil(math.log2(longest))), LARGEST_PAGE)
        if longest <= size:
            return _with_splinters(scene, replace(alone, size=(size, size)), density)
    atlas = _packed(xatlas, scene, parts, charts, texels, size)
    _warn_of_large_charts(scene, atlas, density)
    return _with_splinters(scene, atlas, density)


def _check_time(
    scene: Scene, parts: list[Part], size: int | None, texels: float | None, say: Callable[[str], None] | None
) -> None:
    """Raise UsageError or TimeLimitError, before the work begins, if charts cannot fit a page or take too long."""
    triangles = sum(len(part) for part, _, _ in parts)
    scene_name = scene.source or scene.name
    if texels is None and size is not None and len(parts) * (1 + _MIN_PADDING) ** 2 > size * size:
        raise PageTooSmallError(
            f"a page of {size} x {size} texels is too small: {scene_name} has {len(parts):,} meshes and "
            "instances, each of which is a chart at least.",
            "Give a larger size; or texels instead of it, which takes as many pages as it needs.",
        )
    each = _SECONDS_EACH if triangles <= _MANY else _SECONDS_LATER
    seconds = each * triangles + _SECONDS_PIECE * len(parts)
    if seconds > _MAX_SECONDS:
        raise UsageError(
            f"{scene_name}: the atlas of {triangles:,} sides of triangles in {len(parts):,} pieces would take "
            f"about {seconds / 60:.0f} minutes of processor time.",
            "Simplify the model, or bake a part of it; or keep texture coordinates that the file has: "
            f"{argument('uv', 'keep')}.",
        )
    check_time(_PACKING, seconds / core_count())
    if say is not None and seconds > _REPORTED_SECONDS:
        say(
            f"atlas of {triangles:,} sides of triangles in {len(parts):,} pieces: about {seconds:.0f} s of "
            "processor time, then the render"
        )


def _with_splinters(scene: Scene, atlas: Atlas, density: Float64) -> Atlas:
    """Return the atlas with the sides that are too small for xatlas, each at a point of the nearest face."""
    from scipy.spatial import cKDTree

    lacks = density > 0
    lacks[atlas.triangle, atlas.side] = False
    triangle, side = np.nonzero(lacks)
    if not len(triangle):
        return atlas
    nearest = np.zeros(len(triangle), np.int64)
    for number in range(2):
        faces = np.flatnonzero(atlas.side == number)
        faces = faces if len(faces) else np.arange(len(atlas.triangle))
        wanted = side == number
        if wanted.any():
            middles = scene.triangles[atlas.triangle[faces]].mean(axis=1)
            nearest[wanted] = faces[cKDTree(middles).query(scene.triangles[triangle[wanted]].mean(axis=1))[1]]
    points = np.repeat(atlas.uv[nearest].mean(axis=1, keepdims=True), 3, axis=1)
    return replace(
        atlas,
        triangle=np.concatenate([atlas.triangle, triangle]),
        side=np.concatenate([atlas.side, side]),
        page=np.concatenate([atlas.page, atlas.page[nearest]]),
        chart=np.concatenate([atlas.chart, atlas.chart[nearest]]),
        uv=np.concatenate([atlas.uv, points]),
    )


def _warn_of_large_charts(scene: Scene, atlas: Atlas, density: Float64) -> None:
    """Warn of charts that xatlas has shrunk because they are larger than a page."""
    count = int(atlas.chart.max()) + 1
    of_face = density[atlas.triangle, atlas.side]
    wide = np.bincount(atlas.chart, of_face**2 * scene.areas[atlas.triangle], count)
    found = np.sqrt(np.bincount(atlas.chart, atlas.areas, count) / np.maximum(wide, np.finfo(float).tiny))
    shrunken = (found < 0.75 * atlas.texels) & (found * np.sqrt(wide) > 0.25 * max(atlas.size))
    if shrunken.any():
        warn(
            f"{scene.source or scene.name}: {shrunken.sum()} of {count} charts are larger than a page of "
            f"{atlas.size[0]} x {atlas.size[1]} and have {found[shrunken].min():.3g} texels per scene unit "
            f"instead of {atlas.texels:g}: give a larger size, or fewer texels."
        )


def _parts(scene: Scene, density: Float64) -> list[Part]:
    """Return the parts of all mesh instances. The triangles of a part have the same side and density."""
    parts: list[Part] = []
    first = 0
    densities = np.unique(density[density > 0])
    many = np.count_nonzero(density) > _MANY
    for _, mesh, _ in scene.shapes.mesh_instances():
        count = len(mesh.faces)
        for side in range(2):
            for wanted in densities:
                check_time(_PACKING)
                those = np.flatnonzero(density[first : first + count, side] == wanted)
                if many and len(those) > _WHOLE:
                    # In object space, so that all instances of a mesh are cut alike.
                    patches = _patches(points_in_steps(mesh.vertices[mesh.faces].mean(axis=1)), those)
                else:
                    patches = [those] if len(those) else []
                parts += [(first + patch, side, float(wanted)) for patch in patches]
        first += count
    return parts


def _patches(middles: Float64, triangles: Int64) -> list[Int64]:
    """Split triangles recursively in halves along the longest axis of their centroids, until patches are small.

    middles : (T, 3) centroids in integer steps; ties keep the order of the triangles
    """
    check_time(_PACKING)
    if len(triangles) <= _PATCH:
        return [np.sort(triangles)]
    points = middles[triangles]
    axis = int(np.argmax(np.ptp(points, axis=0)))
    half = len(triangles) // 2
    order = np.argpartition(points[:, axis] * len(middles) + triangles, half)
    return [*_patches(middles, triangles[order[:half]]), *_patches(middles, triangles[order[half:]])]


def _fitted(xatlas: Any, scene: Scene, parts: list[Part], size: int) -> Atlas:
    """Return an atlas of one page with the largest texel density that fits."""
    areas = scene.areas  # read once, because the property computes the areas at each access
    area = sum(density**2 * float(areas[triangles].sum()) for triangles, _, density in parts)
    guess = rounded(math.sqrt(_FILLED * size * size / area))
    charts = _charts(xatlas, scene, parts, guess)
    found: Atlas | None = None
    for padding in (PADDING, _MIN_PADDING):
        texels, fits, over = guess, (0.0, 0.0), (math.inf, math.inf)
        best: Atlas | None = None
        for trial in range(_TRIALS):
            check_time(_PACKING)
            atlas = _packed(xatlas, scene, parts, charts, texels, None, padding)
            longest = max(atlas.size)
            if longest <= size:
                best, fits = replace(atlas, size=(size, size)), (texels, longest)
            else:
                over = texels, longest
            if charts is not None and best is not None and fits[1] >= _LARGE_STEP * size:
                break  # the packing nearly fills the page, and a further trial costs seconds
            if over[0] <= fits[0] / _STEP or (best is not None and not math.isfinite(over[0])):
                break
            if trial == _PATIENCE and best is None:
                # Minutes of trials would be in vain if gutters alone exceed the page.
                smallest = _NEXT_TO_NONE * texels
                fits = smallest, max(_packed(xatlas, scene, parts, charts, smallest, None, padding).size)
                if fits[1] > size:
                    break
            texels = _between(fits, over, size)
        found = found if best is None else best
        if found is not None and found.texels**2 * area >= _COVERED * size * size:
            break
    if found is not None:
        return found
    raise PageTooSmallError(
        f"a page of {size} x {size} texels is too small: {int(atlas.chart.max()) + 1} charts with their gutters do "
        "not fit.",
        "Give a larger size; or texels per scene unit, which take as many pages as they need.",
    )


def _between(fits: tuple[float, float], over: tuple[float, float], size: int) -> float:
    """Return the next texel density to try, interpolated between one that fits the page and one that does not.

    fits, over : (density, page side) that fits, and that does not
    size       : page side that is available

    Charts grow with the density and gutters do not, so the page side grows more slowly than the density.
    """
    if fits[1] == 0:
        return over[0] * min(_STEP, size / over[1])
    share = (size - fits[1]) / (over[1] - fits[1])
    # Packing is irregular, so a value slightly below the estimate makes both ends of the interval approach each
    # other.
    return fits[0] + (over[0] - fits[0]) * min(max(share - _SHY, 0.1), 0.9)


def _charts(xatlas: Any, scene: Scene, parts: list[Part], texels: float) -> list[Charts] | None:
    """Return each part's charts in units of `_unit`; None if each packing makes the charts anew.

    A packing makes them anew if the parts have few triangle sides in all.

    texels : approximate texels per scene unit of the later packing; xatlas stretches charts to whole texels

    Parts that differ only by a similarity transform share their charts.
    """
    if sum(len(triangles) for triangles, _, _ in parts) <= _MANY:
        return None
    unit = _unit(scene, parts)
    alike, scales = _alike(scene, parts)
    _, first, kind = np.unique(alike, return_index=True, return_inverse=True)
    models = [parts[i] for i in first]
    areas = scene.areas  # read once, because the property computes the areas at each access
    area = sum(of**2 * float(areas[triangles].sum()) for triangles, _, of in models)
    finer = min(max(rounded(_CHART_PAGE / (texels * math.sqrt(2 * area))), 1.0), _FINER)
    with atlas_of(xatlas) as atlas:
        for part in models:
            check_time(_PACKING)
            atlas.add_mesh(*_corners(scene, part, unit))
        pack = xatlas.PackOptions()
        pack.texels_per_unit, pack.padding, pack.resolution = finer * texels * unit, _MIN_PADDING, 0
        atlas.generate(pack_options=pack)
        made: list[Charts] = []
        for i in range(len(models)):
            _, faces, uv = atlas[i]
            faces = faces.reshape(-1, 3)
            on_a_page = atlas.get_mesh_vertex_assignment(i)[0][faces[:, 0]] < int(atlas.atlas_count)
            corners = uv * (np.array([atlas.width, atlas.height]) / pack.texels_per_unit)
            made.append((corners.astype(np.float32), faces[on_a_page].astype(np.uint32), np.flatnonzero(on_a_page)))
    return [
        (corners * np.float32(scales[i] / scales[first[k]]), faces, which)
        for i, k in enumerate(kind)
        for corners, faces, which in [made[k]]
    ]


def _alike(scene: Scene, parts: list[Part]) -> tuple[Int64, Float64]:
    """Return (P,) group index and (P,) scale of each part. Parts of a group differ only by a similarity."""
    kinds: dict[tuple[object, ...], int] = {}
    alike, scales = np.zeros(len(parts), np.int64), np.zeros(len(parts))
    instances = list(scene.shapes.mesh_instances())
    start = np.cumsum([0, *(len(mesh.faces) for _, mesh, _ in instances)])
    for i, (triangles, side, density) in enumerate(parts):
        check_time(_PACKING)
        number = int(np.searchsorted(start, triangles[0], side="right")) - 1
        _, mesh, world_from_mesh = instances[number]
        gram = world_from_mesh[:, :3].T @ world_from_mesh[:, :3]
        scale = math.sqrt(float(np.trace(gram)))
        shape = np.round(gram / max(scale * scale, np.finfo(float).tiny), 5) + 0.0
        key = (id(mesh), side, (triangles - start[number]).tobytes(), shape.tobytes())
        alike[i], scales[i] = kinds.setdefault(key, len(kinds)), scale * density
    return alike, scales


def _corners(scene: Scene, part: Part, unit: float) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return points (V, 3) of a part and corner indices of its triangles (F, 3), for xatlas."""
    triangles, side, density = part
    steps, step = corners_in_steps(scene.triangles[triangles])
    points, faces = np.unique(steps.reshape(-1, 3), axis=0, return_inverse=True)
    points, faces = points * (step * density / unit), faces.reshape(-1, 3)
    return points.astype(np.float32), (faces[:, ::-1] if side else faces).astype(np.uint32)


def _packed(
    xatlas: Any,
    scene: Scene,
    parts: list[Part],
    charts: list[Charts] | None,
    texels: float,
    size: int | None,
    padding: int = PADDING,
) -> Atlas:
    """Return the packed atlas on pages of `size`; None: one page, as large as needed.

    charts : charts of each part, from `_charts`
    """
    unit = _unit(scene, parts)
    with atlas_of(xatlas) as atlas:
        for i, part in enumerate(parts):
            check_time(_PACKING)
            if charts is None:
                atlas.add_mesh(*_corners(scene, part, unit))
            else:
                atlas.add_uv_mesh(*charts[i][:2])
        pack = xatlas.PackOptions()
        pack.texels_per_unit, pack.padding = texels * unit, padding
        pack.resolution = 0 if size is None else size
        atlas.generate(pack_options=pack)
        made: list[tuple[Any, ...]] = []
        for i, (of_part, side, _) in enumerate(parts):
            triangles = of_part if charts is None else of_part[charts[i][2]]
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
        page_size, pages = (int(atlas.width), int(atlas.height)), int(atlas.atlas_count)
    columns = [np.concatenate(column) for column in zip(*made, strict=True)]
    on_a_page = columns[2] < pages  # xatlas gives faces that it finds degenerate an index beyond the last page
    triangle, side_of, page, chart, corners = (column[on_a_page] for column in columns)
    _, number = np.unique(chart, axis=0, return_inverse=True)
    return Atlas(triangle, side_of, page, number.ravel(), corners, page_size, pages, texels)


def _unit(scene: Scene, parts: list[Part]) -> float:
    """Return the length by which coordinates are divided for xatlas, a power of two.

    It is about the scene's extent, or smaller if xatlas would otherwise take the smallest triangles for lines.
    """
    extent = float(np.max(np.ptp(np.stack(scene.bounds), axis=0)))
    areas = scene.areas  # read once, because the property computes the areas at each access
    smallest = min(density**2 * float(areas[triangles].min()) for triangles, _, density in parts)
    return power_of_two(min(extent, max(math.sqrt(smallest / _MIN_AREA), _MIN_UNIT * extent)))


def kept(scene: Scene, lit: NDArray[np.bool_], size: int) -> Atlas:
    """Return the atlas of the meshes' second texture coordinates, with one side of each triangle.

    lit : (T, 2) bool, lit sides; the front is used unless only the back is lit

    Raises SceneError if the coordinates are missing, outside of 0 to 1, or overlap.
    """
    scene_name = scene.source or scene.name
    for shape in scene.shapes:
        mesh = shape.geometry
        assert isinstance(mesh, Mesh)
        if mesh.uv1 is None:
            raise SceneError(
                f'{scene_name}: the shape "{shape.name}" has no second texture coordinates (TEXCOORD_1) to keep.',
                f"Leave out {argument('uv', 'keep')}: they are made.",
            )
    side = np.where(~lit[:, 0] & lit[:, 1], 1, 0)
    triangle = np.arange(len(lit))
    uv = scene.shapes.vertex_uv1[scene.shapes.faces[triangle]]
    outside = np.flatnonzero(((uv < -1e-6) | (uv > 1 + 1e-6)).any(axis=(1, 2)))
    if len(outside):
        name = scene.shapes[scene.triangle_shape[triangle[outside[0]]]].name
        raise SceneError(
            f"{scene_name}: the second texture coordinates of {len(outside)} triangles, first of the shape "
            f'"{name}", are not within 0 to 1, which those of a lightmap are.',
            f"Leave out {argument('uv', 'keep')}: others are made.",
        )
    texels = np.clip(uv, 0.0, 1.0) * size
    texels[..., 1] = size - texels[..., 1]
    # Faces belong to one chart if they are connected by corners that are equal in space and on the page.
    corners = np.concatenate([scene.triangles[triangle], np.round(texels, 4)], axis=2)
    chart = np.unique(pieces(corners), return_inverse=True)[1].astype(np.int64)
    atlas = Atlas(triangle, side, np.zeros(len(triangle), np.int64), chart, texels, (size, size), 1, 0.0)
    _check_apart(scene, atlas, scene_name)
    return atlas


def _check_apart(scene: Scene, atlas: Atlas, scene_name: str) -> None:
    """Raise SceneError if the centre of a texel lies in several triangles."""
    twice = overlapping(atlas.uv, atlas.size)
    if twice is None:
        return
    names = [scene.shapes[scene.triangle_shape[atlas.triangle[f]]].name for f in twice]
    raise SceneError(
        f'{scene_name}: the second texture coordinates of the shapes "{names[0]}" and "{names[1]}" overlap, so '
        "that one texel would be two points (that is so for every mesh with several instances, too).",
        f"Leave out {argument('uv', 'keep')}: others are made.",
    )
