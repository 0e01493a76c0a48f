"""Readers of height fields (GeoTIFF, ESRI ASCII grid, numpy) and of point clouds (LAS and LAZ)."""

from __future__ import annotations

import codecs
import math
import os
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.terrain.height_field import HeightField
from glpath.errors import GlpathError, SceneError, warn, warning_filter
from glpath.system.arguments import check_array, checked
from glpath.system.bounded_reading import reading_file, without_bounds
from glpath.system.files import absence_of, absolute_path, check_file, open_file, read_bytes, reading, reason_of
from glpath.system.npz import check_unfolded, open_npz, read_npy
from glpath.system.numerals import real
from glpath.system.vectors import LARGEST

Float64 = NDArray[np.float64]

#: Suffixes of files with height fields.
FIELD_SUFFIXES = (".tif", ".tiff", ".asc", ".npy", ".npz")
#: Suffixes of files with point clouds.
CLOUD_SUFFIXES = (".las", ".laz")

# Suffixes of world files, which hold the georeference of a TIFF [ESRI].
_WORLD_FILES = (".tfw", ".tifw", ".wld")
# Maximum size of a world file, or of a .prj file, bytes.
_MAX_BESIDE_BYTES = 4096
# Text in a .prj file of longitudes and latitudes: WKT, or ARC/INFO's older lines.
_IN_DEGREES = re.compile(
    rb'\A\s*(COMPD_CS\["[^"]*",\s*)?GEOG(CS|CRS|RAPHIC)|^\s*(Projection\s+GEOGRAPHIC|Units\s+(DD|DS|DMS)\b)',
    re.IGNORECASE | re.MULTILINE,
)
_IN_METRES = re.compile(
    rb"\A\s*(COMPD_CS\[.*)?(PROJ(CS|CRS)|LOCAL_CS|ENGCRS)|^\s*Units\s+(METERS?|METRES?|FEET)\b",
    re.IGNORECASE | re.MULTILINE,
)
# Maximum distance of samples in degrees: a grid of the world by tenths of a degree.
_MAX_DEGREES = 0.1
# Radius of the earth at the equator, metres.
_EARTH_RADIUS = 6_378_137.0
# Maximum difference from 1 of the ratio of map to ground. Web Mercator reaches it at a latitude of 18 degrees.
_MAX_STRETCH = 0.05
_PROJECT = "Project it: gdalwarp -t_srs EPSG:... (UTM: EPSG:326ZZ in the north, 327ZZ in the south)."
# Maximum size of an ASCII grid whose heights are counted even if they cannot be as many as its header says, bytes.
_COUNTED_BYTES = 1 << 20
# Maximum number of images in a TIFF that has a mask: the height field, its mask and all overviews.
_MAX_DIRECTORIES = 64

# Memory in bytes of a sample while a height field is checked, and of a point of a point cloud while it is read.
_DECODED_SAMPLE, _DECODED_POINT = 12, 48

# LASzip: number of layers of each type of item that is stored in layers. BYTE14 has one for each of its bytes.
_LAZ_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_LAZ_BYTE14 = 14
# Number of the LAS record that describes the compression.
_LAZ_RECORD = 22204
_LAS_FORMAT = 0x3F
# Highest LAS point format that exists.
_LAS_HIGHEST_FORMAT = 10
# Size of a LAS header before version 1.4, bytes.
_LAS_HEADER = 227
# Size of a LAS header since version 1.4, bytes.
_LAS_HEADER_1_4 = 375
# Size of the smallest LAS record, bytes.
_LAS_RECORD = 54
# Size of the header of a record behind the points, bytes.
_LAS_RECORD_EXTENDED = 60
# Bit of the LAS point format that is set if points are compressed.
_LAS_COMPRESSED = 0x80

# Length in metres of each unit of heights, by the unit's names in GDAL, PROJ and EPSG.
_METRES = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters"), 0.01),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), 0.3048),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "foot_us", "us_survey_foot"), 1200 / 3937),
}

_HOW_NPZ = "np.savez(path, heights=..., spacing=(dx, dy), origin=(x, y))"

AnyField = HeightField | str | Path | ArrayLike


@checked
def load_height_field(
    source: AnyField,
    *,
    spacing: float | tuple[float, float] | None = None,
    origin: tuple[float, float] | None = None,
    holes: bool = False,
) -> HeightField:
    """Read a height field from a file or an array.

    Parameters
    ----------
    source  : .tif (needs the extra `terrain`), .asc (ESRI ASCII grid), .npy, .npz (`heights`, and optionally
              `spacing`, `origin` and `mask`), or an array (R, C) with row 0 in the north
    spacing : distance between samples, or between columns and between rows, in the unit of the heights; only for an
              array or .npy; default 1. A `HeightField` and other files have their own
    origin  : x and y of the north-western sample; only for an array or .npy
    holes   : True if heights may be missing: NaN, masked, or equal to the file's no-data value. Holes cast no
              shadow

    A value of a raster is the height at the centre of its pixel. Memory limits the size of a field: 4 bytes per
    sample. Raises SceneError for invalid sources.
    """
    if isinstance(source, HeightField):
        _refuse_georeference(source.source, spacing, origin)
        return source
    at_corner = (0.0, 0.0) if origin is None else origin
    if not isinstance(source, str | Path):
        return HeightField.of(source, 1.0 if spacing is None else spacing, at_corner, holes=holes)
    path = Path(source)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise SceneError(
            f"{path}: is no height field that can be read.",
            f"Files end in {', '.join(FIELD_SUFFIXES)}. gdal_translate makes a .tif of others.",
        )
    given: dict[str, Any] = {"holes": holes}
    if path.suffix.lower() == ".npy":
        given.update(spacing=1.0 if spacing is None else spacing, origin=at_corner)
    else:
        _refuse_georeference(path, spacing, origin)
    with reading_file(path.name):
        return reader(path, **given)


def _refuse_georeference(source: str | Path, spacing: object, origin: object) -> None:
    """Raise SceneError if a spacing or an origin is given for a source that has its own."""
    for name, value in (("a spacing", spacing), ("an origin", origin)):
        if value is not None:
            raise SceneError(f"{source}: has {name} of its own.", f"Leave {name.split()[1]} out.")


def _npy(path: Path, **given: Any) -> HeightField:
    with _readable(path), reading(path, "a height field", "np.save(path, heights)"):
        heights = read_npy(path)
    return HeightField.of(heights, source=str(path), **given)


def _npz(path: Path, holes: bool) -> HeightField:
    with _readable(path), open_npz(path, "a height field", _HOW_NPZ) as arrays:
        heights = arrays.read("heights", "fiu", (None, None), decoded_bytes=_DECODED_SAMPLE)
        mask = arrays.read("mask", "b", (None, None)) if "mask" in arrays else None
        apart, origin = (
            np.ravel(arrays.read(name, "fiu", max_values=2)).astype(float).tolist() if name in arrays else usual
            for name, usual in (("spacing", [1.0]), ("origin", [0.0, 0.0]))
        )
    spacing = apart[0] if len(apart) == 1 else tuple(apart)
    return HeightField.of(heights, spacing, tuple(origin), mask=mask, holes=holes, source=str(path))


def _ascii_grid(path: Path, holes: bool) -> HeightField:
    """Read an ESRI ASCII grid: header lines of a name and a number, then rows from north to south."""
    with _readable(path):
        content = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    header: dict[str, float] = {}
    position = 0
    for match in re.finditer(rb"[ \t]*([A-Za-z]\w*)[ \t]+(\S+)[ \t]*\r?\n", content[:4096]):
        if match.start() != position:
            break
        position = match.end()
        try:
            header[match[1].decode().lower()] = real(match[2].decode())
        except ValueError:
            found = f"{match[1].decode()} is {_text(match[2])}"
            raise SceneError(f"{path}: {found} where a number is needed.") from None
    for name in ("ncols", "nrows"):
        if not header.get(name, 0) >= 1:
            raise SceneError(f"{path}: is no ESRI ASCII grid: it has no {name}.")
        if not header[name].is_integer():
            raise SceneError(f"{path}: {name} is {header[name]:g} where a whole number is needed.")
    columns, rows = int(header["ncols"]), int(header["nrows"])
    apart = (header.get("dx", header.get("cellsize", 0.0)), header.get("dy", header.get("cellsize", 0.0)))
    count = columns * rows
    # Each height has a digit, and a blank before the next. Those of a small file are counted below.
    if len(content) > _COUNTED_BYTES and 2 * count - 1 > len(content) - position:
        raise SceneError(
            f"{path}: {rows} x {columns} heights are announced, which do not fit in {len(content):,} bytes."
        )
    words = content[position:].split(None, min(count, len(content)))
    if len(words) > count:
        raise SceneError(f"{path}: has more than {count:,} heights where {rows} x {columns} are announced.")
    try:
        if b"_" in content[position:]:
            raise ValueError
        with np.errstate(over="ignore"):  # `HeightField.of` says which height is infinite
            values = np.array(words, np.float32)
    except ValueError:
        wrong = next(filter(_is_no_number, words), b"")
        raise SceneError(f"{path}: has a height that is no number: {_text(wrong)}.") from None
    if len(values) != rows * columns:
        raise SceneError(f"{path}: has {len(values):,} heights where {rows} x {columns} are announced.")
    with np.errstate(over="ignore"):  # float32 of the lowest float64 is -inf, for heights and for this
        no_data = np.float32(header.get("nodata_value", -9999.0))
    west = header.get("xllcenter", header.get("xllcorner", 0.0) + 0.5 * apart[0])
    south = header.get("yllcenter", header.get("yllcorner", 0.0) + 0.5 * apart[1])
    if "xllcenter" in header and "yllcenter" not in header:
        raise SceneError(f"{path}: has xllcenter, but no yllcenter.")
    heights = values.reshape(rows, columns)
    north = south + (rows - 1) * apart[1]
    field = HeightField.of(heights, apart, (west, north), mask=heights != no_data, holes=holes, source=str(path))
    in_degrees = in_metres = False
    if (beside := _file_beside(path, (".prj",))) is not None:
        # A file that cannot be read counts as absent, and so does a link that leads out of the folder.
        with suppress(OSError, SceneError):
            _check_beside(beside, path)
            projection = read_bytes(beside, _MAX_BESIDE_BYTES).removeprefix(codecs.BOM_UTF8)
            in_degrees = _IN_DEGREES.search(projection) is not None
            in_metres = _IN_METRES.search(projection) is not None
    if in_degrees:
        raise _degrees(path)
    if not in_metres:
        _warn_of_degrees(field)
    return field


def _degrees(path: Path) -> SceneError:
    return SceneError(
        f"{path}: is in degrees of longitude and latitude, its heights are not.",
        _PROJECT,
    )


def _warn_of_degrees(field: HeightField) -> None:
    """Warn if x and y of a field without a known coordinate system look like longitudes and latitudes.

    Their samples are close, and heights in metres then differ by more than the width of the field in degrees.
    """
    x, y = field.coordinates()
    if max(field.spacing) > _MAX_DEGREES or np.abs(x).max() > 360 or np.abs(y).max() > 90:
        return
    if np.nanmax(field.heights) - np.nanmin(field.heights) > max(np.ptp(x), np.ptp(y)):
        warn(
            f"{field.source}: its x and y may be degrees of longitude and latitude: samples are "
            f"{field.spacing[0]:.3g} apart. They are taken to be in the unit of the heights."
        )


def _warn_of_scale(field: HeightField, crs: Any) -> None:
    """Warn if the map is a Mercator projection that stretches the ground at the centre of the field.

    Source: Snyder 1987, Map projections, equations 7-2 and 7-3.
    """
    try:
        system = crs.to_dict()
        if system.get("proj") != "merc":
            return
        at_equator = system.get("k", 1.0) * math.cos(math.radians(system.get("lat_ts", 0.0)))
        north = float(field.coordinates()[1].mean()) * crs.linear_units_factor[1] - system.get("y_0", 0.0)
        stretch = at_equator * math.cosh(north / (at_equator * _EARTH_RADIUS))
    except (ArithmeticError, TypeError, ValueError):  # parameters of a damaged file
        return
    if abs(stretch - 1) > _MAX_STRETCH:
        warn(
            f"{field.source}: is in a Mercator projection, which is here {stretch:.3g} times as large as the "
            f"ground. Its heights are not, so slopes are wrong. {_PROJECT}"
        )


def _is_no_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return True
    return b"_" in word


def _text(word: bytes) -> str:
    """Return a word of a file, quoted and shortened, for a message."""
    return f'"{word[:40].decode(errors="backslashreplace")}"'


def _geotiff(path: Path, holes: bool) -> HeightField:
    rasterio = package_for("rasterio", "this file is read")
    with _readable(path):
        with _opened_tiff(path, rasterio) as raster:
            check_unfolded(
                4 * raster.width * raster.height,
                path.stat().st_size,
                _DECODED_SAMPLE * raster.width * raster.height,
            )
            if raster.count != 1:
                raise SceneError(
                    f"{path}: has {raster.count} bands where one of heights is needed.",
                    "gdal_translate -b 1 takes the first.",
                )
            t, crs = _transform(path, raster), raster.crs
            if t.is_identity:
                raise SceneError(
                    f"{path}: has no geotransform, so that its spacing is not known.",
                    "Give the array: load_height_field(heights, spacing=...).",
                )
            if t.b or t.d:
                raise SceneError(
                    f"{path}: is rotated: its geotransform has the terms {t.b:g} and {t.d:g}.",
                    "gdalwarp turns it to the north.",
                )
            if crs is not None and crs.is_geographic:
                raise _degrees(path)
            if t.a <= 0 or t.e >= 0:
                raise SceneError(
                    f"{path}: has pixels of {t.a:g} x {t.e:g}, but columns must go east and rows south.",
                    "gdalwarp turns it.",
                )
            heights = _heights(path, raster)
            wkt = crs.to_wkt() if crs is not None else ""
        beside = path.with_name(f"{path.name}.msk")
        if os.path.isfile(beside):
            _check_beside(beside, path)
            with _opened_tiff(beside, rasterio) as raster:
                if (raster.count, raster.shape) != (1, heights.shape):
                    found = f"{raster.count} bands of {raster.width:,} x {raster.height:,}"
                    raise SceneError(f"{beside}: is no mask of {path.name}: it has {found} pixels.", "Remove it.")
                heights = np.ma.masked_where(raster.read(1) == 0, heights)
    field = HeightField.of(
        heights, (t.a, -t.e), (t.c + 0.5 * t.a, t.f + 0.5 * t.e), holes=holes, source=str(path), crs=wkt
    )
    if crs is None:
        _warn_of_degrees(field)
    else:
        _warn_of_scale(field, crs)
    return field


@contextmanager
def _opened_tiff(path: Path, rasterio: Any) -> Iterator[Any]:
    """Open a TIFF with rasterio. Raises SceneError.

    GDAL supports a hundred formats, and some refer to other files and addresses. It would accept any of them for
    this file, whatever its suffix, and for files beside it. Therefore only TIFF is allowed, and GDAL sees no other
    file.
    """
    check_file(path)
    try:
        with rasterio.Env(GDAL_PAM_ENABLED="NO", GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR"):
            with warning_filter("ignore"):  # about a missing georeference, which `_geotiff` reports as an error
                opened = rasterio.open(absolute_path(path), driver="GTiff")
            with opened as raster:
                if raster.dtypes[0].startswith("complex"):
                    raise SceneError(
                        f"{path}: has values of the type {raster.dtypes[0]} where real numbers are needed.",
                        "gdal_translate -ot Float32 takes the real parts.",
                    )
                (rows, columns), width = raster.block_shapes[0], np.dtype(raster.dtypes[0]).itemsize
                samples = raster.width * raster.height * raster.count
                check_unfolded(max(4 * samples, width * rows * columns), path.stat().st_size)
                if rasterio.enums.MaskFlags.per_dataset in raster.mask_flag_enums[0]:
                    _check_directories(path, rasterio)
                yield raster
    except (rasterio.errors.RasterioError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read as a TIFF: {reason_of(error)}.") from error


def _check_directories(path: Path, rasterio: Any) -> None:
    """Raise ValueError if a block of an image after the first in a TIFF, such as a mask, takes too much memory."""
    for number in range(1, _MAX_DIRECTORIES):
        try:
            with warning_filter("ignore"):
                opened = rasterio.open(f"GTIFF_DIR:{number}:{absolute_path(path)}", driver="GTiff")
        except rasterio.errors.RasterioIOError:
            return  # there is no further image
        with opened as raster:
            rows, columns = raster.block_shapes[0]
            check_unfolded(rows * columns * np.dtype(raster.dtypes[0]).itemsize, path.stat().st_size)
    raise ValueError(f"it has {_MAX_DIRECTORIES:,} images or more")


def _transform(path: Path, raster: Any) -> Any:
    """Return the geotransform of a TIFF, or that of a world file beside it."""
    if not raster.transform.is_identity:
        return raster.transform
    beside = _file_beside(path, _WORLD_FILES)
    if beside is None:
        return raster.transform
    _check_beside(beside, path)
    try:
        a, d, b, e, x, y = map(real, read_bytes(beside, _MAX_BESIDE_BYTES).decode().split())
    except ValueError:  # dropped, because its text would contain contents of the file
        raise SceneError(f"{beside}: is no world file of six numbers.", "Remove it, or write it anew.") from None
    return type(raster.transform)(a, b, x - 0.5 * (a + b), d, e, y - 0.5 * (d + e))


def _check_beside(beside: Path, path: Path) -> None:
    """Raise SceneError if a file beside a height field is a link that leads out of the folder of the field."""
    folders = {path.parent.resolve(), path.resolve().parent}
    if beside.resolve().parent not in folders:
        raise SceneError(
            f"{beside}: is a link to a file outside the folder of {path.name}.", "Copy the file there."
        )


def _file_beside(path: Path, suffixes: tuple[str, ...]) -> Path | None:
    """Return the file of the same name with one of the suffixes, in any letter case; None if there is none."""
    exact = [path.with_suffix(each) for each in suffixes]
    listed: list[Path] = []
    with suppress(OSError):  # a folder that may be entered but not listed
        listed = sorted(path.parent.iterdir())
    files = {each.name.casefold(): each for each in (*listed, *exact) if os.path.isfile(each)}
    return next((files[name] for each in exact if (name := each.name.casefold()) in files), None)


def _heights(path: Path, raster: Any) -> Any:
    """Return the masked (R, C) heights of a TIFF in the unit of its x and y, with its scale and offset."""
    scale, offset = raster.scales[0], raster.offsets[0]
    factor = _height_unit(path, raster)
    if (scale * factor, offset) == (1.0, 0.0):
        return raster.read(1, masked=True, out_dtype="float32")
    return (raster.read(1, masked=True, out_dtype="float64") * scale + offset) * factor


def _height_unit(path: Path, raster: Any) -> float:
    """Return the factor that converts a TIFF's heights to the unit of its x and y.

    Heights without a unit, or with an unknown unit, are taken to be in the unit of x and y. A warning is printed
    for an unknown unit, and for a missing unit if x and y are not in metres.
    """
    crs, unit = raster.crs, raster.units[0]
    if crs is None or not crs.is_projected:
        return 1.0
    name, metres = crs.linear_units_factor
    known = _METRES.get((unit or "").strip().lower())
    if known is not None:
        return 1.0 if math.isclose(known, metres) else known / metres
    if unit:
        warn(f'{path}: its heights are in "{unit[:40]}", a unit that is not known. They are taken to be in {name}.')
    elif abs(metres - 1.0) > 1e-9:
        warn(f"{path}: x and y are in {name}. Its heights are taken to be so, too.")
    return 1.0


@checked
def load_point_cloud(path: str | Path, classes: Sequence[int] | NDArray[np.integer[Any]] = ()) -> Float64:
    """Return points (N, 3) of a LAS or LAZ file, in its units; needs the extra `terrain`.

    classes : ASPRS classes to read, 0 to 255, such as 2 for ground and 6 for buildings; () for all

    Raises SceneError and UsageError.
    """
    wanted = check_array("classes", classes, (None,), (0, 255), whole=True) if np.size(classes) else ()
    laspy = package_for("laspy", "this file is read")
    path = Path(path)
    with reading_file(path.name), _readable(path):
        try:
            with open_file(path) as file:
                _check_las(file, path.stat().st_size)
                file.seek(0)
                cloud = laspy.read(file, laz_backend=laspy.LazBackend.Lazrs)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # laspy and lazrs raise any type; a Rust panic is not an Exception
            raise SceneError(f"{path}: cannot be read: {reason_of(error)}.") from error
    with np.errstate(over="ignore", invalid="ignore"):
        points = np.stack([np.asarray(cloud[axis], np.float64) for axis in ("x", "y", "z")], axis=1)
    if not (np.abs(points) <= LARGEST).all():
        raise SceneError(f"{path}: has a point that is not finite, or beyond {LARGEST:g}.")
    if len(wanted):
        found = np.asarray(cloud.classification)
        points = points[np.isin(found, wanted)]
        if not len(points):
            there = ", ".join(map(str, np.unique(found).tolist()))
            raise SceneError(f"{path}: has no point of the classes {', '.join(map(str, wanted))}; it has {there}.")
    if not len(points):
        raise SceneError(f"{path}: has no point.")
    return points


def _check_las(file: BinaryIO, total: int) -> None:
    """Raise ValueError for a LAS header that announces more than the file holds; laspy would allocate it.

    Source: ASPRS, LAS 1.4-R15, table 3; Isenburg 2013, LASzip, for the table of chunks.
    """
    head = file.read(_LAS_HEADER_1_4)
    if head[:4] != b"LASF" or len(head) < _LAS_HEADER:
        raise ValueError("it is cut off, or not of this format")
    size, points_at, records, kind, length, points = struct.unpack_from("<HIIBHI", head, 94)
    form = kind & _LAS_FORMAT
    if form > _LAS_HIGHEST_FORMAT:
        raise ValueError(f"its points are of format {form}, expected 0 to {_LAS_HIGHEST_FORMAT}")
    extra = extra_at = 0
    if head[25] >= 4 and len(head) == _LAS_HEADER_1_4:
        extra_at, extra, points = struct.unpack_from("<QIQ", head, 235)
    if size + _LAS_RECORD * records > points_at or points_at > total:
        raise ValueError(f"{records:,} records of its header do not fit before its points")
    if _LAS_RECORD * extra > total:
        raise ValueError(f"{extra:,} records behind its points do not fit in {total:,} bytes")
    for number in range(extra):
        file.seek(extra_at)
        record = file.read(_LAS_RECORD_EXTENDED)
        extra_at += _LAS_RECORD_EXTENDED + int.from_bytes(record[20:28], "little")
        if extra_at > total:
            raise ValueError(f"record {number} behind its points is not in the file")
    stored = total - points_at
    if kind & _LAS_COMPRESSED:
        check_unfolded(points * length, stored, points * (length + _DECODED_POINT))
        file.seek(points_at)
        (table_at,) = struct.unpack("<q", file.read(8))
        if table_at == -1:  # a file that was written into a pipe has the offset at its end
            file.seek(total - 8)
            (table_at,) = struct.unpack("<q", file.read(8))
        if not points_at <= table_at <= total - 8:
            raise ValueError(f"its table of chunks is at byte {table_at:,} of {total:,}")
        file.seek(table_at)
        _, chunks = struct.unpack("<II", file.read(8))
        if chunks > stored:
            raise ValueError(f"{chunks:,} chunks do not fit in {total:,} bytes")
        file.seek(size)
        record = _laszip_record(file.read(points_at - size), records)
        chunk_size, item_count = struct.unpack_from("<12xI16xH", record)
        if chunks * chunk_size < points:
            raise ValueError(f"{points:,} points do not fit in {chunks:,} chunks of {chunk_size:,}")
        items = np.frombuffer(record, "<u2", 3 * item_count, 34).reshape(-1, 3).tolist()  # type, size, version
        layers = sum(width if item == _LAZ_BYTE14 else _LAZ_LAYERS.get(item, 0) for item, width, _ in items)
        # A chunk of layers has its first point, its point count, then its layers' sizes, then the layers.
        at, head = points_at + 8, sum(width for _, width, _ in items) + 4
        for chunk in range(chunks if layers else 0):
            file.seek(at + head)
            layer_bytes = int(np.frombuffer(file.read(4 * layers), "<u4").sum(dtype=np.int64))
            at += head + 4 * layers + layer_bytes
            if at > table_at:
                raise ValueError(f"{layer_bytes:,} bytes of its chunk {chunk} are not in it")
    elif points * length > stored:
        raise ValueError(f"{points:,} points of {length} bytes do not fit in {total:,} bytes")


def _laszip_record(content: bytes, records: int) -> bytes:
    """Return the data of the LASzip record among the records of a LAS header. Raises ValueError if none exists."""
    at = 0
    for _ in range(records):
        user, number, length = struct.unpack_from("<2x16sHH", content, at)
        at += _LAS_RECORD + length
        if user.split(b"\0")[0] == b"laszip encoded" and number == _LAZ_RECORD:
            return content[at - length : at]
    raise ValueError("it has no record of LASzip")


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        if not os.path.isfile(path):
            raise SceneError(f"{path}: {absence_of(path, 'no such file')}.")
        yield
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {reason_of(error)}.") from error


def package_for(name: str, use: str) -> Any:
    """Import a module of the extra `terrain`. Raises GlpathError with the install command if it is missing."""
    try:
        with without_bounds():
            module = import_module(name)
            import_module(f"{name}.errors")
    except ImportError as error:
        raise GlpathError(
            f"{name} cannot be imported ({error}); {use} by it.", 'pip install "glpath[terrain]"'
        ) from error
    return module


_READERS: dict[str, Callable[..., HeightField]] = {
    ".tif": _geotiff,
    ".tiff": _geotiff,
    ".asc": _ascii_grid,
    ".npy": _npy,
    ".npz": _npz,
}
