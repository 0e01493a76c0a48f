"""Points of `glpath measure` (a grid in a plane, or a table), and files with its results."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glpath.cli.values import Vector, numbers
from glpath.errors import ImageError, UsageError, warn
from glpath.io.values import LARGEST, SMALLEST
from glpath.system.bounded_reading import reading_file
from glpath.system.files import is_stream, read_bytes, read_standard_input, reason_of, whole_file, write_bytes
from glpath.system.numerals import real
from glpath.system.time_limit import check_time
from glpath.system.units import symbol

if TYPE_CHECKING:
    from glpath.rendering.points import Irradiance
    from glpath.scene import Scene

Float64 = NDArray[np.float64]

AXES = "xyz"
#: Maximum number of points in a grid or a table.
MAX_POINTS = 4_000_000
#: Maximum number of characters in a line of a table.
MAX_LINE = 65_536
# Maximum length of the list of column names in an error, characters.
_SHOWN = 200
#: Suffixes of the output formats.
WRITABLE = (".csv", ".npz", ".html", ".png", ".glb", ".vtp")

#: Value of --spacing that selects the spacing of EN 12464-1, which depends on the size of the area.
EN_12464 = "en12464-1"

_POINT, _NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
_NUMBER = re.compile(r"[+-]?[.\d]")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+(,\d*)?([eE][+-]?\d+)?")


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


def grid_of(
    plane: str,
    spacing: str | None,
    area: str | None,
    scene: Scene,
    *,
    margin: float = 0.0,
    normal: Vector | None = None,
) -> Points:
    """Return a grid of points from the values of --plane, --spacing, --area, --margin and --normal.

    Points are centres of cells. A spacing in scene units gives square cells, as many as fit into the area. The
    spacing of EN 12464-1 gives cells that fill the area. Raises UsageError.
    """
    name, _, height_text = plane.partition("=")
    down = name.startswith("-")
    axis = AXES.find(name.lstrip("-").lower()) if name.lstrip("-") else -1
    if axis < 0 or len(name) != 1 + down:
        raise UsageError(
            f"--plane {plane}: expected AXIS=HEIGHT, an axis out of x, y and z.",
            "y=0.75 faces +y at a height of 0.75, -y=2.4 faces down from 2.4.",
        )
    (height,) = numbers(f"--plane {plane}:", height_text, "AXIS=HEIGHT", [1], real)
    if abs(height) > LARGEST:
        raise UsageError(f"--plane {plane}: must be from {-LARGEST:g} to {LARGEST:g}.")
    first, second = across = tuple(i for i in range(3) if i != axis)
    if area is None:
        lower, upper = (bound[list(across)] for bound in scene.bounds)
        if not np.isfinite([lower, upper]).all():
            raise UsageError("--plane: the scene has no bounds to lay a grid in.", "Say where it is: --area.")
    else:
        given = np.array(numbers("--area", area, "A,B,A,B", [4], real)).reshape(2, 2)
        if np.abs(given).max() > LARGEST:
            raise UsageError(f"--area {area}: must be from {-LARGEST:g} to {LARGEST:g}.")
        lower, upper = given
    if not 0 <= margin <= LARGEST:
        raise UsageError(f"--margin {margin:g}: must be from 0 to {LARGEST:g}, in scene units.")
    size = upper - lower
    if margin > 0 and (size > 0).all() and not (size > 2 * margin).all():
        raise UsageError(
            f"--margin {margin:g}: leaves nothing of {size[0]:g} x {size[1]:g}.", "Take a smaller one."
        )
    lower, size = lower + margin, size - 2 * margin
    if not (size >= SMALLEST).all():
        if area is not None:
            both = f"{AXES[first]} and {AXES[second]}"
            raise UsageError(f"--area {area}: the second corner must lie beyond the first along {both}.")
        raise UsageError(f"--plane {plane}: the scene has no extent across it.", "Say where it is: --area A,B,A,B.")
    if spacing is not None and spacing.lower() == EN_12464:
        counts = np.array(en_12464_counts(float(size[0]), float(size[1])), float)
        step = size / counts
    else:
        apart = float(size.max()) / 32 if spacing is None else _apart(spacing)
        step = np.array([apart, apart])
        counts = np.maximum(np.floor(size / step + 1e-6), 1.0)
    if not counts.prod() <= MAX_POINTS:
        raise UsageError(
            f"--spacing {step[0]:g}: {counts[0]:.0f} x {counts[1]:.0f} points; at most {MAX_POINTS:,} are allowed.",
            "Take a wider one, or a smaller --area.",
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
    normals = np.broadcast_to(along if normal is None else np.array(normal), points.shape)
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


def _apart(spacing: str) -> float:
    """Return the value of --spacing in scene units. Raises UsageError unless it is a number above 0."""
    try:
        value = real(spacing)
    except ValueError:
        value = math.nan
    if not SMALLEST <= value <= LARGEST:
        raise UsageError(
            f"--spacing {spacing}: must be from {SMALLEST:g} to {LARGEST:g}, in scene units, or {EN_12464}."
        )
    return value


def read_points(path: Path, normal: Vector | None) -> Points:
    """Read points from a table with the columns x, y, z and nx, ny, nz, or from a honeybee model.

    path   : table with values separated by commas, semicolons, tabs or blanks; - for standard input. Or
             FILE.hbjson#GRID for one sensor grid of a honeybee model, FILE.hbjson for all its sensor grids
    normal : normal of all points if the table has no normals; otherwise None

    Columns have the order above, unless the first line names them. Lines that begin with # are comments. Commas are
    decimal commas if they do not separate values and no number has a decimal point.

    Raises UsageError that names the faulty line.
    """
    file, _, grid = str(path).partition("#")
    if file.lower().endswith(".hbjson"):
        from glpath.io.honeybee import sensor_points

        if normal is not None:
            raise UsageError(f"--normal beside the directions of {file}.", "Leave it out.")
        with reading_file(Path(file).name):
            return Points(*sensor_points(Path(file), grid or None))
    with reading_file(path.name):
        return _read_table(path, normal)


def _read_table(path: Path, normal: Vector | None) -> Points:
    text = _text(path)
    names: list[str] | None = None
    rows: list[list[float]] = []
    lines: list[int] = []
    for line, cells in table_lines(text, path):
        check_time()
        found = [_number(cell) for cell in cells]
        if names is None:
            if all(value is None for value in found):
                names = _names(cells, path, line)
                continue
            names = list((*_POINT, *_NORMAL)[: len(cells)])
            if len(cells) not in (3, 6):
                raise UsageError(
                    f"{path}, line {line}: {len(cells)} numbers where 3 (x, y, z) or 6 (nx, ny, nz) are needed.",
                    "Other columns want a line of names above them.",
                )
        if len(cells) != len(names):
            raise UsageError(f"{path}, line {line}: {len(cells)} values where there are {len(names)} columns.")
        values = {name: (cell, value) for name, cell, value in zip(names, cells, found, strict=True)}
        for name in (*_POINT, *_NORMAL):
            if name in values and values[name][1] is None:
                raise UsageError(
                    f"{path}, line {line}: {name} is {values[name][0]!r} where a finite number is needed."
                )
        rows.append(
            [value for name in (*_POINT, *_NORMAL) if name in values and (value := values[name][1]) is not None]
        )
        lines.append(line)
        if len(rows) > MAX_POINTS:
            raise UsageError(f"{path}, line {line}: at most {MAX_POINTS:,} points are measured.")
    if not rows:
        raise UsageError(f"--points {path}: holds no point.", "Each line is a point: x,y,z,nx,ny,nz.")
    table = np.array(rows)
    if table.shape[1] == 3:
        if normal is None:
            raise UsageError(
                f"--points {path}: has no normals (columns nx, ny, nz).", "Give one for all: --normal X,Y,Z."
            )
        if not any(normal):
            raise UsageError("--normal: 0, 0, 0 looks nowhere.", "0,1,0 faces +y.")
        return Points(table, np.broadcast_to(np.array(normal), table.shape))
    if normal is not None:
        raise UsageError(f"--normal beside the normals of {path}.", "Leave one of them out.")
    dark = np.flatnonzero(~table[:, 3:].any(axis=1))
    if len(dark):
        raise UsageError(f"{path}, line {lines[dark[0]]}: the normal is 0, 0, 0, which looks nowhere.")
    return Points(table[:, :3], table[:, 3:])


def _text(path: Path) -> str:
    """Return the text of a file. Raises UsageError if it is not text."""
    try:
        content = read_standard_input() if str(path) == "-" else read_bytes(path)
        # Spreadsheets write "Unicode text" as UTF-16, and a byte order mark before UTF-8 and UTF-16.
        return content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except OSError as error:
        raise UsageError(f"--points {path}: cannot be read: {reason_of(error)}.") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"--points {path}: cannot be read: it is not UTF-8 text.", "Save it as UTF-8.") from error


def table_lines(text: str, path: Path) -> list[tuple[int, list[str]]]:
    """Return (line number, cells) of each line that is neither empty nor a comment.

    Decimal commas in the cells are replaced by decimal points. Raises UsageError.
    """
    lines = [(i, line) for i, line in enumerate(text.splitlines(), start=1) if line.strip(' \t,;"')]
    lines = [(i, line) for i, line in lines if not line.lstrip().startswith("#")]
    for number, line in lines:
        if len(line) > MAX_LINE:
            raise UsageError(
                f"{path}, line {number}: {len(line):,} characters, but at most {MAX_LINE:,} are read.",
                "Each line is one row of the table.",
            )
    # Excel may write a first line such as "sep=;", which names the delimiter.
    given = re.fullmatch(r"sep=(.)\s*", lines[0][1], re.IGNORECASE) if lines else None
    if given is not None:
        del lines[0]
    first = lines[0][1] if lines else ""
    delimiter = given[1] if given is not None else next((mark for mark in ";\t," if mark in first), " ")
    if delimiter == "," and len(first.split()) > 2 and all(map(_DECIMAL_COMMA.fullmatch, first.split())):
        delimiter = " "
    rest = "\n".join(line for _, line in lines)
    decimal_commas = delimiter != "," and not re.search(r"\d\.|\.\d", rest)
    ends = first.rstrip(" ").endswith(delimiter)  # True for Radiance, which ends each line with a tab
    found = []
    try:
        for number, line in lines:
            check_time()
            cells = line.split() if delimiter == " " else next(csv.reader([line], delimiter=delimiter, strict=True))
            cells = [cell.strip() for cell in cells]
            if delimiter == "\t" and any(" " in cell for cell in cells) and all(map(_NUMBER.match, line.split())):
                cells = line.split()  # blanks separate coordinates, a tab separates point and normal
            if ends:
                cells = cells[:-1] if not cells[-1] else cells
            if decimal_commas:
                cells = [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells]
            found.append((number, cells))
    except csv.Error as error:
        raise UsageError(
            f"{path}, line {number}: is no line of a table: {error}.",
            "A quotation mark opens and closes in one line.",
        ) from error
    return found


def _names(cells: Sequence[str], path: Path, line: int) -> list[str]:
    names, columns = [cell.lower() for cell in cells], ", ".join(cells)
    wanted = [*_POINT, *(_NORMAL if set(_NORMAL) & set(names) else ())]
    for name in wanted:
        if names.count(name) != 1:
            raise UsageError(
                f"{path}, line {line}: has {'no column' if name not in names else 'two columns'} {name}; "
                f"its columns are {columns if len(columns) <= _SHOWN else f'{columns[:_SHOWN]} ...'}.",
                "Columns are x, y, z and nx, ny, nz; others are passed over.",
            )
    return names


def _number(cell: str) -> float | None:
    try:
        value = real(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def save_csv(path: Path, at: Points, found: Irradiance) -> None:
    """Write one line per point: position, normal, irradiance and illuminance with their standard errors.

    Irradiance has the unit of the scene, which the column titles name.
    """
    unit = symbol(found.unit, "irradiance").replace(" m^-2", "/m2")
    columns = {
        **{name: at.points[:, i] for i, name in enumerate(_POINT)},
        **{name: at.normals[:, i] for i, name in enumerate(_NORMAL)},
        **{f"{name} [{unit}]": found.values[:, i] for i, name in enumerate(("E_r", "E_g", "E_b"))},
        **{f"{name} [{unit}]": found.standard_errors[:, i] for i, name in enumerate(("se_r", "se_g", "se_b"))},
        "E [lx]": found.illuminance(),
        "se [lx]": found.illuminance_errors(),
    }
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    # Positions get all digits, because coordinates of a georeferenced model are large.
    digits = [15 if name in _POINT else 9 for name in columns]
    writer.writerows(
        [f"{value:.{n}g}" for value, n in zip(row, digits, strict=True)]
        for row in zip(*columns.values(), strict=True)
    )
    write_bytes(text.getvalue().encode(), path)


def save_npz(path: Path, at: Points, found: Irradiance) -> None:
    """Write arrays: (N, 3) points, normals, irradiance, standard_errors, and (N,) illuminance, illuminance_errors.

    The array `unit` holds the unit of irradiance, "W m^-2" or "lx". For a grid of points, arrays have the shape
    (rows, columns, ...) instead of (N, ...). Raises ImageError if the file cannot be written.
    """
    shape = at.grid.shape if at.grid is not None else (len(at.points),)
    arrays: dict[str, Any] = {
        "points": at.points,
        "normals": at.normals,
        "irradiance": found.values,
        "standard_errors": found.standard_errors,
        "illuminance": found.illuminance(),
        "illuminance_errors": found.illuminance_errors(),
    }
    shaped = {name: array.reshape(*shape, *array.shape[1:]) for name, array in arrays.items()}
    with whole_file(path) as part, part.open("wb") as file:
        np.savez_compressed(file, unit=symbol(found.unit, "irradiance"), **shaped)


def check_kind(path: Path) -> None:
    """Raise ImageError if the suffix of an output is not in `WRITABLE`; the path - (CSV on stdout) is allowed."""
    if not is_stream(path) and path.suffix.lower() not in WRITABLE:
        raise ImageError(f"{path}: cannot be written.", f"Files end in {', '.join(WRITABLE)}.")
