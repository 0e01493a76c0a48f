"""Files with a measurement: tables, arrays, reports, pictures with false colours, and models."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from glpath.apps.measure.figures import figures
from glpath.apps.measure.measured import Measured
from glpath.apps.measure.tables import save_csv, save_npz
from glpath.errors import ImageError, warn
from glpath.film.image import encode_png
from glpath.io.export.false_colours import Facets, cells
from glpath.io.export.gltf import write_gltf
from glpath.io.vtk import points_with_values
from glpath.system.files import is_stream, write_bytes

if TYPE_CHECKING:
    from glpath.apps.measure.measured import Measured

#: Suffixes of the formats that `save` writes.
WRITABLE = (".csv", ".npz", ".html", ".png", ".glb", ".vtp")


def check_kind(path: Path) -> None:
    """Raise ImageError if the suffix of an output is not in `WRITABLE`; the path - (CSV on stdout) is allowed."""
    if not is_stream(path) and path.suffix.lower() not in WRITABLE:
        raise ImageError(f"{path}: cannot be written.", f"Files end in {', '.join(WRITABLE)}.")


def save(path: Path, measured: Measured) -> None:
    """Write results in the format of the suffix; a path without a suffix means CSV on stdout.

    Raises ImageError if the file cannot be written.
    """
    match path.suffix.lower():
        case ".npz":
            save_npz(path, measured.at, measured.found)
        case ".html":
            from glpath.apps.measure.report import save_report

            save_report(path, measured)
        case ".png":
            _save_picture(path, measured)
        case ".glb":
            save_glb(path, measured)
        case ".vtp":
            save_vtp(path, measured)
        case _:
            save_csv(path, measured.at, measured.found)


def _save_picture(path: Path, measured: Measured) -> None:
    from glpath.apps.measure.report import plan

    grid, found = measured.at.grid, measured.found
    assert grid is not None, "asked for before"
    inside = f"Without {measured.dark:,} that have no light at all (grey): " if measured.dark else ""
    page = plan(
        measured,
        f"{grid.shape[1]} x {grid.shape[0]} points, {grid.apart} apart, {found.film.path_sets:,} paths each. "
        f"{inside}{figures(measured.spread, 3, measured.unit)}.",
    )
    write_bytes(encode_png(page), path)


def save_vtp(path: Path, measured: Measured) -> None:
    """Write the cells of a grid, or points alone, with illuminance and irradiance, as .vtp. Raises ImageError."""
    found = measured.found
    data = {
        "illuminance": found.illuminance(),
        "illuminance_error": found.illuminance_errors(),
        "irradiance": found.values,
        "irradiance_error": found.standard_errors,
    }
    if measured.at.grid is None:
        points_with_values(measured.at.points, data).save(path)
    else:
        _facets(measured).to_vtk(data).save(path)


def save_glb(path: Path, measured: Measured) -> None:
    """Write the scene with the cells of a grid in false colours, as .glb. Raises ImageError and SceneError.

    Warns of scene features that glTF lacks.
    """
    for note in write_gltf(measured.scene, path, facets=_facets(measured)):
        warn(f"{path}: {note}.", late=True)


def _facets(measured: Measured) -> Facets:
    grid = measured.at.grid
    assert grid is not None, "asked for before"
    corners = cells(grid.extent, grid.shape, (*grid.across, grid.axis), grid.height)
    return Facets(corners, measured.quantity.lower(), measured.values, measured.unit)
