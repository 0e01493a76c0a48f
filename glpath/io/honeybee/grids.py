"""Sensor grids of an HBJSON file, for measurements."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from glpath.io.honeybee.model import read_model_file
from glpath.scene.geometry import Float64
from glpath.scene.source_location import SourceLocation
from glpath.system.arguments import checked
from glpath.system.suggestions import listed_names


@checked
def sensor_points(path: str | Path, grid: str | None = None) -> tuple[Float64, Float64]:
    """Return the positions (N, 3) and directions (N, 3) of a file's sensors, in the units of the file.

    grid : identifier or display name of one grid; None for all grids in sequence

    Raises SceneError if the file has no such grid, or no grid at all.
    """
    grids = read_model_file(Path(path)).radiance.sensor_grids or []
    location = SourceLocation(str(path))
    if not grids:
        raise location.error("has no sensor grids.", "Lay a grid in a plane, or name points of your own.")
    chosen = [each for each in grids if grid is None or grid in (each.identifier, each.display_name)]
    if not chosen:
        names = listed_names(each.identifier for each in grids)
        raise location.error(f'has no sensor grid "{grid}". It has: {names}.', "Write FILE.hbjson#GRID.")
    sensors = [sensor for each in chosen for sensor in each.sensors]
    table = np.array([(*sensor.pos, *sensor.dir) for sensor in sensors], np.float64).reshape(-1, 6)
    if not len(table):
        raise location.error(f'has no sensors in "{chosen[0].identifier}".')
    dark = np.flatnonzero(~table[:, 3:].any(axis=1))
    if len(dark):
        raise location.error(f"sensor {dark[0]} has the direction 0, 0, 0, which looks nowhere.")
    return table[:, :3], table[:, 3:]
