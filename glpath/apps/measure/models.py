"""Models of measured grids: cells in false colours as .glb for viewers and .vtp for ParaView."""

from __future__ import annotations

from pathlib import Path

from glpath.apps.measure.measured import Measured
from glpath.errors import warn
from glpath.io.export.false_colours import Facets, cells
from glpath.io.export.gltf import write_gltf
from glpath.io.vtk import points_with_values


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
