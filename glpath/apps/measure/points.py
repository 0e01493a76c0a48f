"""Points of a measurement, and grids of points in a plane with the spacing of EN 12464-1."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import UsageError, argument, warn
from glpath.io.values import LARGEST, SMALLEST
from glpath.scene import Scene
from glpath.system.arguments import real_array
from glpath.system.numerals import real
from glpath.system.time_limit import check_time

__all__ = ["Grid", "Points", "plane_grid"]

Float64 = NDArray[np.float64]

AXES = "xyz"


#: Maximum number of points in a grid or a table.
MAX_POINTS = 4_000_000


#: Value of --spacing that selects the spacing of EN 12464-1, which depends on the size of the area.
EN_12464 = "en12464-1"


@dataclass(frozen=True)
class Points:
    """Points and their normals.

    points, normals : (N, 3) float64; normals of any length but zero
    grid            : grid of the points; None for a table
    """

    points: Float64
    normals: Float64
    grid: Grid | None = None


@dataclass(frozen=True)
class Grid:
    """Grid of points in a plane perpendicular to an axis, row by row.

    across : indices of the two axes in the plane: columns follow the first, rows the second
    axis   : index of the axis perpendicular to the plane
    height : position along that axis, scene units
    first  : coordinates of the first point along the two axes in the plane, scene units
    shape  : (rows, columns)
    step   : spacing along the two axes, scene units
    """

    across: tuple[int, int]
    axis: int
    height: float
    first: tuple[float, float]
    shape: tuple[int, int]
    step: tuple[float, float]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Bounds of the cells, scene units: minimum and maximum along the first axis, then along the second."""
        (a, b), (rows, columns), (du, dv) = self.first, self.shape, self.step
        a, b = a - 0.5 * du, b - 0.5 * dv
        return a, a + columns * du, b, b + rows * dv

    @property
    def apart(self) -> str:
        """Spacing of the points along both axes, as text."""
        a, b = (f"{step:.3g}" for step in self.step)
        return a if a == b else f"{a} x {b}"

    @property
    def en_12464_counts(self) -> tuple[int, int]:
        """Counts of points along the two axes that EN 12464-1 requires for the area, if scene units are metres."""
        a, b, c, d = self.extent
        return en_12464_counts(b - a, d - c)

    @property
    def coarser_than_en_12464(self) -> bool:
        """True if the grid has fewer points along an axis than EN 12464-1 requires."""
        (rows, columns), (first, second) = self.shape, self.en_12464_counts
        return columns < first or rows < second

    @property
    def beside_en_12464(self) -> str:
        """Comparison of the number of points with EN 12464-1, as text."""
        a, b, c, d = self.extent
        first, second = self.en_12464_counts
        counts = f"{first} x {second} points or more for {b - a:.3g} x {d - c:.3g} m"
        return f"{counts}; this grid has fewer" if self.coarser_than_en_12464 else f"{counts}: fulfilled"

    def described(self, scene: Scene) -> str:
        """Return the position of the grid as text, with a hint if the plane is not horizontal."""
        a, b, c, d = self.extent
        u, v = (AXES[i] for i in self.across)
        ranges = f"{u} from {coordinate(a)} to {coordinate(b)}, {v} from {coordinate(c)} to {coordinate(d)}"
        text = f"plane: {AXES[self.axis]} = {coordinate(self.height)}, {ranges}"
        up = np.abs(scene.camera.up)
        upright = int(np.argmax(up))
        if upright == self.axis or not up[upright] > 0.99 * np.linalg.norm(up):
            return text
        return f"{text}; it stands upright, if {AXES[upright]} is up: a working plane is {AXES[upright]}=HEIGHT"


def en_12464_counts(first: float, second: float) -> tuple[int, int]:
    """Return the two counts of points along the sides of an area by EN 12464-1, 4.4 (2011).

    first, second : lengths of the sides, m

    The spacing is p = 0.2 * 5^log10(d), at most 10 m. d is the longer side, or the shorter side if the longer is at
    least twice as long. Side d gets the integer nearest to d / p. The other side gets the integer that makes cells
    most nearly square.
    """
    longer, shorter = max(first, second), min(first, second)
    d = longer if longer < 2 * shorter else shorter
    step = d / max(1, round(d / min(0.2 * 5 ** math.log10(d), 10.0)))
    return max(1, round(first / step)), max(1, round(second / step))


def plane_grid(
    scene: Scene,
    plane: str,
    *,
    spacing: float | Literal["en12464-1"] | None = None,
    area: ArrayLike | None = None,
    margin: float = 0.0,
    normal: ArrayLike | None = None,
) -> Points:
    """Return a grid of points in a plane of a scene.

    Points are centres of cells. A spacing in scene units gives square cells, as many as fit into the area. The
    spacing of EN 12464-1 gives cells that fill the area.

    plane   : axis perpendicular to the plane and position along it: "y=0.75" faces +y at a height of 0.75,
              "-y=2.4" faces down from 2.4
    spacing : distance between points, scene units; "en12464-1" for that of the standard, which depends on the area;
              None: a 32nd of the longer side
    area    : two corners of the grid along the other two axes, in the order x, y, z: (2, 2) or (4,); None: those of
              the scene
    margin  : width left out along the edges of the area, scene units
    normal  : (3,) normal of all points, of any nonzero length; None: that of the plane

    Raises UsageError.
    """
    name, _, height_text = plane.partition("=")
    down = name.startswith("-")
    axis = AXES.find(name.lstrip("-").lower()) if name.lstrip("-") else -1
    if axis < 0 or len(name) != 1 + down:
        raise UsageError(
            f"{argument('plane', plane)}: expected AXIS=HEIGHT, an axis out of x, y and z.",
            "y=0.75 faces +y at a height of 0.75, -y=2.4 faces down from 2.4.",
        )
    height = _height(plane, height_text)
    first, second = across = tuple(i for i in range(3) if i != axis)
    if area is None:
        lower, upper = (bound[list(across)] for bound in scene.bounds)
        if not np.isfinite([lower, upper]).all():
            raise UsageError(f"{argument('plane', plane)}: the scene has no bounds to lay a grid in.", _where())
    else:
        given = real_array("area", area, "(2, 2) or (4,)", {(2, 2), (4,)}.__contains__).reshape(2, 2)
        lower, upper = given
        if not (np.abs([lower, upper]) <= LARGEST).all():
            raise UsageError(
                f"{argument('area', given.ravel().tolist())}: must be from {-LARGEST:g} to {LARGEST:g}."
            )
    if not 0 <= margin <= LARGEST:
        raise UsageError(f"{argument('margin', margin)}: must be from 0 to {LARGEST:g}, in scene units.")
    size = upper - lower
    if margin > 0 and (size > 0).all() and not (size > 2 * margin).all():
        raise UsageError(
            f"{argument('margin', margin)}: leaves nothing of {size[0]:g} x {size[1]:g}.", "Take a smaller one."
        )
    lower, size = lower + margin, size - 2 * margin
    if not (size >= SMALLEST).all():
        if area is not None:
            both = f"{AXES[first]} and {AXES[second]}"
            raise UsageError(
                f"{argument('area', given.ravel().tolist())}: the second corner must lie beyond the first along "
                f"{both}."
            )
        raise UsageError(f"{argument('plane', plane)}: the scene has no extent across it.", _where())
    if isinstance(spacing, str) and spacing.lower() == EN_12464:
        counts = np.array(en_12464_counts(float(size[0]), float(size[1])), float)
        step = size / counts
    else:
        apart = float(size.max()) / 32 if spacing is None else _apart(spacing)
        step = np.array([apart, apart])
        counts = np.maximum(np.floor(size / step + 1e-6), 1.0)
    if not counts.prod() <= MAX_POINTS:
        raise UsageError(
            f"{argument('spacing', float(step[0]))}: {counts[0]:.0f} x {counts[1]:.0f} points; at most "
            f"{MAX_POINTS:,} are allowed.",
            "Take a wider one, or a smaller area.",
        )
    columns, rows = (int(n) for n in counts)
    # The cells are centred in the area, so strips left over at opposite edges have equal width.
    start = lower + 0.5 * (size - counts * step) + 0.5 * step
    u, v = (start[i] + step[i] * np.arange(n) for i, n in enumerate((columns, rows)))
    u, v = np.meshgrid(u, v)
    check_time()
    points = np.empty((rows * columns, 3))
    points[:, first], points[:, second], points[:, axis] = u.ravel(), v.ravel(), height
    along = (-1.0 if down else 1.0) * np.eye(3)[axis]
    facing = along if normal is None else real_array("normal", normal, "(3,)", (3,).__eq__)
    normals = np.broadcast_to(facing, points.shape)
    apart_by = float(step[0]), float(step[1])
    grid = Grid((first, second), axis, height, (float(start[0]), float(start[1])), (rows, columns), apart_by)
    return Points(points, normals, grid)


def check_within(at: Points, scene: Scene, option: str) -> None:
    """Warn if all points lie outside the bounding box of the scene and its lamps.

    Raises UsageError if even the nearest point is farther from the box than the box is wide. Then the points
    probably have another unit or origin than the scene.
    """
    lamps = [light.position for light in scene.lights if light.kind != "directional"]
    box = np.array([*scene.bounds, *lamps])
    box = box[np.isfinite(box).all(axis=1)]
    if not len(box) or len(scene.planes):
        return
    lower, upper = box.min(axis=0), box.max(axis=0)
    size = float((upper - lower).max())
    check_time()
    gap = np.maximum(np.maximum(lower - at.points, at.points - upper), 0.0)
    check_time()
    if not gap.any(axis=1).all():
        return
    nearest = gap[gap.max(axis=1).argmin()]
    axis = int(nearest.argmax())
    if (upper - lower)[axis] <= 1e-3 * size and nearest[axis] <= size:
        return  # points near a scene that is flat along this axis, such as open ground
    low, high = coordinate(lower[axis]), coordinate(upper[axis])
    text = f"{option}: all points lie outside the scene, which reaches from {AXES[axis]} = {low} to {high}"
    if nearest[axis] > size:
        raise UsageError(
            f"{text}, and is {size:.4g} wide.",
            "Coordinates are in the scene's units, and its axes: `glpath info` prints where it is.",
        )
    up = AXES[int(np.argmax(np.abs(scene.camera.up)))]
    other = f". A working plane is {up}=HEIGHT, if {up} is up." if at.grid and AXES[at.grid.axis] != up else "."
    warn(text + other)


def coordinate(x: float) -> str:
    """Return a coordinate as text: four significant digits, or two decimals from 1,000 units on."""
    return f"{x:.4g}" if abs(x) < 1e3 else f"{x:.2f}"


def _where() -> str:
    return f"Say where it is, such as {argument('area', (0, 0, 4, 5))}."


def _height(plane: str, text: str) -> float:
    try:
        height = real(text)
    except ValueError:
        height = math.nan
    if not math.isfinite(height):
        raise UsageError(f"{argument('plane', plane)}: expected AXIS=HEIGHT in finite numbers.", "y=0.75 is one.")
    if abs(height) > LARGEST:
        raise UsageError(f"{argument('plane', plane)}: must be from {-LARGEST:g} to {LARGEST:g}.")
    return height


def _apart(spacing: object) -> float:
    """Return a spacing in scene units as a float. Raises UsageError unless it is a number in the allowed range."""
    if isinstance(spacing, int | float | np.floating) and SMALLEST <= spacing <= LARGEST:
        return float(spacing)
    raise UsageError(
        f"{argument('spacing', spacing)}: must be from {SMALLEST:g} to {LARGEST:g}, in scene units, or "
        f'"{EN_12464}".'
    )
