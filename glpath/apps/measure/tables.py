"""Tables of points, and CSV and NPZ files with the irradiance and illuminance at points."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.measure.points import MAX_POINTS, Points
from glpath.errors import UsageError, argument
from glpath.system.arguments import real_array
from glpath.system.bounded_reading import reading_file
from glpath.system.files import read_bytes, read_standard_input, reason_of, whole_file, write_bytes
from glpath.system.numerals import real
from glpath.system.time_limit import check_time
from glpath.system.units import symbol

if TYPE_CHECKING:
    from glpath.rendering.points import Irradiance

__all__ = ["read_points", "save_csv", "save_npz"]

Float64 = NDArray[np.float64]

#: Maximum number of characters in a line of a table.
MAX_LINE = 65_536
# Maximum length of the list of column names in an error, characters.
_SHOWN = 200


_POINT, _NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
_NUMBER = re.compile(r"[+-]?[.\d]")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+(,\d*)?([eE][+-]?\d+)?")


def read_points(path: str | Path, normal: ArrayLike | None = None) -> Points:
    """Read points from a table with the columns x, y, z and nx, ny, nz, or from a honeybee model.

    path   : table with values separated by commas, semicolons, tabs or blanks; - for standard input. Or
             FILE.hbjson#GRID for one sensor grid of a honeybee model, FILE.hbjson for all its sensor grids
    normal : normal of all points if the table has no normals; otherwise None

    Columns have the order above, unless the first line names them. Lines that begin with # are comments. Commas are
    decimal commas if they do not separate values and no number has a decimal point.

    Raises UsageError that names the faulty line.
    """
    path = Path(path)
    file, _, grid = str(path).partition("#")
    if file.lower().endswith(".hbjson"):
        from glpath.io.honeybee import sensor_points

        if normal is not None:
            raise UsageError(f"{argument('normal', normal)}: beside the directions of {file}.", "Leave it out.")
        with reading_file(Path(file).name):
            return Points(*sensor_points(Path(file), grid or None))
    with reading_file(path.name):
        return _read_table(path, normal)


def _read_table(path: Path, normal: ArrayLike | None) -> Points:
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
        raise UsageError(f"{path}: holds no point.", "Each line is a point: x,y,z,nx,ny,nz.")
    table = np.array(rows)
    if table.shape[1] == 3:
        if normal is None:
            raise UsageError(
                f"{path}: has no normals (columns nx, ny, nz).",
                f"Give one for all, such as {argument('normal', (0, 1, 0))}.",
            )
        facing = real_array("normal", normal, "(3,)", (3,).__eq__)
        if not facing.any():
            raise UsageError(
                f"{argument('normal', (0, 0, 0))}: looks nowhere.", f"{argument('normal', (0, 1, 0))} faces +y."
            )
        return Points(table, np.broadcast_to(facing, table.shape))
    if normal is not None:
        raise UsageError(f"{argument('normal', normal)}: beside the normals of {path}.", "Leave one of them out.")
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
        raise UsageError(f"{path}: cannot be read: {reason_of(error)}.") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: cannot be read: it is not UTF-8 text.", "Save it as UTF-8.") from error


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


def save_csv(path: str | Path, at: Points, found: Irradiance) -> None:
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
    write_bytes(text.getvalue().encode(), Path(path))


def save_npz(path: str | Path, at: Points, found: Irradiance) -> None:
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
