"""Writer of results of `glpath.apps.terrain.horizon`."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.terrain.height_field import HeightField
from glpath.apps.terrain.reading import package_for
from glpath.errors import ImageError, UsageError, warn, warning_filter
from glpath.system.files import reason_of, whole_file, write_bytes

#: Suffixes of files with results at samples.
MAP_SUFFIXES = (".tif", ".tiff", ".npy", ".npz")
#: Suffixes of files with results at points.
POINT_SUFFIXES = (".csv", ".npy", ".npz")


def check_kind(path: str | Path, of_points: bool, more: tuple[str, ...] = ()) -> None:
    """Raise ImageError for a suffix that `save` does not support.

    more : further suffixes that the caller writes
    """
    allowed = (*(POINT_SUFFIXES if of_points else MAP_SUFFIXES), *more)
    if Path(path).suffix.lower() not in allowed:
        what = "points" if of_points else "a height field"
        raise ImageError(f"{path}: cannot be written.", f"Results of {what} end in {', '.join(allowed)}.")


def save(path: str | Path, field: HeightField, points: NDArray[np.float64] | None, values: NDArray[Any]) -> None:
    """Write values at the field's samples, or at points (N, 3), in the format of the path's suffix.

    .tif : float32 raster with the field's georeference; NaN means no data
    .npy : only the values
    .npz : `values`, with `x` (C,) and `y` (R,) for samples, or `points` (N, 3)
    .csv : columns x, y, z, value, for points

    Raises UsageError for values of another shape, ImageError for another suffix.
    """
    path = Path(path)
    shape = field.shape if points is None else (len(points),)
    if values.shape != shape:
        raise UsageError(f"{path}: values of shape {values.shape} where {shape} are results.")
    check_kind(path, points is not None)
    kind = path.suffix.lower()
    if kind == ".csv":
        assert points is not None, "checked"
        text = io.StringIO()
        text.write("x,y,z,value\n")
        np.savetxt(text, np.column_stack([points, values]), fmt=["%.15g"] * 3 + ["%.9g"], delimiter=",")
        write_bytes(text.getvalue().encode(), path)
    elif kind == ".npy":
        with whole_file(path) as part, part.open("wb") as file:
            np.save(file, values)
    elif kind == ".npz":
        x, y = field.coordinates()
        at: dict[str, Any] = {"x": x, "y": y} if points is None else {"points": points}
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(file, values=values, **at)
    else:
        _save_geotiff(path, field, values)


def _save_geotiff(path: Path, field: HeightField, values: NDArray[Any]) -> None:
    rasterio = package_for("rasterio", "this file is written")
    (dx, dy), (x, y) = field.spacing, field.origin
    made = {
        "driver": "GTiff",
        "height": field.shape[0],
        "width": field.shape[1],
        "count": 1,
        "dtype": "float32",
        "nodata": float("nan"),
        "transform": rasterio.Affine(dx, 0.0, x - 0.5 * dx, 0.0, -dy, y + 0.5 * dy),
        "crs": field.crs or None,
        "compress": "deflate",
        "predictor": 3,
    }
    # GDAL opens the file by its name; it cannot write to an open file. Without PAM, it writes no file beside it.
    with whole_file(path) as part, rasterio.Env(GDAL_PAM_ENABLED="NO"):
        try:
            with rasterio.open(part, "w", **made) as raster:
                raster.write(values.astype(np.float32), 1)
            not_georeferenced = rasterio.errors.NotGeoreferencedWarning
            with warning_filter("ignore", not_georeferenced), rasterio.open(part) as raster:
                is_whole = not field.crs or raster.crs == rasterio.crs.CRS.from_user_input(field.crs)
        except (rasterio.errors.RasterioError, ValueError) as error:  # CRSError is a ValueError
            raise ImageError(f"{path}: cannot be written: {reason_of(error)}.") from error
    if not is_whole:
        name = (re.findall('"(.*?)"', field.crs) or [field.crs])[0]
        warn(f'{path}: a GeoTIFF cannot store its coordinate reference system "{name}": set it by hand.', late=True)
