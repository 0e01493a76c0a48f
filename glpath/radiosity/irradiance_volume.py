"""Irradiance by position and normal, for streamed triangles, which have proxies but no radiosity solution.

A point of a streamed triangle lies on no element, but near elements of its proxy. The irradiance of these elements
is stored in the cells of a grid, for six directions along the axes (ambient cubes). A normal (x, y, z) gets the
weighted sum of the three directions that it faces. The weights x^2, y^2 and z^2 add up to one. Values are
interpolated between the centres of cells.

Cost:     192 bytes per occupied cell (16 for each side and direction), with about `OCCUPIED` such cells; an index
          of at most a megabyte.
Poor at:  light that changes within a cell. Use it for indirect light, a bounce away from the eye.
Source:   Greger et al. 1998, The irradiance volume; McTaggart 2004, Half-Life 2 / Valve Source Shading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.lights.lighting import Lighting
from glpath.radiosity.lookup import near_lamps
from glpath.radiosity.mesh import lattice
from glpath.radiosity.mesh.mesh import Elements
from glpath.radiosity.solution import RadiositySolution
from glpath.scene.model import Float64, Scene

#: Target number of occupied cells.
OCCUPIED = 1 << 14
#: Maximum number of cells in the grid.
CELLS = 1 << 18
#: Maximum number of cells along an axis of the grid.
ALONG = 512
# Number of sample points on a surface as large as a cell's face.
_POINTS = 8


@dataclass(frozen=True, eq=False)
class IrradianceVolume:
    """Grid of irradiance by position and direction.

    lower : (3,) lowest corner of the grid, in scene coordinates
    cell  : side length of a cell, scene units
    size  : (3,) number of cells along x, y, z
    rows : (size[2], size[1], size[0]) int32, row of `values` for each cell; an empty cell has the row of the
           nearest cell with surfaces
    values : (R, 2, 6, 4) float32, [row, front or back, direction x, -x, y, -y, z, -z]: irradiance W m^-2, and the
             fraction of direct light that it includes, 0 to 1
    """

    lower: Float64
    cell: float
    size: NDArray[np.int64]
    rows: NDArray[np.int32]
    values: NDArray[np.float32]

    @classmethod
    def of(cls, scene: Scene, solution: RadiositySolution, first: int, *, traced: bool) -> IrradianceVolume | None:
        """Build the volume from the proxy triangles (see `Proxies`); return None if there are none.

        solution : solution of the scene
        first    : index of the first proxy triangle; all triangles from there on are proxies
        traced   : True if the renderer traces direct light, so that the volume contains it only near lamps; False
                   to include all direct light
        """
        corners = scene.triangles[first:]
        if not len(corners):
            return None
        lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        cell, size = _grid(lower, upper, float(scene.areas[first:].sum()))
        points, areas, triangle, barycentric = _points(scene, first, cell)
        index = np.minimum(np.floor((points - lower) / cell).astype(np.int64), size - 1)
        number = index[:, 0] + size[0] * (index[:, 1] + size[1] * index[:, 2])
        occupied, row = np.unique(number, return_inverse=True)
        share = np.ones(len(points))
        if traced:
            share = near_lamps(Lighting.of(scene), points)
        values = np.zeros((len(occupied), 2, 6, 4), np.float32)
        normals = scene.normals[triangle]
        for back in (0, 1):
            arrived = solution.irradiance(triangle, barycentric, back, light="indirect")
            arrived += share[:, None] * solution.irradiance(triangle, barycentric, back, light="direct")
            known = np.column_stack([arrived, share])
            values[:, back] = _by_axis(row, len(occupied), known, -normals if back else normals, areas)
        return cls(lower, cell, size, _nearest(occupied, size), values)


def _grid(lower: Float64, upper: Float64, area: float) -> tuple[float, NDArray[np.int64]]:
    """Return the side length of a cell, and the number of cells (3,) along each axis."""
    extent = np.maximum(upper - lower, 0.0)
    cell = max(np.sqrt(area / OCCUPIED), float(extent.max()) / ALONG)
    size = np.maximum(np.ceil(extent / cell), 1.0)
    while size.prod() > CELLS:
        cell *= 1.1
        size = np.maximum(np.ceil(extent / cell), 1.0)
    return float(cell), size.astype(np.int64)


def _points(
    scene: Scene, first: int, cell: float
) -> tuple[Float64, Float64, NDArray[np.int64], NDArray[np.float64]]:
    """Return sample points (N, 3) on proxies, their areas (N,), triangles (N,) and barycentric coordinates (N, 2).

    Each point is the centre of the area that it represents. Every cell with surfaces contains some points.
    """
    corners, areas = scene.triangles[first:], scene.areas[first:]
    parts = np.maximum(np.ceil(np.sqrt(_POINTS * areas) / cell), 1).astype(np.int64)
    elements = Elements.of_lattices(parts)
    barycentric = elements.corners().mean(axis=1) / elements.n[:, None]
    which = elements.triangle
    edges = corners[:, 1:] - corners[:, :1]
    points = corners[which, 0] + np.einsum("nk,nkd->nd", barycentric, edges[which])
    return points, areas[which] / lattice.element_count(elements.n), which + first, barycentric


def _by_axis(row: NDArray[np.int64], rows: int, known: Float64, normals: Float64, areas: Float64) -> Float64:
    """Return (R, 6, 4), weighted means of the values `known` (N, 4), for each row and each direction along an axis.

    The weight of a sample is its area times the squared cosine between its normal and the direction, if positive.
    """
    sums, weights = np.zeros((rows, 6, 4)), np.zeros((rows, 6))
    for axis in range(6):
        facing = np.maximum(normals[:, axis // 2] * (1 - 2 * (axis % 2)), 0.0)
        weight = areas * facing**2
        weights[:, axis] = np.bincount(row, weight, rows)
        for k in range(4):
            sums[:, axis, k] = np.bincount(row, weight * known[:, k], rows)
    # Directions that no surface in the cell faces get the mean of the other directions.
    mean = sums.sum(axis=1, keepdims=True) / weights.sum(axis=1)[:, None, None]
    found = weights[..., None] > 0
    return np.where(found, sums / np.where(found, weights[..., None], 1.0), mean)


def _nearest(occupied: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.int32]:
    from scipy.ndimage import distance_transform_edt  # late, because the import is slow

    rows = np.full(size.prod(), -1, np.int32)
    rows[occupied] = np.arange(len(occupied))
    rows = rows.reshape(size[::-1])
    nearest = distance_transform_edt(rows < 0, return_distances=False, return_indices=True)
    return np.ascontiguousarray(rows[tuple(nearest)], np.int32)
