"""Annual daylight: hourly light from daylight coefficients and weather, and its summaries.

    light of the hours = coefficients @ skies of the hours

The rows of sensors are multiplied block by block, so that memory does not grow with their number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight import metrics
from glpath.apps.daylight.coefficients import DaylightCoefficients, rows_of
from glpath.apps.daylight.hourly_skies import HourlySkies, Quantity
from glpath.apps.daylight.receivers import response
from glpath.errors import UsageError, argument, warn
from glpath.io.weather import Weather, read_weather
from glpath.system.arguments import checked
from glpath.system.files import whole_file
from glpath.system.frames import data_set, package

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Start and end of the time in which rooms are occupied, hours of the day [LM-83].
OCCUPIED = (8, 18)
#: Albedo of the ground around the scene.
GROUND = 0.2
#: Maximum size of hourly values in a file, bytes. If they are larger, only summaries can be saved.
MAX_HOURS = 2 << 30
# Number of floats in a block of rows (64 MiB).
_BLOCK = 1 << 24
# Maximum difference between the latitudes of coefficients and weather, degrees.
_LATITUDE = 2.5
_WATTS_PER_KILOWATT = 1000.0
# Minimum number of hours of a whole year.
_HOURS_OF_YEAR = 8760
# WMO threshold of sunshine: direct normal irradiance, W m^-2.
_SUNSHINE = 120.0


@checked
@dataclass(frozen=True, eq=False)
class DaylightYear:
    """Daylight of N sensors in the H hours of `weather`. Fractions are from 0 to 1; those of texels are by area.

    coefficients : coefficients of the sensors
    weather      : weather of the site
    blinds       : for each group of blinds, coefficients of the same sensors with that group closed; () if there
                   are no blinds
    skies        : skies of the hours with light
    occupied     : (H,) bool, True for hours that count for autonomy and the other summaries
    threshold    : illuminance threshold of daylight autonomy, lx
    closed       : (G, H) bool, True if a group is closed because sunlight through it reaches over 2 % of the
                   sensors
    autonomy     : (N,) float64, fraction of the occupied hours with `threshold` lx or more
    useful       : (N, 4) float64, fractions of the occupied hours below 100 lx, to 300, to 3000, and above
    mean         : (N,) float64, mean illuminance of the occupied hours, lx
    sunlight_hours : (N,) float64, occupied hours with 1000 lx or more of direct sunlight, blinds open
    sun_hours    : (N, 12) float64, hours of each month in which the sun shines onto the sensor, blinds open
    irradiation  : (N, 12) float64, kWh per square metre in each month, the sun's whole spectrum, blinds open
    """

    coefficients: DaylightCoefficients
    weather: Weather
    blinds: tuple[DaylightCoefficients, ...]
    skies: HourlySkies
    occupied: NDArray[np.bool_]
    threshold: float
    closed: NDArray[np.bool_]
    autonomy: Float64
    useful: Float64
    mean: Float64
    sunlight_hours: Float64
    sun_hours: Float64
    irradiation: Float64

    def __len__(self) -> int:
        return len(self.coefficients)

    @property
    def sda(self) -> float | None:
        """Spatial daylight autonomy (sDA) of LM-83; None without blinds, because LM-83 requires operated blinds.

        It is the fraction of sensors whose daylight autonomy is half or more; the default threshold is 300 lx.
        """
        return self.autonomous_share if self.blinds else None

    @property
    def autonomous_share(self) -> float:
        """Fraction of sensors whose daylight autonomy is half or more, with or without blinds."""
        return metrics.spatial_autonomy(self.autonomy, weights=self.coefficients.sensor_weights)

    @property
    def ase(self) -> float:
        """Annual sunlight exposure (ASE) of LM-83, a fraction of the sensors.

        It counts sensors with more than 250 occupied hours of 1000 lx or more of direct sunlight, blinds open.
        """
        return metrics.sunlight_exposure(self.sunlight_hours, weights=self.coefficients.sensor_weights)

    def light(self, rows: slice = slice(None), quantity: Quantity = "illuminance") -> Float32:
        """Return (n, H) float32 light of some sensors in all hours, lx or W m^-2, with blinds as in `closed`."""
        of = rows_of(self, rows)
        found = np.zeros((len(of), len(self.weather.times)), np.float32)
        for first, last in blocks(len(of), len(self.skies)):
            some = of[first:last]
            # A range that runs down to index 0 stops at -1, which a slice would count from the end.
            part = slice(some.start, some.stop if some.stop >= 0 else None, some.step)
            found[first:last, self.skies.hours] = _light(self, part, quantity)
        return found

    def to_xarray(self, hours: bool = True) -> Any:
        """Return an `xarray.Dataset` with summaries of the sensors, and if `hours`, their hourly illuminance.

        Raises GlpathError if xarray is missing.
        """
        sensor = ("sensor",)
        points, normals = self.coefficients.points, self.coefficients.normals
        variables: dict[str, Any] = {
            name: (dims, values, {"units": unit, "long_name": what})
            for name, (dims, values, unit, what) in self._summaries().items()
        }
        grouped = len(self.blinds) > 1
        variables["blinds_closed"] = (
            ("group", "time") if grouped else ("time",),
            self.closed if grouped else self.closed.any(axis=0),
            {"long_name": "blinds are closed"},
        )
        variables["occupied"] = (("time",), self.occupied, {"long_name": "hours that count"})
        if hours:
            what = {"units": "lx", "long_name": "illuminance, mean of the hour"}
            variables["illuminance"] = (("sensor", "time"), self.light(), what)
        coordinates = {
            **{axis: (sensor, points[:, i]) for i, axis in enumerate("xyz")},
            **{f"n{axis}": (sensor, normals[:, i]) for i, axis in enumerate("xyz")},
            "time": self.weather.times.astype("datetime64[ns]"),
            "month": np.arange(1, 13),
        }
        return data_set(variables, coordinates, self.attributes())

    def attributes(self) -> dict[str, Any]:
        """Return values that hold for all sensors, by their names in files."""
        found: dict[str, Any] = {
            "site": self.weather.site,
            "weather": Path(self.weather.source).name,
            "latitude": self.weather.latitude,
            "longitude": self.weather.longitude,
            "time_zone": self.weather.time_zone,
            "receiver": self.coefficients.receiver,
            "patches": len(self.coefficients.patches) - 1,
            "sun_positions": len(self.coefficients.suns),
            "ground_albedo": self.skies.ground,
            "threshold_lx": self.threshold,
            "occupied_hours": int(self.occupied.sum()),
            "ASE": self.ase,
            "autonomous_share": self.autonomous_share,
        }
        if self.sda is not None:
            hours = (self.closed & self.occupied).sum(axis=1).tolist()
            found |= {"sDA": self.sda, "blinds_closed_hours": hours[0] if len(hours) == 1 else hours}
        return found

    def of_sensors(self) -> Iterator[tuple[str, Float64, str]]:
        """Yield name, values (N,) and unit of each annual summary."""
        for name, (dims, values, unit, _) in self._summaries().items():
            if dims == ("sensor",):
                yield name, values, "" if unit == "1" else unit

    def columns(self) -> dict[str, Float64]:
        """Return the columns (N,) of the `.csv` table, which has one row per sensor."""
        points, normals = self.coefficients.points, self.coefficients.normals
        found: dict[str, Float64] = {axis: points[:, i] for i, axis in enumerate("xyz")}
        found |= {f"n{axis}": normals[:, i] for i, axis in enumerate("xyz")}
        found |= {name: values for name, values, _ in self.of_sensors()}
        for name in ("sun_hours", "irradiation"):
            of_months = getattr(self, name)
            found |= {f"{name}_{month:02d}": of_months[:, month - 1] for month in range(1, 13)}
        return found

    def save(self, path: str | Path, hours: bool = True) -> None:
        """Write .nc (netCDF of `to_xarray`) or .csv (`columns`).

        hours : True to include hourly illuminance in .nc

        Raises UsageError for another suffix, or if hourly values exceed 2 GiB. Raises ImageError if the file cannot
        be written.
        """
        suffix = check_suffix(path)
        if suffix == ".csv":
            columns = self.columns()
            table = np.stack(list(columns.values()), axis=1)
            with whole_file(path) as part:
                formats = ["%.15g"] * 3 + ["%.7g"] * (len(columns) - 3)  # coordinates may be those of a map
                np.savetxt(part, table, formats, ",", header=",".join(columns), comments="")
            return
        check_hours(path, len(self), len(self.weather.times), hours)
        found = self.to_xarray(hours)
        # netCDF 3 has no bool type.
        found = found.assign({name: found[name].astype(np.int8) for name in ("blinds_closed", "occupied")})
        with whole_file(path) as part:
            found.to_netcdf(part, engine="scipy", format="NETCDF3_64BIT")

    def _summaries(self) -> dict[str, tuple[tuple[str, ...], Float64, str, str]]:
        sensor, month = ("sensor",), ("sensor", "month")
        low, middle, high = (f"{bound:g}" for bound in metrics.USEFUL)
        names = ("low", "supplementary", "enough", "high")
        within = (f"below {low} lx", f"{low} to {middle} lx", f"{middle} to {high} lx", f"above {high} lx")
        useful = {
            f"useful_daylight_{name}": (sensor, self.useful[:, i], "1", f"share of the occupied hours, {what}")
            for i, (name, what) in enumerate(zip(names, within, strict=True))
        }
        return {
            "daylight_autonomy": (
                sensor, self.autonomy, "1", f"share of the occupied hours with {self.threshold:g} lx or more",
            ),
            **useful,
            "mean_illuminance": (sensor, self.mean, "lx", "mean of the occupied hours"),
            "sunlight_hours": (
                sensor, self.sunlight_hours, "h", f"occupied hours of {metrics.SUNLIGHT:g} lx by the sun alone",
            ),
            "sky_view_factor": (sensor, self.coefficients.sky_view, "1", "sky view factor"),
            "irradiation_year": (sensor, self.irradiation.sum(axis=1), "kWh m-2", "of the year"),
            "sun_hours": (month, self.sun_hours, "h", "hours of sun"),
            "irradiation": (month, self.irradiation, "kWh m-2", "whole spectrum of the sun"),
        }  # fmt: skip


@checked
def daylight_year(
    coefficients: DaylightCoefficients,
    weather: Weather | str | Path,
    *,
    blinds: DaylightCoefficients | Sequence[DaylightCoefficients] | None = None,
    occupied: tuple[float, float] = OCCUPIED,
    threshold: float = metrics.AUTONOMY,
    ground: float = GROUND,
) -> DaylightYear:
    """Return a year of daylight of sensors, from daylight coefficients and the weather of a site.

    Parameters
    ----------
    coefficients : daylight coefficients with sun positions for the weather's latitude
    weather      : an EPW or TMY3 file, or a result of `glpath.io.weather.read_weather`
    blinds       : coefficients of the same sensors with blinds closed; for several groups of windows, one for each
                   group with only its blinds closed. Blinds close if more than 2 % of the sensors have 1000 lx or
                   more of direct sunlight [LM-83]. A group responds to the sunlight that it blocks
    occupied     : start and end of the hours that count, hours of the day in local standard time
    threshold    : illuminance threshold of daylight autonomy, lx
    ground       : albedo of the ground around the scene, which reflects light from below the horizon

    Warns with SceneWarning if the weather is of a part of a year.

    Raises UsageError for coefficients without suns or of another latitude, or if those with blinds have other
    sensors. Raises SceneError for invalid weather files, and GlpathError if pvlib is missing.

    Cost:     some seconds for a thousand sensors: a product of sensors, patches and lit hours, and of each group.
    Poor at:  light that enters and leaves through windows of different groups, because the reductions by groups are
              summed.
    Source:   McNeil & Lee 2013; IES LM-83-12.
    """
    check_settings(occupied, threshold, ground)
    of = weather if isinstance(weather, Weather) else read_weather(weather)
    groups = () if blinds is None else (blinds,) if isinstance(blinds, DaylightCoefficients) else tuple(blinds)
    return year_of(coefficients, of, groups, occupied_hours(of, occupied), threshold, ground)


def occupied_hours(weather: Weather, occupied: tuple[float, float]) -> NDArray[np.bool_]:
    """Return (H,) bool, True for the hours of the weather that lie in the occupied part of the day.

    Warns with SceneWarning if the weather is of a part of a year. Raises UsageError if no hour is occupied.
    """
    if len(weather.times) < _HOURS_OF_YEAR:
        warn(
            f"{weather.source}: has {len(weather.times):,} of the {_HOURS_OF_YEAR:,} hours of a year. Autonomy, "
            "sDA, ASE and all sums are of this part alone."
        )
    first, last = occupied
    since_midnight = weather.times - weather.times.astype("datetime64[D]")
    begin = since_midnight.astype("timedelta64[s]").astype(np.float64) / 3600
    counted: NDArray[np.bool_] = (begin >= first) & (begin + 1 <= last)
    if not counted.any():
        raise UsageError(f"occupied: no hour of {weather.source} lies from {first:g} to {last:g}.")
    return counted


def year_of(
    coefficients: DaylightCoefficients,
    of: Weather,
    groups: tuple[DaylightCoefficients, ...],
    counted: NDArray[np.bool_],
    threshold: float,
    ground: float,
) -> DaylightYear:
    """Return a year of daylight, as `daylight_year` does.

    of      : weather of the site
    groups  : coefficients with closed blinds, one for each group of windows
    counted : result of `occupied_hours`
    """
    _check_alike(coefficients, of, groups)
    skies = HourlySkies.of(of, coefficients, ground)
    closed = np.zeros((len(groups), len(of.times)), np.bool_)
    count, weights = len(coefficients), coefficients.sensor_weights
    for is_closed, group in zip(closed, groups, strict=True):
        sunlit = np.zeros(len(skies))
        for part in _parts(count, len(skies)):
            sunlight = _sunlight(coefficients, skies, part)
            if len(groups) > 1:  # count only the sunlight that the blinds of this group would block
                sunlight -= _sunlight(group, skies, part)
            sunlit += weights[part].sum() * metrics.sunlit_share(sunlight, weights=weights[part])
        is_closed[skies.hours] = metrics.blinds_closed(sunlit / weights.sum())
    year = DaylightYear(
        coefficients,
        of,
        groups,
        skies,
        counted,
        float(threshold),
        closed,
        autonomy=np.empty(count),
        useful=np.empty((count, 4)),
        mean=np.empty(count),
        sunlight_hours=np.empty(count),
        sun_hours=np.empty((count, 12)),
        irradiation=np.empty((count, 12)),
    )
    _count(year)
    return year


def check_settings(occupied: tuple[float, float], threshold: float, ground: float) -> None:
    """Raise UsageError for settings of a year that are out of range, see `daylight_year`."""
    first, last = occupied
    if not 0 <= first < last <= 24:
        raise UsageError(f"occupied: from {first:g} to {last:g} where two hours of a day are needed, as 8 and 18.")
    if not 0 < threshold < math.inf:
        raise UsageError(f"threshold: {threshold:g} lx where a finite number above 0 is needed.")
    if not 0 <= ground <= 1:
        raise UsageError(f"ground: an albedo of {ground:g} where 0 to 1 is needed.")


def check_suffix(path: str | Path) -> str:
    """Return the suffix of an output file, .nc or .csv.

    Raises UsageError for another suffix, and GlpathError if a package is missing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".nc", ".csv"):
        raise UsageError(
            f"{path}: a year of daylight is written as .nc or .csv.",
            "netCDF has the hours, a table the sums of each sensor.",
        )
    if suffix == ".nc":
        package("xarray")
    return suffix


def check_hours(path: str | Path, sensors: int, hours: int, wanted: bool) -> None:
    """Raise UsageError if hourly values are wanted but too large for a file."""
    need = 4 * sensors * hours
    if wanted and need > MAX_HOURS:
        raise UsageError(
            f"{path}: {sensors:,} sensors in {hours:,} hours are {need / 2**30:.1f} GiB, but a file takes 2.",
            f"Leave the hours out: {argument('hours', False)}; `light(rows)` has those of some sensors.",
        )


def blocks(count: int, width: int) -> Iterator[tuple[int, int]]:
    """Yield half-open ranges (first, last) of rows.

    A range has at most _BLOCK floats, with `width` floats in each row.
    """
    step = max(1, _BLOCK // max(1, width))
    for first in range(0, count, step):
        yield first, min(first + step, count)


def _parts(count: int, width: int) -> Iterator[slice]:
    return (slice(first, last) for first, last in blocks(count, width))


def _check_alike(
    coefficients: DaylightCoefficients, weather: Weather, groups: tuple[DaylightCoefficients, ...]
) -> None:
    """Raise UsageError if coefficients, weather and blinds do not fit together."""
    if not len(coefficients.suns):
        raise UsageError(
            "daylight_year: the coefficients have no positions of the sun.",
            f"Compute them with latitude={weather.latitude:g}.",
        )
    if abs(coefficients.latitude - weather.latitude) > _LATITUDE:
        raise UsageError(
            f"daylight_year: the suns of the coefficients are of latitude {coefficients.latitude:g}, the weather's "
            f"site {weather.site} is at {weather.latitude:g}.",
            f"Compute them with latitude={weather.latitude:g}.",
        )
    for number, blinds in enumerate(groups, 1):
        which = "blinds" if len(groups) == 1 else f"group {number} of the blinds"
        for name in ("points", "normals", "directions", "column"):
            if not np.array_equal(getattr(coefficients, name), getattr(blinds, name)):
                raise UsageError(
                    f"daylight_year: the coefficients with {which} have other {name}.",
                    "Compute all with the same sensors and options; only the scene differs.",
                )
        if blinds.receiver != coefficients.receiver:
            raise UsageError(
                f"daylight_year: the coefficients with {which} are of a {blinds.receiver}, those without of a "
                f"{coefficients.receiver}."
            )


def _light(year: DaylightYear, part: slice, quantity: Quantity) -> Float32:
    """Return light (n, L) of some sensors in the hours with light, with blinds as in `year.closed`."""
    skies, closed = year.skies, year.closed[:, year.skies.hours]
    sky, sun = skies.sky(quantity), skies.sun(quantity).astype(np.float32)

    def product(of: DaylightCoefficients, which: NDArray[np.bool_]) -> Float32:
        return _product(of, part, sky[:, which], skies.position[which], skies.to_sun[which], sun[which])

    every = np.ones(len(skies), np.bool_)
    if not closed.any():
        return product(year.coefficients, every)
    if len(closed) == 1:
        found = np.empty((len(range(len(year))[part]), len(skies)), np.float32)
        for which, coefficients in ((~closed[0], year.coefficients), (closed[0], year.blinds[0])):
            found[:, which] = product(coefficients, which)
        return found
    found = product(year.coefficients, every)
    bare = found.copy()
    for which, group in zip(closed, year.blinds, strict=True):
        found[:, which] += product(group, which) - bare[:, which]
    return np.maximum(found, 0.0)


def _product(
    of: DaylightCoefficients, part: slice, sky: Float32, position: NDArray[np.intp], to_sun: Float64, sun: Float32
) -> Float32:
    found = of.sky(part) @ sky
    found += (of.indirect_sun(part)[:, position] + _direct(of, part, position, to_sun)) * sun
    return np.asarray(found, np.float32)


def _direct(of: DaylightCoefficients, part: slice, position: NDArray[np.intp], to_sun: Float64) -> Float32:
    """Return (n, L) light of some sensors for unit irradiance of the sun.

    Visibility is that of the nearest stored sun position; the cosine is that of the actual direction.
    """
    found = of.sunlight(part)[:, position]
    found *= response(of.receiver, of.normals[part], to_sun)
    return found


def _sunlight(of: DaylightCoefficients, skies: HourlySkies, part: slice) -> Float32:
    """Return the illuminance by direct sunlight of the n sensors in `part` at L hours of daylight, (n, L) lx."""
    return _direct(of, part, skies.position, skies.to_sun) * skies.sun("illuminance").astype(np.float32)


def _count(year: DaylightYear) -> None:
    """Fill the arrays of summaries of a year."""
    skies, of = year.skies, year.coefficients
    counted = year.occupied[skies.hours]
    hours = int(year.occupied.sum())
    dark = hours - int(counted.sum())
    month = year.weather.times[skies.hours].astype("datetime64[M]").astype(np.int64) % 12
    months = (month[:, None] == np.arange(12)).astype(np.float32)
    watts_sky = skies.sky("irradiance") @ months
    suns = np.zeros((len(of.suns), 12), np.float32)
    np.add.at(suns, (skies.position, month), skies.direct.astype(np.float32))
    shining = (skies.direct >= _SUNSHINE).astype(np.float32)
    for part in _parts(len(of), len(skies)):
        # Occupied hours without light count as hours of 0 lx.
        lux = np.pad(_light(year, part, "illuminance")[:, counted], ((0, 0), (0, dark)))
        year.autonomy[part] = metrics.daylight_autonomy(lux, year.threshold)
        year.useful[part] = metrics.useful_daylight(lux)
        year.mean[part] = lux.mean(axis=1, dtype=np.float64)
        direct = _direct(of, part, skies.position, skies.to_sun)
        sunlight = direct[:, counted] * skies.sun("illuminance")[counted].astype(np.float32)
        year.sunlight_hours[part] = (sunlight >= metrics.SUNLIGHT).sum(axis=1)
        year.sun_hours[part] = ((direct > 0) * shining) @ months
        watts = of.sky(part) @ watts_sky + of.indirect_sun(part) @ suns
        watts += (direct * skies.direct.astype(np.float32)) @ months
        year.irradiation[part] = watts / _WATTS_PER_KILOWATT
