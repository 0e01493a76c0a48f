"""Height field: samples of the ground on a regular grid, and the triangles between them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.ma import MaskedArray
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.system.arguments import checked, checked_fields, real_array, short_repr

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

#: Maximum absolute height. It rejects some values that stand for "no data", such as 3.4e38.
_HIGHEST = 1e5
# Minimum spacing; its square fits in float32.
_FINEST = 1e-9
# Maximum spacing; its square fits in float32.
_COARSEST = 1e9


@checked
@checked_fields
@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights above a plane at the samples of a regular grid; x is east, y is north, z is up.

    heights : (R, C) float32, row 0 in the north, as in a raster; NaN in holes
    spacing : (2,) distances between columns and between rows, in the unit of the heights
    origin  : (2,) x and y of sample [0, 0], the north-western one
    source  : file name or other source, for error messages
    crs     : coordinate reference system of x and y, as text (WKT), or ""

    Each cell of four samples has two triangles, divided from its north-western to its south-eastern sample. A
    triangle is missing if one of its samples is missing. The terrain ends at the field's border.

    Raises SceneError for other shapes, heights beyond 1e5, and a spacing or an origin out of range.
    """

    heights: Float32
    spacing: tuple[float, float] = (1.0, 1.0)
    origin: tuple[float, float] = (0.0, 0.0)
    source: str = "height field"
    crs: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        values = _as_heights(self.heights, self.source)
        if np.isnan(values).all():
            raise SceneError(f"{self.source}: has no height at all: every sample is missing.")
        extreme = np.abs(values) > _HIGHEST
        if extreme.any():
            at = np.argwhere(extreme)[0]
            raise SceneError(
                f"{self.source}: the height at row {at[0]}, column {at[1]} is {values[at[0], at[1]]:g}, but may be "
                f"{_HIGHEST:g} at most.",
                "Does it stand for no data? Give a mask, or NaN there.",
            )
        apart = [float(each) for each in self.spacing]
        if len(apart) != 2 or not all(_FINEST <= each <= _COARSEST for each in apart):
            alike = len(apart) == 2 and apart[0] == apart[1]
            found = short_repr(apart[0] if alike else self.spacing)
            raise SceneError(
                f"{self.source}: has a spacing of {found}, but needs one number above 0, or "
                f"two, from {_FINEST:g} to {_COARSEST:g}."
            )
        at_corner = [float(each) for each in self.origin]
        if len(at_corner) != 2 or not all(map(math.isfinite, at_corner)):
            raise SceneError(
                f"{self.source}: has the origin {short_repr(self.origin)}, but needs two finite numbers, x and y."
            )
        object.__setattr__(self, "heights", np.ascontiguousarray(values))
        object.__setattr__(self, "spacing", (apart[0], apart[1]))
        object.__setattr__(self, "origin", (at_corner[0], at_corner[1]))

    @classmethod
    def of(
        cls,
        heights: ArrayLike | MaskedArray[Any, Any],
        spacing: float | tuple[float, float] = 1.0,
        origin: tuple[float, float] = (0.0, 0.0),
        *,
        mask: ArrayLike | None = None,
        holes: bool = False,
        source: str = "height field",
        crs: str = "",
    ) -> HeightField:
        """Check the arguments and return a height field. Raises SceneError.

        heights : (R, C) numbers, row 0 in the north; at least 2 x 2
        spacing : distance between samples, or between columns and between rows, in the unit of the heights
        mask    : (R, C) bool, True if the sample has a height
        holes   : True if samples may be missing; missing samples cast no shadow, and their results are NaN
        """
        values = _as_heights(np.ma.getdata(heights) if np.ma.isMaskedArray(heights) else heights, source, copy=True)
        if np.ma.isMaskedArray(heights):
            values[np.ma.getmaskarray(heights)] = np.nan
        if mask is not None:
            there = np.asarray(mask)
            if there.shape != values.shape or there.dtype != np.bool_:
                raise SceneError(
                    f"{source}: has a mask of shape {there.shape} and type {there.dtype}, but needs one of shape "
                    f"{values.shape} and type bool.",
                    "True is where there is a height.",
                )
            values[~there] = np.nan
        missing = int(np.count_nonzero(np.isnan(values)))
        if missing and missing < values.size and not holes:
            at = np.argwhere(np.isnan(values))[0]
            raise SceneError(
                f"{source}: {missing:,} of {values.size:,} heights are missing, the first at row {at[0]}, column "
                f"{at[1]}.",
                "Fill them, or say holes=True: holes shadow nothing, and get no result.",
            )
        apart = tuple(spacing) if isinstance(spacing, Iterable) else (spacing, spacing)
        return cls(values, apart, origin, source, crs)  # type: ignore[arg-type] # the constructor checks the length

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        rows, columns = self.heights.shape
        return rows, columns

    @property
    def triangle_count(self) -> int:
        """Number of triangles, two per cell, including cells without data."""
        return 2 * (self.shape[0] - 1) * (self.shape[1] - 1)

    def coordinates(self) -> tuple[Float64, Float64]:
        """Return x (C,) of the columns, and y (R,) of the rows."""
        rows, columns = self.shape
        x = self.origin[0] + self.spacing[0] * np.arange(columns, dtype=np.float64)
        return x, self.origin[1] - self.spacing[1] * np.arange(rows, dtype=np.float64)

    def grid_positions(self, points: Float64) -> Float64:
        """Return the column and the row (N, 2) of points (N, 2 or 3), as fractional numbers."""
        return np.asarray((_points(points)[:, :2] - self.origin) / (self.spacing[0], -self.spacing[1]))

    def heights_at(self, points: ArrayLike) -> Float64:
        """Return heights (N,) of the surface at points (N, 2 or 3); NaN outside the field and in holes."""
        return self._planes_at(_points(points))[0]

    def normals_at(self, points: ArrayLike) -> Float32:
        """Return unit normals (N, 3) of the triangles at points (N, 2 or 3); upward if a point has no triangle."""
        _, east, south = self._planes_at(_points(points))
        slopes = [-east / self.spacing[0], south / self.spacing[1], np.ones_like(east)]
        normals = np.stack(slopes, axis=1)
        normals[np.isnan(normals).any(axis=1)] = 0.0, 0.0, 1.0
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True), np.float32)

    def _planes_at(self, points: Float64) -> tuple[Float64, Float64, Float64]:
        """Return the height of the surface at points, and the slopes of the triangles there, each as (N,).

        The slopes are the rise per column to the east and the rise per row to the south. The height is NaN outside
        the field and in holes.
        """
        at = self.grid_positions(points)
        rows, columns = self.shape
        edge = 1e-9 * max(rows, columns)
        inside = np.all((at >= -edge) & (at <= np.array([columns - 1, rows - 1]) + edge), axis=1)
        at = np.where(inside[:, None], at, 0.0)
        c = np.clip(np.floor(at[:, 0]).astype(int), 0, columns - 2)
        r = np.clip(np.floor(at[:, 1]).astype(int), 0, rows - 2)
        u, v = at[:, 0] - c, at[:, 1] - r
        a, b, d, e = (self.heights[r + i, c + j].astype(np.float64) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
        # Choose the triangle north-east or south-west of the diagonal. Points on the diagonal have a height even if
        # one of the two triangles is missing.
        north_east = (u > v) | ((u == v) & ~np.isnan(b))
        east, south = np.where(north_east, b - a, e - d), np.where(north_east, e - b, d - a)
        height = np.where(u == v, a + u * (e - a), a + u * east + v * south)
        return np.where(inside, height, np.nan), east, south

    def triangles(self) -> tuple[Float64, NDArray[np.int32]]:
        """Return vertices (V, 3) and faces (F, 3) of the surface, counter-clockwise seen from above."""
        x, y = self.coordinates()
        rows, columns = self.shape
        vertices = np.stack([*np.meshgrid(x, y), self.heights.astype(np.float64)], axis=-1).reshape(-1, 3)
        number = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
        a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
        faces = np.stack([np.stack([a, d, b], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
        if np.isnan(self.heights).any():
            faces = faces[np.isfinite(vertices[faces, 2]).all(axis=1)]
        return vertices, faces

    def normals(self) -> Float32:
        """Return unit normals (R, C, 3) at the samples, from differences between neighbours.

        Along an axis on which a neighbour is missing, the slope counts as 0.
        """
        result = np.empty((*self.shape, 3), np.float32)
        result[..., 2] = 1.0
        for axis, component, step in ((1, 0, self.spacing[0]), (0, 1, -self.spacing[1])):
            slope = np.gradient(self.heights, axis=axis)
            slope /= np.float32(step)
            np.negative(np.nan_to_num(slope, copy=False), out=result[..., component])
        result /= np.linalg.norm(result, axis=2, keepdims=True)
        return result


def _as_heights(heights: ArrayLike, source: str, copy: bool = False) -> Float32:
    """Return heights as float32. Raises SceneError unless they are an array (R, C) of numbers, 2 x 2 at least.

    The shape is checked before values are copied.

    copy : True to return a new array in any case
    """
    try:
        given = np.asarray(heights)
        if given.ndim != 2 or min(given.shape) < 2 or np.iscomplexobj(given):
            raise SceneError(
                f"{source}: has heights of shape {given.shape}, but needs (rows, columns) of 2 x 2 at least."
            )
        with np.errstate(over="ignore"):  # an infinite height is reported with its position
            return given.astype(np.float32, copy=copy)
    except MemoryError:
        raise SceneError(f"{source}: its heights do not fit into memory.", "Divide the field into parts.") from None
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{source}: heights are no array of numbers.") from None


def _points(given: ArrayLike) -> Float64:
    """Return points (N, 2) or (N, 3) as float64. Raises UsageError for another shape."""
    points: Float64 = real_array("points", given, "(N, 2) or (N, 3)", lambda s: len(s) == 2 and s[1] in (2, 3))
    return points
