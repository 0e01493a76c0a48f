"""Triangulation of polygons: faces of mesh files, and planar polygons with holes.

Faces of a mesh keep their corners: triangles stay, quads are split along a diagonal, and a polygon becomes a fan
around its first corner if the fan covers it once. Other polygons are split by ear clipping [mapbox_earcut].

A polygon with holes is cut into horizontal bands at the height of each corner, and each band into trapezoids
between edges. Holes may therefore touch the boundary and each other. Ear clipping does not allow this, because it
joins rings by bridges. The number of trapezoids may be quadratic in the number of corners, so ear clipping is used
for ragged outlines of thousands of corners.

Poor at: edges shared with other polygons, because the cuts add corners that the other polygons lack; corners of
nearly the same height, which give thin triangles.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import warn_at
from glpath.io.values import warn_of_left_out
from glpath.scene.geometry import Float64, Int32
from glpath.scene.source_location import SourceLocation
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]

# A polygon with holes is cut into bands at the y coordinates of its corners. Corners whose y coordinates differ by
# at most this fraction of the polygon's extent share one cut.
_LEVEL = 1e-9
# Area below which a triangle counts as having none, as a fraction of the polygon's area.
_NO_AREA = 1e-9
# Maximum area that ear clipping may miss, as a fraction of the polygon's area. Above it the outline counts as
# crossing itself.
_LEFT_OUT = 1e-3
# Maximum number of corners of a polygon whose edges are tested for crossing each other.
_MAX_COMPARED = 1 << 8
# Maximum sum of squared numbers of corners of the polygons of a mesh that are tested so. They take a second.
_MAX_COMPARISONS = 1 << 25
# Maximum number of times that edges of a polygon with holes cross bands; above it ear clipping is used.
_MAX_CROSSED = 40_000
# Maximum number of corners for ear clipping. Its time is quadratic at worst, and half a second for this many.
_MAX_EAR_CORNERS = 1 << 14
# Number of corners up to which ear clipping is fast. A larger polygon costs its squared number of corners, and
# _CROSSING times that if it crosses itself. Maximum cost of all polygons, which takes 3 seconds; and of one step.
_FAST_EAR_CORNERS, _CROSSING, _MAX_EAR_COST, _STEP_COST = 80, 16, 1 << 33, 1 << 29
# Cost of each cut through a larger polygon with holes, and of each of its edges at each cut.
_CUT_COST, _EDGE_COST = 100_000, 7


# Cost so far of the slow polygons of a scene, as a list of one number; None outside `limited_polygons`.
_cost: ContextVar[list[int] | None] = ContextVar("cost", default=None)


def _add_cost(cost: int, what: str) -> None:
    """Add to the cost of a scene's polygons. Raises ValueError, with the text `what`, if it becomes too large."""
    total = _cost.get() or [0]
    total[0] += cost
    if total[0] > _MAX_EAR_COST:
        raise ValueError(f"with those before them, {what} take too long to split, so save them as triangles")


@contextmanager
def limited_polygons() -> Iterator[None]:
    """Context in which the limit of time of a mesh's polygons holds for the polygons of all meshes together."""
    token = _cost.set(_cost.get() or [0])
    try:
        yield
    finally:
        _cost.reset(token)


@dataclass(frozen=True)
class Split:
    """Triangles of polygons, in the order of the polygons.

    triangles : (T, 3) indices into the concatenated corners of all polygons
    polygons  : (T,) index of the polygon of each triangle
    crossing  : number of polygons whose outline crosses itself, so that triangles overlap or leave gaps
    """

    triangles: Int64
    polygons: Int64
    crossing: int = 0


def split_faces(positions: Float64, faces: Sequence[Sequence[int]]) -> tuple[Int32, int]:
    """Return triangles (T, 3) of faces, as indices of positions (V, 3), and the number of self-crossing faces."""
    corners = np.fromiter(chain.from_iterable(faces), np.int32)
    split = split_polygons(positions, corners, np.array([len(face) for face in faces]))
    return corners[split.triangles], split.crossing


@np.errstate(over="ignore", invalid="ignore")  # positions that are too large are reported later
@limited_polygons()
def split_polygons(positions: Float64, corners: NDArray[Any], sizes: NDArray[Any]) -> Split:
    """Return triangles that cover each polygon once, including concave polygons.

    positions : (V, 3)
    corners   : (sum of sizes,) indices of positions, in order around each polygon
    sizes     : (P,) number of corners of each polygon; those with fewer than three have no triangles

    A quad is split from its first corner to its third, unless only the other diagonal lies within it.

    Raises ValueError for polygons that are no fans and have too many corners for ear clipping, one or all together.
    """
    sizes = np.asarray(sizes, np.int64)
    if (sizes == 3).all():
        return Split(np.arange(3 * len(sizes)).reshape(-1, 3), np.arange(len(sizes)))
    first = np.cumsum(sizes) - sizes
    triangles, polygons, crossing = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)], 0
    comparisons = _MAX_COMPARISONS
    for size in np.unique(sizes[sizes >= 3]).tolist():
        check_time()
        chosen = np.flatnonzero(sizes == size)
        starts = first[chosen]
        if size == 3:
            local = np.broadcast_to(np.arange(3), (len(chosen), 1, 3))
        elif size == 4:
            local, quads_crossing = _split_quads(*(positions[corners[starts + i]] for i in range(4)))
            crossing += quads_crossing
        else:
            ahead = np.arange(1, size - 1)
            fan = np.stack([np.zeros_like(ahead), ahead, ahead + 1], axis=1)
            local = np.broadcast_to(fan, (len(chosen), size - 2, 3))
            rings = positions[corners[starts[:, None] + np.arange(size)]]
            are_fans, fans_cross = _are_fans(rings)
            crossing += int(np.count_nonzero(fans_cross))
            others = np.flatnonzero(~are_fans)
            step = max(1, _STEP_COST // size**2)
            for part in (others[at : at + step] for at in range(0, len(others), step)):
                check_time()
                ears, of, ears_cross = _ears_of_rings(rings[part], comparisons // size**2)
                comparisons = max(0, comparisons - len(part) * size**2)
                number_crossing = int(np.count_nonzero(ears_cross))
                crossing += number_crossing
                if size > _FAST_EAR_CORNERS:
                    cost = size**2 * (len(part) + (_CROSSING - 1) * number_crossing)
                    _add_cost(cost, f"polygons of up to {size:,} corners, above all those that cross themselves,")
                triangles.append(starts[part][of, None] + ears)
                polygons.append(chosen[part][of])
            local, starts, chosen = (np.delete(each, others, axis=0) for each in (local, starts, chosen))
        triangles.append((local + starts[:, None, None]).reshape(-1, 3))
        polygons.append(np.repeat(chosen, local.shape[1]))
    joined, of = np.concatenate(triangles), np.concatenate(polygons)
    if len(polygons) == 2:
        return Split(joined, of, crossing)
    order = np.argsort(of, kind="stable")
    return Split(joined[order], of[order], crossing)


def split_finite(
    source: str,
    positions: Float64,
    corners: NDArray[Any],
    sizes: NDArray[Any],
    others: Mapping[str, int] | None = None,
) -> Split:
    """Return the triangles of a file's polygons, without polygons that have a vertex that is not finite.

    Warns of parts that are left out, and of outlines that cross themselves.

    source : name of the file
    others : counts of other parts that are left out, by name, for the same warning
    """
    check_time()
    is_bad = ~np.asarray(np.isfinite(positions).all(axis=1))
    of = np.repeat(np.arange(len(sizes)), sizes)
    bad_faces = np.bincount(of, is_bad[corners], len(sizes)) > 0 if is_bad.any() else np.zeros(len(sizes), np.bool_)
    too_few = np.asarray(sizes) < 3
    warn_of_left_out(
        source,
        {
            "vertices that are not finite": int(is_bad.sum()),
            "faces with such a vertex": int(bad_faces.sum()),
            "faces of fewer than three corners": int(too_few.sum()),
            **(others or {}),
        },
    )
    dropped = bad_faces | too_few
    if not dropped.any():
        split = split_polygons(positions, corners, sizes)
    else:
        kept, whole = np.flatnonzero(~dropped[of]), np.flatnonzero(~dropped)
        split = split_polygons(positions, corners[kept], sizes[whole])
        split = Split(kept[split.triangles], whole[split.polygons], split.crossing)
    warn_of_crossing(source, split.crossing)
    return split


@contextmanager
def polygon_errors_at(location: SourceLocation) -> Iterator[None]:
    """Context that converts ValueErrors about polygons to SceneErrors at `location`."""
    try:
        yield
    except ValueError as error:
        raise location.error(f"cannot be used: {error}.", "Split the polygon.") from error


def warn_of_crossing(source: str, count: int) -> None:
    """Warn of polygons of a file that cross themselves, if there are any."""
    if count:
        cause = "outlines of faces that cross themselves"
        warn_at(source, {cause: count}, f"{source}: {cause}: {count:,}. Their triangles overlap or leave gaps.")


def _split_quads(a: Float64, b: Float64, c: Float64, d: Float64) -> tuple[Int64, int]:
    """Return (N, 2, 3) corners, 0 to 3, of the triangles of quads, and the number of self-crossing quads.

    a, b, c, d : (N, 3) corners of the quads, in order
    """
    ac, bd, ab, ad = c - a, d - b, b - a, d - a
    normal = _cross(ac, bd)
    size = _dot(normal, normal)
    # Normals of the two triangles beside diagonal ac; each normal's length is twice its triangle's area. A diagonal
    # is inside the quad if the dot products of both normals with the quad's normal are positive.
    halves = np.stack([_cross(ab, ac), _cross(ac, ad)], axis=1)
    beside_ac = _dot(normal[:, None], halves).min(axis=1)
    beside_bd = np.minimum(_dot(normal, _cross(ab, ad)), _dot(normal, _cross(c - b, bd)))
    other = (beside_ac <= _NO_AREA * size) & (beside_bd > _NO_AREA * size)
    crossed = (beside_ac < -_NO_AREA * size) & ~other | _areas_cancel(halves, np.stack([ab, ac, ad], axis=1))
    local = np.empty((len(a), 2, 3), np.int64)
    local[:] = [[0, 1, 2], [0, 2, 3]]
    local[other] = [[0, 1, 3], [1, 2, 3]]
    return local, int(np.count_nonzero(crossed))


def _areas_cancel(doubled: Float64, spokes: Float64) -> NDArray[np.bool_]:
    """Return (N,) bool: True if the signed areas of an outline cancel, so that it crosses itself.

    doubled : (N, k, 3) twice the areas of the triangles of a fan, along their normals
    spokes  : (N, j, 3) vectors from the first corner to the others
    """
    whole, parts = np.linalg.norm(doubled.sum(axis=1), axis=1), np.linalg.norm(doubled, axis=2).sum(axis=1)
    return np.asarray((whole <= _NO_AREA * parts) & ~_are_lines(doubled, spokes))


def _are_lines(doubled: Float64, spokes: Float64) -> NDArray[np.bool_]:
    """Return (N,) bool: True if the corners of an outline lie on a line. Arguments are those of `_areas_cancel`."""
    return np.asarray(np.linalg.norm(doubled, axis=2).sum(axis=1) <= _NO_AREA * _dot(spokes, spokes).sum(axis=1))


def _are_fans(rings: Float64) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return two (N,) bool for rings (N, k, 3): True if the fan is kept, and True if the ring crosses itself.

    The fan around the first corner is kept if it covers the ring once, or if the ring has no area.
    """
    spokes = rings[:, 1:] - rings[:, :1]
    doubled = _cross(spokes[:, :-1], spokes[:, 1:])
    normal = doubled.sum(axis=1)
    size = _dot(normal, normal)
    ahead = (_dot(doubled, normal[:, None]) > _NO_AREA * size[:, None]).all(axis=1)
    cosines = _dot(spokes[:, :-1], spokes[:, 1:])
    # Angles at the first corner; their sum is below a full turn for a ring that does not cross itself.
    angles = np.arctan2(np.linalg.norm(doubled, axis=2), cosines).sum(axis=1)
    crossed = _areas_cancel(doubled, spokes)
    has_no_area = _are_lines(doubled, spokes) | ~(size > 0) | ~np.isfinite(size)
    return np.asarray(ahead & (angles < 2 * np.pi) | crossed | has_no_area), crossed


def _ears_of_rings(rings: Float64, compared: int) -> tuple[Int64, Int64, NDArray[np.bool_]]:
    """Clip ears of rings (N, k, 3). Return corners (T, 3), ring (T,), and (N,) True if a ring crosses itself.

    compared : maximum number of rings whose edges are tested for crossing each other, too
    """
    spokes = rings[:, 1:] - rings[:, :1]
    normals = _cross(spokes[:, :-1], spokes[:, 1:]).sum(axis=1)
    # Project along the coordinate axis nearest to the normal, with the front towards the viewer.
    axes = np.argmax(np.abs(normals), axis=1)
    is_front = np.take_along_axis(normals, axes[:, None], axis=1) > 0
    x, y = (axes[:, None] + 1) % 3, (axes[:, None] + 2) % 3
    columns = np.where(is_front, np.hstack([x, y]), np.hstack([y, x]))
    plane = np.take_along_axis(rings - rings[:, :1], columns[:, None], axis=2)
    faces = _ears_of_each(plane, [rings.shape[1]])
    of = np.repeat(np.arange(len(rings)), [len(each) for each in faces])
    corners = np.concatenate(faces)
    covered = np.bincount(of, _doubled_areas(plane[of[:, None], corners]), len(rings))
    areas = np.abs(normals).max(axis=1)
    crossed = np.abs(areas - covered) > _LEFT_OUT * areas
    return corners, of, crossed | _edges_cross(plane, compared)


def _edges_cross(outlines: Float64, compared: int) -> NDArray[np.bool_]:
    """Return (N,) bool: True if two edges of an outline (N, k, 2) cross, instead of only touching.

    Outlines beyond the first `compared` and those of more than _MAX_COMPARED corners count as not crossing.
    """
    count, size = outlines.shape[:2]
    cross = np.zeros(count, np.bool_)
    last = min(count, compared) if size <= _MAX_COMPARED else 0
    step = max(1, _MAX_COMPARED**2 // size**2)
    for at in range(0, last, step):
        stop = min(at + step, last)
        cross[at:stop] = _edges_cross_of(outlines[at:stop])
    return cross


def _edges_cross_of(outlines: Float64) -> NDArray[np.bool_]:
    ahead = np.roll(outlines, -1, axis=1) - outlines
    to_others = outlines[:, None] - outlines[:, :, None]
    # Side of edge i on which corner j lies: a sign, or 0 if it is on the line of the edge.
    sides = ahead[:, :, None, 0] * to_others[..., 1] - ahead[:, :, None, 1] * to_others[..., 0]
    on_line = _NO_AREA * np.ptp(outlines, axis=1).max(axis=1) ** 2
    sides = np.where(np.abs(sides) > on_line[:, None, None], np.sign(sides), 0.0)
    is_between = sides * np.roll(sides, -1, axis=2) < 0
    return np.asarray((is_between & is_between.swapaxes(1, 2)).any(axis=(1, 2)))


def _ears_of_each(outlines: Float64, sizes: Sequence[int]) -> list[Int64]:
    """Return the triangles of each outline as (F, 3) corner indices, by ear clipping.

    outlines : (N, k, 2) points: a counter-clockwise ring, then its holes
    sizes    : number of corners of the ring, and of each hole

    Raises ValueError if there are too many corners.
    """
    count = outlines.shape[1]
    if count > _MAX_EAR_CORNERS:
        raise ValueError(f"a polygon has {count:,} corners, but {_MAX_EAR_CORNERS:,} are the most")
    from mapbox_earcut import triangulate_float64

    ends = np.cumsum(sizes, dtype=np.uint32)
    return [triangulate_float64(points, ends).reshape(-1, 3).astype(np.int64) for points in outlines]


def _cross(a: Float64, b: Float64) -> Float64:
    # np.cross takes three times as long.
    return np.stack([a[..., i - 2] * b[..., i - 1] - a[..., i - 1] * b[..., i - 2] for i in range(3)], axis=-1)


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def polygon_normal(ring: Float64) -> Float64:
    """Return the (3,) float64 normal of the front of a ring (N, 3); its length is twice the area [Newell]."""
    ring = ring - ring[0]
    return np.asarray(np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0))


def triangulated(boundary: Float64, holes: Sequence[Float64] = ()) -> tuple[Float64, Int32, float]:
    """Return vertices (V, 3), faces (F, 3), and the missing area: boundary minus holes minus triangles.

    boundary : (N, 3) corners, counter-clockwise seen from the front, as those of the faces
    holes    : (M, 3) corners of each hole, in either order, in the plane of the boundary and within it

    The missing area is not zero if rings cross each other or themselves. A polygon without area has no faces.
    """
    check_time()
    size = float(np.linalg.norm(polygon_normal(boundary)))
    if size == 0:
        spokes = boundary[1:] - boundary[0]
        doubled = _cross(spokes[:-1], spokes[1:])
        is_crossed = bool(_areas_cancel(doubled[None], spokes[None])[0])
        overlap = 0.5 * float(np.linalg.norm(doubled, axis=1).sum()) if is_crossed else 0.0
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32), -overlap
    rings = _projected([boundary, *holes])
    if not holes:
        faces = split_polygons(boundary, np.arange(len(boundary)), np.array([len(boundary)])).triangles
        covered = 0.5 * float(np.abs(_doubled_areas(rings[0][faces])).sum())
        return boundary, faces.astype(np.int32), 0.5 * size - covered
    wanted = 0.5 * size - sum(0.5 * float(np.linalg.norm(polygon_normal(hole))) for hole in holes)
    corners = _trapezoids(rings)
    if corners is None:
        vertices, points = np.concatenate([boundary, *holes]), np.concatenate(rings)
        (faces,) = _ears_of_each(points[None], [len(ring) for ring in rings])
        covered = 0.5 * float(np.abs(_doubled_areas(points[faces])).sum())
        is_crossed = abs(wanted - covered) > _LEFT_OUT * size
        cost = len(points) ** 2 * (_CROSSING if is_crossed else 1)
        _add_cost(cost, f"polygons with holes, of up to {len(points):,} corners,")
        return vertices, faces.astype(np.int32), wanted - covered
    flat, numbers = _faces(corners)
    missing = wanted - 0.5 * float(_doubled_areas(flat[numbers]).sum())
    return flat @ _frame(boundary) + boundary[0], numbers, missing


def _frame(ring: Float64) -> Float64:
    """Return (2, 3) unit vectors in the plane of a ring, counter-clockwise about its normal."""
    normal = polygon_normal(ring)
    n = normal / np.linalg.norm(normal)
    # If z is up, `across` is horizontal, so that walls are cut into horizontal bands.
    across = np.cross([0.0, 0.0, 1.0], n) if abs(n[2]) < 0.99 else np.cross([0.0, 1.0, 0.0], n)
    across /= np.linalg.norm(across)
    return np.array([across, np.cross(n, across)])


def _projected(rings: Sequence[Float64]) -> list[Float64]:
    """Return rings (N, 2) in the plane of the first ring, relative to its first corner."""
    frame = _frame(rings[0])
    return [(ring - rings[0][0]) @ frame.T for ring in rings]


def _doubled_areas(corners: Float64) -> Float64:
    """Return (T,) twice the signed areas of triangles (T, 3, 2)."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def _trapezoids(rings: Sequence[Float64]) -> Float64 | None:
    """Return (K, 4, 2) corners of trapezoids, counter-clockwise; None if there are too many.

    A triangle is a trapezoid with two equal corners.
    """
    starts = np.concatenate(rings)
    ends = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    levels = np.unique(starts[:, 1])
    apart = _LEVEL * float(np.ptp(starts, axis=0).max())
    levels = levels[np.concatenate([[True], np.diff(levels) > apart])]
    crossed = np.abs(np.searchsorted(levels, starts[:, 1]) - np.searchsorted(levels, ends[:, 1]))
    if crossed.sum() > _MAX_CROSSED:
        return None
    if len(starts) > _FAST_EAR_CORNERS:
        cost = len(levels) * (_CUT_COST + _EDGE_COST * len(starts))
        _add_cost(cost, f"polygons with holes, of up to {len(starts):,} corners,")
    found = []
    for low, high in pairwise(levels):
        middle = 0.5 * (low + high)
        crosses = (starts[:, 1] < middle) != (ends[:, 1] < middle)
        a, b = starts[crosses], ends[crosses]

        def at(y: float, a: Float64 = a, b: Float64 = b) -> Float64:
            return np.asarray(a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))

        order = np.argsort(at(middle), kind="stable")
        below, above = at(low)[order], at(high)[order]
        count = len(order) // 2
        x = np.stack([below[: 2 * count : 2], below[1::2], above[1::2], above[: 2 * count : 2]], axis=1)
        x = x[np.maximum(x[:, 1] - x[:, 0], x[:, 2] - x[:, 3]) > apart]
        found.append(np.stack([x, np.broadcast_to([low, low, high, high], x.shape)], axis=2))
    return np.concatenate([np.zeros((0, 4, 2)), *found])


def _faces(corners: Float64) -> tuple[Float64, Int32]:
    """Return the vertices (V, 2) of trapezoids, each once, and their triangles (F, 3) that have an area."""
    vertices, number = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    quads = number.reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    doubled = _doubled_areas(vertices[faces])
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 1.0
    return vertices, faces[doubled > _LEVEL * extent**2].astype(np.int32)
