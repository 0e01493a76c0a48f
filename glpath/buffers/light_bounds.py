"""Which cells of a point light's shadow-buffer an object can be seen in: rectangles that miss none [TB III.E].

The paper shoots "all the rays from the light source which can possibly intersect" an object, and does not say how
they are found. Here an object's outline on the sphere of directions is bounded: a sphere's by a cap (its cone of
tangents), a triangle's by its corners and by how high the great arcs between them bulge. Rectangles of the buffer
follow: of latitude and longitude, or of the faces of a cube; large ones are cut into bands of rows. A plane takes
half of all directions, which are found row by row. The exact test comes after, ray by ray.

All in float64 on the CPU, vectorised over primitives. The light may stand inside an object, or on it.

Cost:     about a microsecond per primitive and face; for a plane, per row.
Poor at:  long thin ellipsoids, which are bounded as the sphere around them, and slanted slivers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.kernels import kernel
from glpath.scene.model import Float64

Int64 = NDArray[np.int64]

FACES = 6
#: Radians that a bound is grown by: the shader's angles (angles.glsl) and the rounding of its rays stay below.
MARGIN = 1e-5
#: Rectangles of so many cells are cut into bands, of about so many cells, and up to so many. To draw a rectangle
#: costs as much as to shoot some hundred rays.
_LARGE, _BAND_CELLS, _BANDS = 1500, 300, 24
_TINY = 1e-300


class CellRectangles(NamedTuple):
    """Rectangles of cells, each of one primitive on one face; none is empty, and none reaches over an edge.

    primitive : (N,) int64, number within its kind
    face      : (N,) int64, 0 for the sphere
    first     : (N, 2) int64, column and row of the first cell
    last      : (N, 2) int64, of the last cell, itself included
    """

    primitive: Int64
    face: Int64
    first: Int64
    last: Int64

    @property
    def cells(self) -> int:
        """How many cells there are in all: as many rays are shot."""
        width, height = (self.last - self.first + 1).T
        return int(np.dot(width, height))


class Caps(NamedTuple):
    """Caps on the sphere of directions.

    axis  : (N, 3) unit
    angle : (N,) radians, half of the opening; pi where every direction belongs to it
    """

    axis: Float64
    angle: Float64


class Spheres(NamedTuple):
    """centre (S, 3) and radius (S,)."""

    centre: Float64
    radius: Float64


def spheres_around(world_from_unit: Float64) -> Spheres:
    """The spheres around spheres and ellipsoids (S, 3, 4): wherever the light is, so worth keeping."""
    return Spheres(world_from_unit[:, :, 3], _longest_radius(world_from_unit[:, :, :3]))


def sphere_caps(spheres: Spheres, light: Float64) -> Caps:
    """The caps that spheres fill as seen from `light` (3,)."""
    caps = Caps(np.empty((len(spheres.radius), 3)), np.empty(len(spheres.radius)))
    _caps(spheres.centre, spheres.radius, light, caps.axis, caps.angle)
    return caps


@kernel
def _caps(centre: Float64, radius: Float64, light: Float64, axis: Float64, angle: Float64) -> None:
    """Fill axis (S, 3) and angle (S,)."""
    for i in range(len(radius)):
        x, y, z = centre[i, 0] - light[0], centre[i, 1] - light[1], centre[i, 2] - light[2]
        distance = np.sqrt(x * x + y * y + z * z)
        angle[i] = np.arcsin(radius[i] / distance) if distance > radius[i] else np.pi
        scale = 1.0 / max(distance, _TINY)
        axis[i, 0], axis[i, 1], axis[i, 2] = x * scale, y * scale, z * scale


def _longest_radius(axes: Float64) -> Float64:
    """(S,) the largest distance from the centre, of ellipsoids whose axes' ends are the columns of (S, 3, 3)."""
    products = axes.transpose(0, 2, 1) @ axes
    square = products[:, 0, 0]
    # Of a round one the columns are perpendicular and as long as each other; a decomposition takes far longer.
    difference = np.abs(products - square[:, None, None] * np.eye(3)).max(axis=(1, 2), initial=0.0)
    uneven = difference > 1e-12 * square
    radius = np.sqrt(square) * (1.0 + 1e-12)
    if uneven.any():
        radius[uneven] = np.linalg.norm(axes[uneven], ord=2, axis=(1, 2))
    return np.asarray(radius)


def _cells(low: Float64, high: Float64) -> tuple[Int64, Int64]:
    """The cells whose centres lie in [low, high], in cells; last < first where there is none."""
    return np.ceil(low - 0.5).astype(np.int64), np.floor(high - 0.5).astype(np.int64)


@kernel
def _ranges_to_cells(
    south: Float64,
    north: Float64,
    west: Float64,
    east: Float64,
    rows: int,
    columns: int,
    primitive: Int64,
    cells: Int64,
) -> int:
    """Of each range of angles, its number, and its first column and row and its last ones; none is empty.

    Longitudes may be up to a turn wide and anywhere; what reaches over the seam is split, its second part last.
    Fills primitive (2 N,) and cells (2 N, 4), and returns how many there are.
    """
    count = len(south)
    found = 0
    for part in range(2):
        for i in range(count):
            # A margin of longitude is wider than one of latitude towards the poles.
            nearest_pole = min(max(abs(south[i]), abs(north[i])), np.pi / 2)
            margin = MARGIN / max(np.cos(nearest_pole), MARGIN)
            row_first = max(int(np.ceil(((south[i] - MARGIN) / np.pi + 0.5) * rows - 0.5)), 0)
            row_last = min(int(np.floor(((north[i] + MARGIN) / np.pi + 0.5) * rows - 0.5)), rows - 1)
            if east[i] - west[i] + 2 * margin >= 2 * np.pi:
                first, last = 0, columns - 1
            else:
                first = int(np.ceil((west[i] - margin) / (2 * np.pi) * columns - 0.5))
                last = int(np.floor((east[i] + margin) / (2 * np.pi) * columns - 0.5))
                turn = first // columns * columns  # the first column lies within the first turn
                first, last = first - turn, min(last - turn, first - turn + columns - 1)
            if part == 0:
                last = min(last, columns - 1)
            else:
                first, last = 0, last - columns
            if first <= last and row_first <= row_last:
                primitive[found] = i
                cells[found, 0], cells[found, 1] = first, row_first
                cells[found, 2], cells[found, 3] = last, row_last
                found += 1
    return found


def _latitude_longitude(
    latitude: tuple[Float64, Float64], longitude: tuple[Float64, Float64], rows: int, columns: int
) -> CellRectangles:
    most = 2 * len(latitude[0])
    primitive, cells = np.empty(most, np.int64), np.empty((most, 4), np.int64)
    found = _ranges_to_cells(*latitude, *longitude, rows, columns, primitive, cells)
    primitive, cells = primitive[:found], cells[:found]
    return CellRectangles(primitive, np.zeros_like(primitive), cells[:, :2], cells[:, 2:])


#: No rectangle at all.
NOTHING = CellRectangles(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64)
)


def _join(parts: list[CellRectangles]) -> CellRectangles:
    return CellRectangles(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _without_empty(primitive: Int64, face: Int64, first: Int64, last: Int64) -> CellRectangles:
    some = np.all(last >= first, axis=1)
    return CellRectangles(primitive[some], face[some], first[some], last[some])


@kernel
def _cap_ranges(axis: Float64, angle: Float64, latitude: Float64, middle: Float64, half: Float64) -> None:
    """Fill of each cap the latitude and longitude of its axis, and by how much its longitudes differ from that."""
    for i in range(len(angle)):
        x, y, z = axis[i, 0], axis[i, 1], axis[i, 2]
        level = np.sqrt(x * x + y * y)
        latitude[i] = np.arctan2(z, level)
        middle[i] = np.arctan2(y, x)
        if abs(latitude[i]) + angle[i] >= np.pi / 2 - MARGIN:
            half[i] = np.pi
        else:
            half[i] = np.arcsin(min(np.sin(angle[i]) / max(np.cos(latitude[i]), _TINY), 1.0))


def sphere_rectangles_of_caps(caps: Caps, rows: int, columns: int) -> CellRectangles:
    """The cells of a sphere-buffer whose rays lie in each cap."""
    axis, angle = caps
    latitude, middle, half = (np.empty(len(angle)) for _ in range(3))
    _cap_ranges(axis, angle, latitude, middle, half)
    south = np.maximum(latitude - angle, -np.pi / 2)
    north = np.minimum(latitude + angle, np.pi / 2)
    rectangles = _latitude_longitude((south, north), (middle - half, middle + half), rows, columns)

    def span(which: Int64, _face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """A row is inside where the cosine of its longitude less the cap's is large enough."""
        i = rectangles.primitive[which]
        theta = ((row + 0.5) / rows - 0.5) * np.pi
        # The margin in the cosine is a margin of angle, and of its square where the sine is small.
        least = np.cos(angle[i]) - MARGIN * np.sin(angle[i]) - MARGIN**2 - np.sin(theta) * np.sin(latitude[i])
        width = np.arccos(np.clip(least / np.maximum(np.cos(theta) * np.cos(latitude[i]), _TINY), -1.0, 1.0))
        width = np.where(angle[i] < np.pi / 2, width + MARGIN, np.inf)
        range_middle = (rectangles.first[which, 0] + rectangles.last[which, 0] + 1) * np.pi / columns
        at = middle[i] + 2 * np.pi * np.round((range_middle - middle[i]) / (2 * np.pi))
        # Where the range meets the arc at both its ends, all of it stays.
        reach = (rectangles.last[which, 0] - rectangles.first[which, 0] + 1) * np.pi / columns
        width = np.where(np.abs(at - range_middle) + width + reach < 2 * np.pi, width, np.inf)
        return (at - width) / (2 * np.pi) * columns - 0.5, (at + width) / (2 * np.pi) * columns - 0.5

    return _in_bands(rectangles, span)


def sphere_rectangles_of_triangles(triangles: Float64, light: Float64, rows: int, columns: int) -> CellRectangles:
    """The cells of a sphere-buffer whose rays can meet each triangle of (T, 3, 3)."""
    if not len(triangles):
        return NOTHING
    d = triangles - light
    length = np.linalg.norm(d, axis=2)
    scale = np.maximum(length.max(axis=1, initial=0.0), _TINY)
    d = d / np.maximum(length, _TINY)[:, :, None]
    latitude = np.arctan2(d[:, :, 2], np.hypot(d[:, :, 0], d[:, :, 1]))
    south, north = latitude.min(axis=1), latitude.max(axis=1)
    following = np.roll(d, -1, axis=1)
    # The arc between two corners bulges to the latitude of its great circle's highest point, where that lies on it.
    normal = np.cross(d, following)
    size = np.linalg.norm(normal, axis=2)
    unit = normal / np.maximum(size, _TINY)[:, :, None]
    highest = -unit[:, :, 2:] * unit
    highest[:, :, 2] += 1.0
    slack = -1e-9
    from_here = np.einsum("ijk,ijk->ij", np.cross(normal, d), highest)
    from_next = np.einsum("ijk,ijk->ij", np.cross(following, normal), highest)
    top = np.arccos(np.clip(np.abs(unit[:, :, 2]), 0.0, 1.0))
    north = np.maximum(north, np.where((from_here > slack) & (from_next > slack), top, -np.pi / 2).max(axis=1))
    south = np.minimum(south, np.where((from_here < -slack) & (from_next < -slack), -top, np.pi / 2).min(axis=1))

    # Longitudes run one way along an arc, and less than half a turn. All around the triangle they come back to
    # where they began, unless there is a pole inside.
    phi = np.arctan2(d[:, :, 1], d[:, :, 0])
    step = np.roll(phi, -1, axis=1) - phi
    step -= 2 * np.pi * np.round(step / (2 * np.pi))
    around = np.abs(step.sum(axis=1)) > 1.0
    walk = np.stack([np.zeros(len(phi)), step[:, 0], step[:, 0] + step[:, 1]], axis=1)
    west, east = phi[:, 0] + walk.min(axis=1), phi[:, 0] + walk.max(axis=1)
    # Close to a pole, or to the light in the triangle's own plane, nobody can say which way an arc runs.
    unsure = np.any(np.abs(step) > np.pi - 1e-4, axis=1) | np.any(length < 1e-9 * scale[:, None], axis=1)
    unsure |= np.any(np.hypot(d[:, :, 0], d[:, :, 1]) < MARGIN, axis=1)
    volume = np.einsum("ij,ij->i", normal[:, 0], d[:, 2])
    unsure |= around & (np.abs(volume) < 1e-12)
    whole = around | unsure
    # A pole inside is on the same side of all three arcs as the triangle.
    up = normal[:, :, 2].sum(axis=1) * volume > 0
    north = np.where((around & up) | unsure, np.pi / 2, north)
    south = np.where((around & ~up) | unsure, -np.pi / 2, south)
    west, east = np.where(whole, 0.0, west), np.where(whole, 2 * np.pi, east)
    rectangles = _latitude_longitude((south, north), (west, east), rows, columns)
    planes = _edge_planes(triangles - light)

    def span(which: Int64, _face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Each edge's plane cuts an arc out of the row. One that the range meets at both its ends is left out."""
        low = (rectangles.first[which, 0] + 0.5) / columns * 2 * np.pi
        high = (rectangles.last[which, 0] + 0.5) / columns * 2 * np.pi
        begin, end = np.full(len(which), -np.inf), np.full(len(which), np.inf)
        theta = ((row + 0.5) / rows - 0.5) * np.pi
        cosine, sine = np.cos(theta), np.sin(theta)
        for edge in range(3):
            n = planes[rectangles.primitive[which], edge]
            across = np.maximum(cosine * np.hypot(n[:, 0], n[:, 1]), _TINY)
            half = np.arccos(np.clip(-(sine * n[:, 2] + MARGIN) / across, -1.0, 1.0))
            middle = np.arctan2(n[:, 1], n[:, 0])
            middle += 2 * np.pi * np.round((0.5 * (low + high) - middle) / (2 * np.pi))
            one = (middle + half - 2 * np.pi < low) & (middle - half + 2 * np.pi > high)
            begin = np.where(one, np.maximum(begin, middle - half), begin)
            end = np.where(one, np.minimum(end, middle + half), end)
        return begin / (2 * np.pi) * columns - 0.5, end / (2 * np.pi) * columns - 0.5

    return _in_bands(rectangles, span)


def _in_bands(
    whole: CellRectangles, span: Callable[[Int64, Int64, Int64], tuple[Float64, Float64]]
) -> CellRectangles:
    """Large rectangles cut into bands of rows, each as wide as its object is there.

    span : of (N,) indices of rectangles, their faces and rows: the first and last column, real numbers
    """
    height = whole.last[:, 1] - whole.first[:, 1] + 1
    cells = height * (whole.last[:, 0] - whole.first[:, 0] + 1)
    large = np.flatnonzero((cells >= _LARGE) & (height > 1))
    if not len(large):
        return whole
    height = height[large]
    bands = np.minimum(cells[large] // _BAND_CELLS, _BANDS)
    which = np.repeat(large, height)
    offset = np.arange(len(which)) - np.repeat(np.cumsum(height) - height, height)
    row = whole.first[which, 1] + offset
    low, high = span(which, whole.face[which], row)
    first = np.ceil(np.maximum(low, whole.first[which, 0])).astype(np.int64)
    last = np.floor(np.minimum(high, whole.last[which, 0])).astype(np.int64)
    none = last < first
    first[none], last[none] = np.iinfo(np.int64).max, -1
    begins = np.flatnonzero(offset % np.repeat(-(-height // bands), height) == 0)
    ends = np.concatenate([begins[1:], [len(which)]]) - 1
    cut = _without_empty(
        whole.primitive[which[begins]],
        whole.face[which[begins]],
        np.stack([np.minimum.reduceat(first, begins), row[begins]], axis=1),
        np.stack([np.maximum.reduceat(last, begins), row[ends]], axis=1),
    )
    others = np.setdiff1d(np.arange(len(whole.primitive)), large)
    return _join([CellRectangles(*(field[others] for field in whole)), cut])


def _edge_planes(d: Float64) -> Float64:
    """(T, 3, 3) unit normals of the planes through the light and each edge of triangles with corners (T, 3, 3).

    Directions inside have positive products with all three. Zeros where the light is in the triangle's plane.
    """
    d = d / np.maximum(np.linalg.norm(d, axis=2, keepdims=True), _TINY)
    normal = np.cross(d, np.roll(d, -1, axis=1))
    size = np.linalg.norm(normal, axis=2, keepdims=True)
    volume = np.einsum("ij,ij->i", normal[:, 0], d[:, 2])
    sure = (np.abs(volume) > 1e-9) & np.all(size[:, :, 0] > 1e-9, axis=1)
    return np.asarray(normal / np.maximum(size, _TINY) * (np.sign(volume) * sure)[:, None, None])


def _towards(world_from_plane: Float64, light: Float64) -> Float64:
    """(P, 3): unit normals of planes (P, 3, 4), of the side that a light (3,) looks at them from, turned around.

    Directions that meet the plane are less than a right angle from it.
    """
    normal = world_from_plane[:, :, 2]
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.einsum("ij,ij->i", normal, light - world_from_plane[:, :, 3])
    return np.asarray(np.where(height > 0, -1.0, 1.0)[:, None] * normal)


def _from_rows(face: int, primitive: int, first: Int64, last: Int64) -> CellRectangles:
    """Rectangles from the first and last columns (rows,) of every row; equal neighbours become one."""
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(first) != 0) | (np.diff(last) != 0)]))
    ends = np.concatenate([starts[1:], [len(first)]]) - 1
    low = np.stack([first[starts], starts], axis=1)
    high = np.stack([last[starts], ends], axis=1)
    return _without_empty(np.full(len(starts), primitive), np.full(len(starts), face), low, high)


def sphere_rectangles_of_planes(
    world_from_plane: Float64, light: Float64, rows: int, columns: int
) -> CellRectangles:
    """The cells of a sphere-buffer whose rays meet each plane of (P, 3, 4)."""
    parts = [NOTHING]
    theta = ((np.arange(rows) + 0.5) / rows - 0.5) * np.pi
    for index, n in enumerate(_towards(world_from_plane, light)):
        # cos(theta) |n.xy| cos(phi - middle) + sin(theta) n.z > 0
        across = np.maximum(np.cos(theta) * np.hypot(n[0], n[1]), _TINY)
        half = np.arccos(np.clip(-(np.sin(theta) * n[2] + MARGIN) / across, -1.0, 1.0))
        middle = np.arctan2(n[1], n[0])
        low, high = (middle - half) / (2 * np.pi) * columns, (middle + half) / (2 * np.pi) * columns
        first, last = _cells(low, high)
        turn = np.floor_divide(first, columns) * columns
        first, last = first - turn, last - turn
        whole = last - first >= columns - 1
        first, last = np.where(whole, 0, first), np.where(whole, columns - 1, last)
        parts.append(_from_rows(0, index, first, np.minimum(last, columns - 1)))
        parts.append(_from_rows(0, index, np.zeros_like(first), last - columns))
    return _join(parts)


def cube_rectangles_of_planes(world_from_plane: Float64, light: Float64, side: int) -> CellRectangles:
    """The cells of a cube-buffer whose rays meet each plane of (P, 3, 4)."""
    parts = [NOTHING]
    y = np.tan(((np.arange(side) + 0.5) / side - 0.5) * np.pi / 2)
    for index, world in enumerate(_towards(world_from_plane, light)):
        for face in range(FACES):
            n = to_face(face, world)
            # n.x x + n.y y + n.z > 0
            rest = n[1] * y + n[2] + MARGIN
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = np.nan_to_num(-rest / n[0], nan=np.inf, posinf=np.inf, neginf=-np.inf)
            if n[0] == 0.0:
                low, high = np.where(rest > 0, -1.0, 2.0), np.full(side, 1.0)
            elif n[0] > 0:
                low, high = cut, np.full(side, 1.0)
            else:
                low, high = np.full(side, -1.0), cut
            first, last = _cells(*((np.arctan(s) * 2 / np.pi + 0.5) * side for s in (low, high)))
            parts.append(_from_rows(face, index, np.maximum(first, 0), np.minimum(last, side - 1)))
    return _join(parts)


def to_face(face: int, d: Float64) -> Float64:
    """(..., 3) in the frame of a cube's face, as point_shadow_map.glsl has it: across, across and along."""
    axis = face // 2
    f = np.roll(d, -1 - axis, axis=-1).copy()
    f[..., 2] *= -1.0 if face & 1 else 1.0
    return f


def _face_cells(low: Float64, high: Float64, side: int) -> tuple[Int64, Int64]:
    """From angles (N, 2) across a face to cells within it."""
    first, last = _cells(((low - MARGIN) * 2 / np.pi + 0.5) * side, ((high + MARGIN) * 2 / np.pi + 0.5) * side)
    return np.maximum(first, 0), np.minimum(last, side - 1)


def cube_rectangles_of_caps(caps: Caps, side: int) -> CellRectangles:
    """The cells of a cube-buffer whose rays lie in each cap.

    Across a face, a cap is seen between two planes that touch it and hold the other axis (Mara & McGuire 2013).
    """
    parts = []
    index = np.arange(len(caps.angle))
    radius = np.where(caps.angle < np.pi / 2, np.sin(np.minimum(caps.angle, np.pi / 2)), 1.0)
    for face in range(FACES):
        f = to_face(face, caps.axis)
        along = f[:, 2:]
        middle = np.arctan2(f[:, :2], along)
        distance = np.hypot(f[:, :2], along)
        half = np.where(
            radius[:, None] < distance - 1e-12,
            np.arcsin(np.minimum(radius[:, None] / np.maximum(distance, _TINY), 1.0)),
            2 * np.pi,  # the axis across lies in the cap
        )
        low, high = np.maximum(middle - half, -np.pi / 4), np.minimum(middle + half, np.pi / 4)
        missed = np.any(low > high + MARGIN, axis=1)
        first, last = _face_cells(low, high, side)
        last[missed] = -1
        parts.append(_without_empty(index, np.full_like(index, face), first, last))
    rectangles = _join(parts)
    axes_of_face = np.stack([to_face(face, caps.axis) for face in range(FACES)])
    cosine = np.cos(np.minimum(caps.angle + MARGIN, np.pi / 2))

    def span(which: Int64, face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Inside, the square of a direction's product with the axis is large enough: a quadratic, along a row."""
        i = rectangles.primitive[which]
        a, square = axes_of_face[face, i], cosine[i] ** 2
        y = np.tan(((row + 0.5) / side - 0.5) * np.pi / 2)
        along = a[:, 1] * y + a[:, 2]
        p, q, r = a[:, 0] ** 2 - square, a[:, 0] * along, along**2 - square * (1 + y * y)
        inside = q * q - p * r
        # An ellipse; the other conics are rare, and keep their rectangles. As is a row that just touches.
        ellipse = (p < -1e-6) & (inside > -1e-9)
        root = np.sqrt(np.maximum(inside, 0.0)) + MARGIN
        with np.errstate(divide="ignore", invalid="ignore"):
            begin, end = (-q + root) / p, (-q - root) / p
        begin = np.where(ellipse, begin, np.where(p < -1e-6, np.inf, -np.inf))
        end = np.where(ellipse, end, np.where(p < -1e-6, -np.inf, np.inf))
        return (np.arctan(begin) * 2 / np.pi + 0.5) * side - 0.5, (np.arctan(end) * 2 / np.pi + 0.5) * side - 0.5

    return _in_bands(rectangles, span)


def cube_rectangles_of_triangles(triangles: Float64, light: Float64, side: int) -> CellRectangles:
    """The cells of a cube-buffer whose rays can meet each triangle of (T, 3, 3).

    On a face lie what is left of each edge, cut off by the four planes through the light and the face's edges, and
    those corners of the face that the triangle covers; the rectangle is around these.
    """
    parts = []
    index = np.arange(len(triangles))
    corners = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    planes = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]])
    world = triangles - light
    world = world / np.maximum(np.abs(world).max(axis=(1, 2), initial=0.0), _TINY)[:, None, None]
    for face in range(FACES):
        d = to_face(face, world)
        heights = d @ planes.T  # (T, corner, plane): inside where >= 0
        # Most triangles lie outside of one of the planes.
        near = np.flatnonzero(~np.any(np.all(heights < -MARGIN, axis=1), axis=1))
        d, heights = d[near], heights[near]
        low, high = np.full((len(near), 2), np.inf), np.full((len(near), 2), -np.inf)
        for i in range(3):
            j = (i + 1) % 3
            a, b, at_a, at_b = d[:, i], d[:, j], heights[:, i], heights[:, j]
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = at_a / (at_a - at_b)
            start = np.where((at_a < 0) & (at_b >= 0), cut, 0.0).max(axis=1)
            end = np.where((at_a >= 0) & (at_b < 0), cut, 1.0).min(axis=1)
            gone = np.any((at_a < 0) & (at_b < 0), axis=1) | (start > end + 1e-9)
            for s in (start, end):
                p = a + s[:, None] * (b - a)
                z = p[:, 2:]
                with np.errstate(divide="ignore", invalid="ignore"):
                    q = np.where(z > 1e-12, p[:, :2] / z, np.nan)
                # At the light itself every direction is possible.
                q_low, q_high = np.where(np.isnan(q), -1.0, q), np.where(np.isnan(q), 1.0, q)
                low = np.where(gone[:, None], low, np.minimum(low, q_low))
                high = np.where(gone[:, None], high, np.maximum(high, q_high))
        normals = np.cross(d, np.roll(d, -1, axis=1))
        for corner in corners:
            side_of = normals @ corner
            tolerance = 1e-9
            covered = np.all(side_of >= -tolerance, axis=1) | np.all(side_of <= tolerance, axis=1)
            # Not where the corner's opposite is what the triangle covers.
            covered &= np.any(d @ corner > 0, axis=1)
            low = np.where(covered[:, None], np.minimum(low, corner[:2]), low)
            high = np.where(covered[:, None], np.maximum(high, corner[:2]), high)
        found = np.all(low <= high, axis=1)
        low, high = (np.arctan(np.where(found[:, None], s, 0.0)) for s in (low, high))
        first, last = _face_cells(low, high, side)
        last[~found] = -1
        parts.append(_without_empty(index[near], np.full(len(near), face, dtype=np.int64), first, last))
    rectangles = _join(parts)
    edges = _edge_planes(triangles - light)
    edges_of_face = np.stack([to_face(face, edges) for face in range(FACES)])

    def span(which: Int64, face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Each edge's plane cuts the row once."""
        y = np.tan(((row + 0.5) / side - 0.5) * np.pi / 2)
        begin, end = np.full(len(which), -1.0), np.full(len(which), 1.0)
        for edge in range(3):
            n = edges_of_face[face, rectangles.primitive[which], edge]
            rest = n[:, 1] * y + n[:, 2] + 2 * MARGIN
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = -rest / n[:, 0]
            begin = np.where(n[:, 0] > 0, np.maximum(begin, cut), begin)
            end = np.where(n[:, 0] < 0, np.minimum(end, cut), end)
            end = np.where((n[:, 0] == 0) & (rest < 0), -2.0, end)
        return (np.arctan(begin) * 2 / np.pi + 0.5) * side - 0.5, (np.arctan(end) * 2 / np.pi + 0.5) * side - 0.5

    return _in_bands(rectangles, span)
