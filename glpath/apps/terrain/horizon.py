"""Horizons of terrain: sky view factors, sun hours and direct irradiation at height field samples or points.

Cost:     Sky view factors of samples: a sweep for each azimuth, 0.2 microseconds per sample on one core. Sky view
          factors of points: a ray for each azimuth, a microsecond. Sun hours: a ray for each sun, less than a
          microsecond.
Memory:   4 bytes per sample for the field, 12 more during a sweep, 12 for normals of its own surface.
Poor at:  overhangs, such as bridges, balconies and tree crowns, which need meshes and `glpath.irradiance`.
Source:   Dozier & Frew 1990; see `glpath.apps.terrain.sweep` and `glpath.apps.terrain.pyramid`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.terrain.height_field import HeightField
from glpath.apps.terrain.pyramid import add_suns, pyramid_of, tangents_at
from glpath.apps.terrain.reading import AnyField, load_height_field
from glpath.apps.terrain.sweep import horizon_tangents, lattice_directions
from glpath.errors import UsageError, warn
from glpath.system.arguments import check_array, checked, checked_fields, real_array, short_repr
from glpath.system.frames import data_set
from glpath.system.kernels import kernel
from glpath.system.machine import core_count
from glpath.system.reporting import ProgressEvent
from glpath.system.vectors import LARGEST, unit_normals

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Report = Callable[[ProgressEvent], None]

#: Default number of azimuths for sky view factors.
AZIMUTHS = 64
#: Maximum number of points whose rays a thread traces in one task.
_CHUNK = 1 << 13
#: Maximum number of rays of a task, which then takes about a second. A task has at least `_MIN_CHUNK` points.
_CHUNK_RAYS = 1 << 19
_MIN_CHUNK = 64
#: Number of samples that a thread sums in one task.
_PART = 1 << 18
#: Maximum length of a normal. Rounding may make a unit normal slightly longer or shorter than 1.
_UNIT = 1.001


@checked
@checked_fields
@dataclass(frozen=True, eq=False)
class Horizon:
    """Receivers on or over a height field, with methods for the visible part of sky and sun.

    field    : terrain
    points   : (N, 3) float64, x, y, z of the receivers; None: the samples of the field
    normals  : (N, 3) or (1, 3) float32, unit; if `points` is None, (R * C, 3) or (1, 3)
    azimuths : number of azimuths for sky view factors
    height   : height of receivers at samples above the surface
    report   : function that gets a `ProgressEvent` at intervals

    Results are arrays (R, C) for samples, (N,) for points; NaN in holes and at points below ground.

    Raises UsageError for arrays of other shapes, and for values out of range.
    """

    field: HeightField
    points: Float64 | None
    normals: Float32
    azimuths: int = AZIMUTHS
    height: float = 0.0
    report: Report | None = None

    def __post_init__(self) -> None:
        _check_settings(self.azimuths, self.height)
        if self.points is None:
            count = math.prod(self.field.shape)
        else:
            points = check_array("points", self.points, (None, 3), (-LARGEST, LARGEST), may_lack=True)
            if np.isnan(points[:, :2]).any():
                first = int(np.flatnonzero(np.isnan(points[:, :2]).any(axis=1))[0])
                raise UsageError(
                    f"points[{first}]: {points[first].tolist()} where finite x and y are needed",
                    "Only z may be NaN, of points below ground.",
                )
            object.__setattr__(self, "points", points)
            count = len(points)
        rows = 1 if np.shape(self.normals)[:1] == (1,) else count
        normals = check_array("normals", self.normals, (rows, 3), (-_UNIT, _UNIT)).astype(np.float32)
        wrong = ~(np.abs(np.linalg.norm(normals, axis=1) - 1) <= _UNIT - 1)
        if wrong.any():
            first = int(np.flatnonzero(wrong)[0])
            raise UsageError(
                f"normals[{first}]: {normals[first].tolist()} where a vector of length 1 is needed",
                "Divide each normal by its length, or call glpath.horizon.",
            )
        object.__setattr__(self, "normals", normals)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the results."""
        return self.field.shape if self.points is None else (len(self.points),)

    def angles(self, azimuth: float) -> Float32:
        """Return the elevation of the horizon, degrees, in an azimuth in degrees clockwise from north.

        It is 0 if no terrain is higher. The result is exact for the field's triangles.
        """
        if not math.isfinite(azimuth):
            raise UsageError(f"azimuth: {azimuth} where a finite number of degrees is needed")
        found = np.zeros(math.prod(self.shape), np.float32)
        gradient = self._gradient(math.radians(azimuth))

        def find(begin: int, end: int) -> None:
            receivers = self._on_grid(begin, end)
            tangents_at(self.field.heights, *self._pyramid, receivers, gradient, found[begin:end])

        self._in_parts(find, _CHUNK, "horizon angles")
        return np.asarray(self._shaped(np.degrees(np.arctan(found))))

    def sky_view_factor(self) -> Float32:
        """Return the fraction of a uniform sky's light that arrives, 0 to 1, weighted by the cosine to the normal.

        An open horizontal surface has 1. A surface tilted by s in an open plane has (1 + cos s) / 2, because light
        from the ground does not count.
        """
        sums = np.zeros(math.prod(self.shape), np.float32)
        if self.points is None and not self.height:
            self._sweep_sky(sums)
        else:
            self._cast_sky(sums)
        return np.asarray(self._shaped(sums))

    def sun_hours(self, azimuth: ArrayLike, altitude: ArrayLike, hours: ArrayLike = 1.0) -> Float64:
        """Return the hours of sun on the receivers' fronts: the sum of the hours of the visible suns.

        azimuth, altitude : (S,) degrees clockwise from north and above the horizontal; suns with altitude 0 or less
                            do not count
        hours             : (S,) hours of each sun, or one value for all

        The sun is the centre of its disc. The result is exact for the field's triangles. Suns of the same azimuth
        share one ray.
        """
        return np.asarray(self._shaped(self._sums(azimuth, altitude, hours, "hours")[:, 0]), np.float64)

    def direct_irradiation(self, azimuth: ArrayLike, altitude: ArrayLike, energy: ArrayLike) -> Float64:
        """Return the direct sunlight on the receivers, in the unit of `energy`, weighted by the cosine.

        azimuth, altitude : arrays (S,) as in `sun_hours`
        energy            : (S,) energy on a surface that faces the sun, such as hours times W m^-2
        """
        return np.asarray(self._shaped(self._sums(azimuth, altitude, energy, "energy")[:, 1]), np.float64)

    def to_xarray(self, **values: Any) -> Any:
        """Return an `xarray.Dataset` of results by name, with coordinates x and y, and z for points.

        Raises GlpathError if xarray is missing, UsageError for another shape.
        """
        for name, each in values.items():
            if _shape_of(each) != self.shape:
                raise UsageError(f"to_xarray: {name} is of shape {_shape_of(each)}, results are of {self.shape}.")
        attributes = {"crs": self.field.crs, "source": self.field.source}
        if self.points is None:
            x, y = self.field.coordinates()
            return data_set({k: (("y", "x"), v) for k, v in values.items()}, {"x": x, "y": y}, attributes)
        at = {axis: ("point", self.points[:, i]) for i, axis in enumerate("xyz")}
        return data_set({name: ("point", each) for name, each in values.items()}, at, attributes)

    def save(self, path: str | Path, values: ArrayLike) -> None:
        """Write a result as .tif with the field's georeference, .npy, .npz, or .csv for points; see the guide."""
        from glpath.apps.terrain.saving import save

        save(path, self.field, self.points, np.asarray(values))

    @cached_property
    def _pyramid(self) -> tuple[Float32, NDArray[np.int64]]:
        return pyramid_of(self.field.heights)

    def _gradient(self, azimuth: float) -> tuple[float, float]:
        """Return the columns and rows that a ray in this azimuth crosses per unit of distance; rows count south."""
        return _along(math.sin(azimuth)) / self.field.spacing[0], -_along(math.cos(azimuth)) / self.field.spacing[1]

    def _on_grid(self, begin: int, end: int) -> Float64:
        """Return column, row and height (n, 3) of the receivers `begin` to `end`; missing heights count as 0."""
        found = np.empty((end - begin, 3))
        if self.points is None:
            row, column = np.divmod(np.arange(begin, end), self.field.shape[1])
            found[:, 0], found[:, 1] = column, row
            found[:, 2] = self.field.heights.reshape(-1)[begin:end]
            found[:, 2] += self.height
        else:
            found[:, :2] = self.field.grid_positions(self.points[begin:end])
            found[:, 2] = self.points[begin:end, 2]
        return np.nan_to_num(found, copy=False)

    def _normals_of(self, begin: int, end: int) -> Float32:
        return self.normals[begin:end] if len(self.normals) > 1 else self.normals

    def _sweep_sky(self, sums: Float32) -> None:
        directions = lattice_directions(self.azimuths, self.field.spacing)
        azimuths = np.array([each.azimuth for each in directions])
        # The width of an azimuth's sector is half the angle between its two neighbours.
        following = (np.roll(azimuths, -1) - azimuths) % (2 * np.pi)
        widths = 0.5 * (following + np.roll(following, 1))
        tangents = np.empty(self.field.shape, np.float32)
        flat = tangents.reshape(-1)
        started = time.perf_counter()
        for i, direction in enumerate(directions):
            horizon_tangents(self.field.heights, self.field.spacing, direction, tangents)
            toward, width = (math.sin(direction.azimuth), math.cos(direction.azimuth)), float(widths[i])

            def add(begin: int, end: int, toward: tuple[float, float] = toward, width: float = width) -> None:
                add_sky(flat[begin:end], self._normals_of(begin, end), toward, width, sums[begin:end])

            self._in_parts(add, _PART)
            self._tell("sky view factors", started, i + 1, len(directions))

    def _cast_sky(self, sums: Float32) -> None:
        width = 2 * math.pi / self.azimuths
        turns = [width * i for i in range(self.azimuths)]

        def add(begin: int, end: int) -> None:
            at, tangents = self._on_grid(begin, end), np.empty(end - begin, np.float32)
            for azimuth in turns:
                tangents_at(self.field.heights, *self._pyramid, at, self._gradient(azimuth), tangents)
                toward = (math.sin(azimuth), math.cos(azimuth))
                add_sky(tangents, self._normals_of(begin, end), toward, width, sums[begin:end])

        self._in_parts(add, _chunk(self.azimuths), "sky view factors")

    def _sums(self, azimuth: ArrayLike, altitude: ArrayLike, weight: ArrayLike, name: str) -> Float64:
        suns = self._suns(azimuth, altitude, weight, name)
        sums = np.zeros((math.prod(self.shape), 2))
        if not len(suns):
            return sums

        def add(begin: int, end: int) -> None:
            receivers = np.empty((end - begin, 6))
            receivers[:, :3] = self._on_grid(begin, end)
            receivers[:, 3:] = self._normals_of(begin, end) * np.array([1.0, -1.0, 1.0], np.float32)
            add_suns(self.field.heights, *self._pyramid, receivers, suns, sums[begin:end])

        self._in_parts(add, _chunk(len(suns)), "suns")
        return sums

    def _suns(self, azimuth: ArrayLike, altitude: ArrayLike, weight: ArrayLike, name: str) -> Float64:
        """Return (S, 7) suns above the horizon for `add_suns`, sorted by azimuth, then by falling altitude."""
        shape, of_altitude, of_weight = map(np.shape, (azimuth, altitude, weight))
        if len(shape) != 1 or of_altitude != shape or of_weight not in ((), shape):
            raise UsageError(
                f"suns: azimuth of shape {shape}, altitude {of_altitude} and {name} {of_weight}, where "
                "(S,) each are needed."
            )
        around, up = real_array("azimuth", azimuth), real_array("altitude", altitude)
        weights = real_array(name, weight)
        weights = np.broadcast_to(weights, around.shape)
        for what, each in (("azimuth", around), ("altitude", up), (name, weights)):
            if not np.isfinite(each).all():
                first = int(np.flatnonzero(~np.isfinite(each))[0])
                raise UsageError(f"suns: {what}[{first}] is {each[first]}, where a finite number is needed.")
        if (np.abs(up) > 90).any() or (np.abs(around) > 360).any():
            raise UsageError("suns: azimuths are -360 to 360 degrees, altitudes -90 to 90.", "Are they in radians?")
        if (weights < 0).any() or (weights > LARGEST).any():
            raise UsageError(f"suns: {name} must be from 0 to {LARGEST:g}.")
        kept = (up > 0) & (weights > 0)
        around, up, weights = np.radians(around[kept] % 360.0), np.radians(up[kept]), weights[kept]
        order = np.lexsort((-up, around))
        around, up, weights = around[order], up[order], weights[order]
        across = np.cos(up)
        return np.stack(
            [
                _along(np.sin(around)) / self.field.spacing[0],
                -_along(np.cos(around)) / self.field.spacing[1],
                np.sin(up) / np.maximum(across, 1e-9),
                across * np.sin(around),
                -across * np.cos(around),
                np.sin(up),
                weights,
            ],
            axis=1,
        )

    def _in_parts(self, work: Callable[[int, int], None], size: int, stage: str = "") -> None:
        """Call `work` for parts of the receivers, with one thread per core."""
        count, started = math.prod(self.shape), time.perf_counter()
        if stage:
            self._pyramid  # noqa: B018 # built before the threads start, otherwise each would build it
        begins = range(0, count, size)
        with ThreadPoolExecutor(core_count()) as pool:
            for done, _ in enumerate(pool.map(lambda a: work(a, min(a + size, count)), begins), start=1):
                if stage:
                    self._tell(stage, started, done, len(begins))

    def _tell(self, stage: str, started: float, done: int, total: int) -> None:
        if self.report is not None:
            values = {"done": done, "total": total}
            line = f"{stage}: {done:,} of {total:,} parts"
            self.report(ProgressEvent(stage, time.perf_counter() - started, done, total, values, line=line))

    def _shaped(self, values: Any) -> Any:
        missing = np.isnan(self.field.heights.reshape(-1) if self.points is None else self.points[:, 2])
        if missing.any():
            values[missing] = np.nan
        return values.reshape(self.shape)


def _chunk(rays: int) -> int:
    """Return the number of points of a task, if each point casts `rays` >= 1 rays."""
    return min(_CHUNK, max(_MIN_CHUNK, _CHUNK_RAYS // rays))


@checked
def horizon(
    field: AnyField,
    points: ArrayLike | None = None,
    normals: ArrayLike | Literal["surface"] | None = None,
    *,
    height: float = 0.0,
    azimuths: int = AZIMUTHS,
    spacing: float | tuple[float, float] | None = None,
    holes: bool = False,
    on_progress: Report | None = None,
) -> Horizon:
    """Return the horizons of terrain, which give sky view factors, sun hours and direct irradiation.

    Parameters
    ----------
    field       : any source of `load_height_field`: a GeoTIFF, an ESRI ASCII grid, .npy, .npz, an array (R, C)
    points      : (N, 2) x and y of receivers on the surface, or (N, 3) on or above it; None: the samples of the
                  field. Points up to half a spacing below the surface are lifted onto it; deeper points get NaN
    normals     : normals of the receivers, (3,) or (N, 3), of any nonzero length; None: upward; "surface": normals
                  of the terrain
    height      : height of receivers above the surface, for points (N, 2) and for samples
    azimuths    : number of azimuths for sky view factors, 8 to 720; on smooth terrain the error is inversely
                  proportional to the square of this number
    spacing     : distance between samples of an array or .npy, in the unit of its heights
    holes       : True if heights may be missing; holes cast no shadow
    on_progress : function called with a `glpath.system.reporting.ProgressEvent`

    x is east, y is north, z is up. Raises SceneError for the field, UsageError for the rest.

    Example
    -------
    >>> import numpy as np
    >>> wall = np.where(np.arange(200) < 100, 0.0, 1e4)        # an edge that is endless, to the east
    >>> found = horizon(np.tile(wall, (200, 1)), points=[[99.0, -100.0]])
    >>> round(float(found.sky_view_factor()[0]), 1)
    0.5
    """
    terrain = load_height_field(field, spacing=spacing, holes=holes)
    _check_settings(azimuths, height)
    at = None if points is None else _points(points, terrain, height)
    return Horizon(terrain, at, _facing(normals, terrain, at), azimuths, float(height), on_progress)


def _check_settings(azimuths: int, height: float) -> None:
    """Raise UsageError for a number of azimuths or a height out of range."""
    if not 8 <= azimuths <= 720:
        raise UsageError(f"azimuths: {short_repr(azimuths)}, but 8 to 720 are possible.")
    if not 0 <= height <= LARGEST:
        raise UsageError(
            f"height: {short_repr(height)}, but 0 to {LARGEST:g}, in the unit of the heights, is needed."
        )


def _points(points: ArrayLike, terrain: HeightField, height: float) -> Float64:
    """Return points (N, 3) on or above the surface; z is NaN for points far below it. Raises UsageError."""
    given = real_array(
        "points", points, "(N, 2) or (N, 3), N > 0,", lambda s: len(s) == 2 and s[0] > 0 and s[1] in (2, 3)
    )
    given = np.array(given)
    if not np.isfinite(given).all():
        first = int(np.flatnonzero(~np.isfinite(given).all(axis=1))[0])
        raise UsageError(f"points[{first}]: {given[first].tolist()} where finite numbers are needed")
    ground = terrain.heights_at(given)
    if given.shape[1] == 2:
        if np.isnan(ground).any():
            first = int(np.flatnonzero(np.isnan(ground))[0])
            raise UsageError(
                f"points[{first}]: {given[first].tolist()} is outside {terrain.source}, or in a hole of it.",
                _extent(terrain),
            )
        return np.column_stack([given, ground + height])
    if height:
        raise UsageError("height: is of points (N, 2) and of samples; these have a z.", "Add it to z.")
    x, y = terrain.coordinates()
    size = np.array([x[-1] - x[0], y[0] - y[-1]])
    off = np.maximum(np.maximum([x[0], y[-1]] - given[:, :2], given[:, :2] - [x[-1], y[0]]), 0.0)
    if (off > size).any(axis=1).all():
        raise UsageError(f"points: all are farther from {terrain.source} than it is wide.", _extent(terrain))
    with np.errstate(invalid="ignore"):
        depth = ground - given[:, 2]
        below = depth > 0.5 * max(terrain.spacing)
        given[:, 2] = np.where((depth > 0) & ~below, ground, given[:, 2])
    if below.any():
        given[below, 2] = np.nan
        count = int(below.sum())
        warn(
            f"points: {count:,} of {len(given):,} are below ground by more than half a spacing; they get NaN.",
            late=True,
        )
    return given


def _shape_of(values: Any) -> tuple[int, ...]:
    """Return the shape of an array; (N,) for N lists of different lengths, which are no array."""
    try:
        return np.shape(values)
    except ValueError:
        return (len(values),)


def _along(component: Any) -> Any:
    """Return 0 for components near 0, so that rounding does not move a ray off the field's border."""
    return np.where(np.abs(component) < 1e-12, 0.0, component)[()]


def _extent(terrain: HeightField) -> str:
    x, y = terrain.coordinates()
    return f"It reaches from x = {x[0]:.10g} to {x[-1]:.10g}, and from y = {y[-1]:.10g} to {y[0]:.10g}."


def _facing(normals: Any, terrain: HeightField, points: Float64 | None) -> Float32:
    """Return unit normals of the receivers, or (1, 3) for all. Raises UsageError."""
    if normals is None:
        return np.array([[0.0, 0.0, 1.0]], np.float32)
    if isinstance(normals, str):
        if normals != "surface":
            raise UsageError(f'normals: "{normals}", but None, "surface" or an array is needed.')
        return terrain.normals().reshape(-1, 3) if points is None else terrain.normals_at(points)
    count = math.prod(terrain.shape) if points is None else len(points)
    allowed = {(3,), (count, 3)}
    given = real_array("normals", normals, f"(3,) or ({count}, 3)", allowed.__contains__).reshape(-1, 3)
    facing = unit_normals(given)
    wrong = ~(np.abs(facing).max(axis=1) > 0)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise UsageError(f"normals[{first}]: {given[first].tolist()} looks nowhere.")
    return np.asarray(facing, np.float32)


@kernel
def add_sky(tangents, normals, direction, weight, sums):  # type: ignore[no-untyped-def]
    """Add the light of a white sky of radiance 1 / pi from a sector of azimuths.

    tangents  : (N,) tangents of the horizon angles
    normals   : (N, 3) unit normals, x east, y north, z up; or (1, 3) for all
    direction : x and y of a unit vector to the middle of the sector
    weight    : width of the sector, radians
    sums      : (N,) sums; the whole sky gives 1 on a horizontal surface

    The integral of max(0, n . w) sin t over the zenith angle t, from 0 to the horizon's, is exact. If a is the
    component of the normal n along the azimuth, it is nz sin^2 t / 2 + a (t - sin t cos t) / 2 [Dozier & Frew 1990,
    eq. 7].
    """
    scale = weight / math.pi
    for i in range(len(tangents)):
        tangent = float(tangents[i])
        k = i if len(normals) > 1 else 0
        nx, ny, nz = float(normals[k, 0]), float(normals[k, 1]), float(normals[k, 2])
        along = nx * direction[0] + ny * direction[1]
        if along == 0.0 and nz > 0.0:
            sums[i] += scale * 0.5 * nz / (1.0 + tangent * tangent)
            continue
        # In the vertical plane of this azimuth, the surface faces zenith angles within 90 degrees of `facing`, the
        # zenith angle of the normal's projection.
        facing = math.atan2(along, nz)
        last = min(math.atan2(1.0, tangent), facing + 0.5 * math.pi)
        first = max(0.0, facing - 0.5 * math.pi)
        if last > first:
            s, c = math.sin(last), math.cos(last)
            s0, c0 = math.sin(first), math.cos(first)
            sums[i] += scale * 0.5 * (nz * (s * s - s0 * s0) + along * (last - first - s * c + s0 * c0))
