"""Conservative bounds of objects in a point light's shadow-buffer: rectangles of cells that miss no hit [TB III.E].

The paper shoots "all the rays from the light source which can possibly intersect" an object, and does not explain
how to find them. Here an object's outline on the sphere of directions is bounded. A sphere is bounded by a cap (its
cone of tangents), a triangle by its corners and the bulge of the great arcs between them. The results are
rectangles of the buffer, in latitude and longitude (`sphere_bounds`) or on the faces of a cube (`cube_bounds`).
Large rectangles are divided into bands of rows. A plane covers half of all directions, which are found row by row.
The exact test comes later, ray by ray.

All is float64 on the CPU, vectorised over primitives. The light may lie inside an object, or on it.

Cost:     about a microsecond per primitive and face; for a plane, per row.
Poor at:  long thin ellipsoids, which are bounded by their bounding sphere, and slanted slivers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.scene.model import Float64
from glpath.system.kernels import kernel

Int64 = NDArray[np.int64]

#: Padding of a bound, radians: more than the error of the shader's angles (angles.glsl) and of its rays.
MARGIN = 1e-5
#: Minimum number of cells of a rectangle that is divided into bands. Smaller rectangles stay whole, because drawing
#: a rectangle costs as much as some hundred rays.
_LARGE = 1500
#: Approximate number of cells in a band.
_BAND_CELLS = 300
#: Maximum number of bands of a rectangle.
_BANDS = 24
TINY = 1e-300


class CellRectangles(NamedTuple):
    """Rectangles of cells, each for one primitive on one face; none is empty, and none crosses an edge of its face.

    primitive : (N,) int64, index among the primitives of the same kind
    face      : (N,) int64; 0 for a sphere-buffer
    """

    primitive: Int64
    face: Int64
    first: Int64
    last: Int64

    @property
    def cells(self) -> int:
        """Number of cells in all rectangles together, which is the number of rays."""
        width, height = (self.last - self.first + 1).T
        return int(np.dot(width, height))


class Caps(NamedTuple):
    """Caps on the sphere of directions.

    axis  : (N, 3) unit
    angle : (N,) radians, half of the opening; pi if the cap contains every direction
    """

    axis: Float64
    angle: Float64


class Spheres(NamedTuple):
    """Spheres by centre (S, 3) and radius (S,)."""

    centre: Float64
    radius: Float64


def spheres_around(world_from_unit: Float64) -> Spheres:
    """Return the bounding spheres of spheres and ellipsoids (S, 3, 4); they are the same for all lights."""
    return Spheres(world_from_unit[:, :, 3], _longest_radius(world_from_unit[:, :, :3]))


def sphere_caps(spheres: Spheres, light: Float64) -> Caps:
    """Return the caps that spheres cover, seen from `light` (3,)."""
    caps = Caps(np.empty((len(spheres.radius), 3)), np.empty(len(spheres.radius)))
    _caps(spheres.centre, spheres.radius, light, caps.axis, caps.angle)
    return caps


@kernel
def _caps(centre: Float64, radius: Float64, light: Float64, axis: Float64, angle: Float64) -> None:
    """Compute the caps that spheres cover into axis (S, 3) and angle (S,), see `sphere_caps`."""
    for i in range(len(radius)):
        x, y, z = centre[i, 0] - light[0], centre[i, 1] - light[1], centre[i, 2] - light[2]
        distance = np.sqrt(x * x + y * y + z * z)
        angle[i] = np.arcsin(radius[i] / distance) if distance > radius[i] else np.pi
        scale = 1.0 / max(distance, TINY)
        axis[i, 0], axis[i, 1], axis[i, 2] = x * scale, y * scale, z * scale


def _longest_radius(axes: Float64) -> Float64:
    """Return (S,) maximum radii of ellipsoids whose half axes are the columns of (S, 3, 3)."""
    products = axes.transpose(0, 2, 1) @ axes
    square = products[:, 0, 0]
    # Round spheres, whose columns are perpendicular and equally long, avoid the decomposition, which takes far
    # longer.
    difference = np.abs(products - square[:, None, None] * np.eye(3)).max(axis=(1, 2), initial=0.0)
    uneven = difference > 1e-12 * square
    radius = np.sqrt(square) * (1.0 + 1e-12)
    if uneven.any():
        radius[uneven] = np.linalg.norm(axes[uneven], ord=2, axis=(1, 2))
    return np.asarray(radius)


def cells_between(low: Float64, high: Float64) -> tuple[Int64, Int64]:
    """Return the first and last cell whose centres lie in [low, high], in units of cells; last < first for none."""
    return np.ceil(low - 0.5).astype(np.int64), np.floor(high - 0.5).astype(np.int64)


#: Empty list of rectangles.
NOTHING = CellRectangles(
    np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64)
)


def join(parts: list[CellRectangles]) -> CellRectangles:
    return CellRectangles(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def without_empty(primitive: Int64, face: Int64, first: Int64, last: Int64) -> CellRectangles:
    some = np.all(last >= first, axis=1)
    return CellRectangles(primitive[some], face[some], first[some], last[some])


def in_bands(
    whole: CellRectangles, span: Callable[[Int64, Int64, Int64], tuple[Float64, Float64]]
) -> CellRectangles:
    """Divide large rectangles into bands of rows, each band only as wide as its object in those rows.

    span : function that takes (N,) indices of rectangles, their faces, and rows. It returns the first and last
           column that the object covers in each row, as real numbers
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
    cut = without_empty(
        whole.primitive[which[begins]],
        whole.face[which[begins]],
        np.stack([np.minimum.reduceat(first, begins), row[begins]], axis=1),
        np.stack([np.maximum.reduceat(last, begins), row[ends]], axis=1),
    )
    others = np.setdiff1d(np.arange(len(whole.primitive)), large)
    return join([CellRectangles(*(field[others] for field in whole)), cut])


def edge_planes(d: Float64) -> Float64:
    """Return (T, 3, 3) unit normals of the planes through the light and each edge of triangles (T, 3, 3).

    Directions inside a triangle have positive dot products with all three of its normals. The normals are zero if
    the light is in the triangle's plane.
    """
    d = d / np.maximum(np.linalg.norm(d, axis=2, keepdims=True), TINY)
    normal = np.cross(d, np.roll(d, -1, axis=1))
    size = np.linalg.norm(normal, axis=2, keepdims=True)
    volume = np.einsum("ij,ij->i", normal[:, 0], d[:, 2])
    sure = (np.abs(volume) > 1e-9) & np.all(size[:, :, 0] > 1e-9, axis=1)
    return np.asarray(normal / np.maximum(size, TINY) * (np.sign(volume) * sure)[:, None, None])


def towards(world_from_plane: Float64, light: Float64) -> Float64:
    """Return (P, 3) unit normals of planes (P, 3, 4), pointing away from a light (3,).

    A direction hits the plane if it is less than a right angle from the plane's normal.
    """
    normal = world_from_plane[:, :, 2]
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.einsum("ij,ij->i", normal, light - world_from_plane[:, :, 3])
    return np.asarray(np.where(height > 0, -1.0, 1.0)[:, None] * normal)


def rectangles_of_rows(face: int, primitive: int, first: Int64, last: Int64) -> CellRectangles:
    """Return a primitive's rectangles from the first and last column of each row (rows,), merging equal rows."""
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(first) != 0) | (np.diff(last) != 0)]))
    ends = np.concatenate([starts[1:], [len(first)]]) - 1
    low = np.stack([first[starts], starts], axis=1)
    high = np.stack([last[starts], ends], axis=1)
    return without_empty(np.full(len(starts), primitive), np.full(len(starts), face), low, high)
