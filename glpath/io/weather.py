"""Weather files (EPW and TMY3): direct and diffuse irradiance of each hour of a year, and positions of the sun.

The values of an hour are averages, so the sun position is taken in the middle of the hour (`sun_of_hours`).
Times are local standard time, without summer time, as in the files.

Cost:     half a second for a year; pvlib reads the files (`glpath[sky]`).
Poor at:  files with several rows an hour, which are refused.
Source:   EnergyPlus 24.1, Auxiliary programs: EPW data dictionary. Wilcox & Marion 2008, Users manual for TMY3 data
          sets.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError, SceneError, warn
from glpath.scene.model import Float64
from glpath.scene.source_location import shown
from glpath.sky.perez import PRECIPITABLE_WATER, PerezSky, extraterrestrial, precipitable_water
from glpath.sky.sun_position import YEARS, SunPosition, Times, quiet_pvlib, sun_of_hours
from glpath.system.bounded_reading import reading_file
from glpath.system.files import read_bytes, reason_of
from glpath.system.numerals import real, unsigned, whole

#: Suffixes of weather files.
WEATHER_FILES = (".epw", ".csv")
#: Year to which the dates of a file are assigned if its hours are from several years.
TYPICAL_YEAR = 2023
# Maximum size of a file in bytes: ten times the size of a year.
_MAX_BYTES = 2**24
# Maximum number of lines of a file: a leap year of one-minute steps, and a head.
_MAX_LINES = 527_040 + 100
# Values at least as large mark missing irradiance, W m^-2: 9999 in EPW files, and -9900 in TMY3 files.
_MISSING = 9000.0
# Number of lines before the first hour of an EPW file.
_EPW_HEAD = 8
# Text at the start of the last line before the first hour of an EPW file.
_EPW_LAST = "DATA PERIODS"
# Text at the start of the line about leap years in an EPW file.
_EPW_HOLIDAYS = "HOLIDAYS/DAYLIGHT SAVING"
# First and last day of a year, and 29 February, as 100 * month + day.
_WHOLE_YEAR = 101, 1231
_LEAP_DAY = 229
# Number of fields in a row of an EPW file.
_EPW_FIELDS = 35
# Number of lines before the first hour of a TMY3 file.
_TMY3_HEAD = 2
# Negative irradiance down to this value, W m^-2, is noise of a pyranometer and is read as 0; below, it is an error.
_MIN_NOISE = -20.0
# Maximum difference between global irradiance and that of sun plus sky, summed over the year, as a fraction of the
# global irradiance. Above it a warning is printed.
_CLOSURE = 0.15
# Minimum, maximum and unit of the numbers of a site; others are errors. The altitude is above the sea.
_LIMITS = {
    "latitude": (-90, 90, ""),
    "longitude": (-180, 180, ""),
    "time zone": (-14, 14, ""),
    "altitude": (-1000, 10000, " m"),
}
# Maximum difference between the longitude and 15 times the time zone, degrees. Above it a warning is printed.
_ZONE = 45.0


@dataclass(frozen=True, eq=False)
class Weather:
    """Weather of the hours of a year, or of a part of it.

    source              : name of the file
    site                : name of the site in the file
    latitude, longitude : degrees, north and east
    time_zone           : hours east of Greenwich
    elevation           : metres above the sea
    times               : (H,) datetime64[s] in local standard time, at which the hours begin, ascending. They are
                          all hours of the year, or of the data periods in an EPW file's head
    direct_normal       : (H,) float64, irradiance of a surface that faces the sun, W m^-2
    diffuse_horizontal  : (H,) float64, irradiance of a horizontal surface by the sky alone, W m^-2
    dew_point           : (H,) float64, degrees Celsius; NaN if the file has none
    missing             : number of hours without a row or without irradiance in the file, which count as dark
    after_dark          : number of hours with light although the sun is down throughout, which count as dark
    """

    source: str
    site: str
    latitude: float
    longitude: float
    time_zone: float
    elevation: float
    times: Times
    direct_normal: Float64
    diffuse_horizontal: Float64
    dew_point: Float64
    missing: int = 0
    after_dark: int = 0

    @cached_property
    def utc(self) -> Times:
        """Times in UTC at which the hours begin, (H,) datetime64[s]."""
        return np.asarray(self.times - np.timedelta64(round(3600 * self.time_zone), "s"))

    @cached_property
    def sun(self) -> SunPosition:
        """Sun position of each hour, (H,) degrees: altitude, and azimuth from north towards east.

        The altitude is below 0 if the sun is down throughout the hour.
        """
        return sun_of_hours(self.utc, self.latitude, self.longitude, self.elevation)

    @property
    def water(self) -> Float64:
        """Precipitable water of each hour, (H,) cm."""
        known = np.isfinite(self.dew_point)
        return np.where(known, precipitable_water(np.where(known, self.dew_point, 0.0)), PRECIPITABLE_WATER)

    @cached_property
    def skies(self) -> PerezSky:
        """All-weather sky of each hour."""
        day = (self.times.astype("datetime64[D]") - self.times.astype("datetime64[Y]")).astype(np.int64) + 1
        return PerezSky.of(self.direct_normal, self.diffuse_horizontal, self.sun.altitude, extraterrestrial(day))

    @property
    def direct_illuminance(self) -> Float64:
        """Illuminance by the sun alone of a surface that faces it, (H,) lx, by Perez' efficacy."""
        return self.direct_normal * self.skies.direct_efficacy(self.water)

    @property
    def diffuse_illuminance(self) -> Float64:
        """Illuminance of a horizontal surface by the sky alone, (H,) lx, by Perez' efficacy."""
        return self.diffuse_horizontal * self.skies.diffuse_efficacy(self.water)

    def hour_of(self, time: np.datetime64) -> int:
        """Return the index of the hour that contains `time`, in local standard time; its year is ignored.

        Raises SceneError for an hour that the file does not have.
        """
        found = np.flatnonzero((_in_year(self.times) == _in_year(np.array([time], "datetime64[s]"))).all(axis=0))
        if not len(found):
            raise SceneError(
                f"{self.source}: has no hour at {_shown(time)}; it has {len(self.times):,} hours from "
                f"{_shown(self.times[0])} to {_shown(self.times[-1])}.",
                "Take a time within, in local standard time.",
            )
        return int(found[0])


def read_weather(path: Path | str) -> Weather:
    """Return the weather of an EPW or TMY3 file.

    Hours of the year without a row are dark. An EPW file whose head names data periods has only their hours.

    Warns with SceneWarning of missing hours, of missing irradiance, and of a time zone far from the longitude.
    Warns also if sun positions do not fit the light, as after dark or for another hemisphere.

    Raises SceneError if the file is not a weather file, or is broken; GlpathError if pvlib is missing.
    """
    path = Path(path)
    if path.suffix.lower() not in WEATHER_FILES:
        raise SceneError(
            f"{path}: is no weather file that is known: allowed are {', '.join(WEATHER_FILES)}.",
            "EnergyPlus weather is .epw, TMY3 is .csv.",
        )
    with reading_file(path.name):
        return _read(path)


def _read(path: Path) -> Weather:
    try:
        raw = read_bytes(path, _MAX_BYTES)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {reason_of(error)}.", "Check the name.") from None
    text = raw.decode("utf-8-sig") if _is_utf8(raw) else raw.decode("latin-1")
    lines = max(text.count("\n"), text.count("\r"))
    if lines > _MAX_LINES:
        raise SceneError(
            f"{path}: has {lines:,} lines, but a weather file has at most {_MAX_LINES:,}.", "Give one row an hour."
        )
    table, site, begin = _epw(text, path) if path.suffix.lower() == ".epw" else _tmy3(text, path)
    return _checked(table, site, begin, str(path))


def _is_utf8(raw: bytes) -> bool:
    try:
        raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return False
    return True


def _epw(text: str, path: Path) -> tuple[Any, dict[str, Any], Times]:
    if not text.startswith("LOCATION"):
        raise SceneError(f'{path}: begins with "{text[:20]!s}", but an EPW file begins with LOCATION.')
    _check_head(text, path, 6, ("latitude", "longitude", "time zone", "altitude"))
    plain, lines, periods = _plain_epw(text, path)
    table, site = _parsed("read_epw", plain, path)
    begin = _without_zone(table)
    return _with_lines(table, lines), {**site, "name": site.get("city", ""), "periods": periods}, begin


def _plain_epw(text: str, path: Path) -> tuple[str, list[int], list[tuple[int, int]]]:
    """Return the text of an EPW file in the form that pvlib reads, line numbers of its rows, and its data periods.

    EnergyPlus accepts more forms than pvlib. The result has no comments in the head. Each row
    has all fields. Hours are from 1 to 24, and there is no 29 February that the head does not allow. A field that
    is missing at the end of a row is empty. Line numbers are from 1; for the periods see `_data_periods`.
    """
    # str.splitlines also splits at characters such as U+0085, which may be bytes of letters.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    last = [number for number, line in enumerate(lines) if line.upper().startswith(_EPW_LAST)]
    first = last[0] + 1 if last else _EPW_HEAD
    rows = {
        number: (line.split(",") + [""] * _EPW_FIELDS)[:_EPW_FIELDS]
        for number, line in enumerate(lines[first:], first + 1)
        if line.strip()
    }
    rows = _with_hours_from_one(_without_leap_day(rows, lines[:first], path), path)
    for number, row in rows.items():
        _check_time(row, f"{path}: line {number}")
    head = [lines[0], *["-"] * (_EPW_HEAD - 1)]
    plain = "\n".join([*head, *(",".join(row) for row in rows.values())]) + "\n"
    return plain, list(rows), _data_periods(lines[last[-1]] if last else "")


def _data_periods(line: str) -> list[tuple[int, int]]:
    """Return the first and the last day, 100 * month + day, of each period in the line DATA PERIODS of an EPW head.

    If none is written as month/day, the period is the whole year.
    """
    words = line.split(",")
    days = ([re.match(r" *([0-9]{1,2}) */ *([0-9]{1,2})", word) for word in words[at::4]] for at in (5, 6))
    return [
        (100 * int(first[1]) + int(first[2]), 100 * int(last[1]) + int(last[2]))
        for first, last in zip(*days, strict=False)
        if first and last
    ] or [_WHOLE_YEAR]


def _without_leap_day(rows: dict[int, list[str]], head: list[str], path: Path) -> dict[int, list[str]]:
    """Return rows without 29 February, as EnergyPlus does, if the head says that leap years are not observed."""
    holidays = next((line for line in head if line.upper().startswith(_EPW_HOLIDAYS)), "")
    if not holidays.partition(",")[2].strip().upper().startswith("N"):
        return rows
    days = {line: [field.strip().lstrip("0") for field in row[1:3]] for line, row in rows.items()}
    kept = {line: row for line, row in rows.items() if days[line] != ["2", "29"]}
    if len(kept) < len(rows):
        warn(
            f"{path}: its 29 February is not used, because {_EPW_HOLIDAYS} says No for leap years. "
            "EnergyPlus does so, too; say Yes there to use it."
        )
    return kept


def _with_hours_from_one(rows: dict[int, list[str]], path: Path) -> dict[int, list[str]]:
    """Return rows of an EPW file with hours from 1 to 24. Hours from 0 to 23 are renumbered, with a warning."""
    hours = {row[3].strip() for row in rows.values()}
    if not hours & {"0", "00"} or "24" in hours or any(unsigned(hour) is None or len(hour) > 2 for hour in hours):
        return rows
    warn(f"{path}: its hours are from 0 to 23, not from 1 to 24. They are read as those that begin then.")
    return {line: [*row[:3], str(int(row[3]) + 1), *row[4:]] for line, row in rows.items()}


def _check_time(row: list[str], location: str) -> None:
    """Raise SceneError unless the year, month, day and hour of an EPW row exist. Hours are from 1 to 24."""
    try:
        year, month, day, hour = map(whole, row[:4])
        date(year, month, day)
    except (ValueError, OverflowError):
        hour = 0
    if not 1 <= hour <= 24:
        raise SceneError(
            f"{location} has {', '.join(map(shown, row[:4]))} as year, month, day and hour, which is no hour.",
            "Months are 1 to 12, days 1 to 31 at most, and hours 1 to 24.",
        )


def _tmy3(text: str, path: Path) -> tuple[Any, dict[str, Any], Times]:
    if "Date (MM/DD/YYYY)" not in text[:2000]:
        raise SceneError(
            f"{path}: has no column Date (MM/DD/YYYY) in its second line, which a TMY3 file has.",
            "Other tables are not read; EnergyPlus weather has the suffix .epw.",
        )
    _check_head(text, path, 3, ("time zone", "latitude", "longitude", "altitude"))
    table, site = _parsed("read_tmy3", text, path, map_variables=True)
    # TMY3 times are the ends of the hours, and TMY3 files omit 29 February. In a leap year, the hour that ends at
    # 0:00 on 1 March would begin on 29 February. It is moved to 28 February.
    begin = _without_zone(table) - np.timedelta64(3600, "s")
    month, day, hour = _in_year(begin)
    alone = (month == 1) & (day == 28) & (hour == 23) & (np.append([0], day[:-1]) == 27)
    begin[alone] -= np.timedelta64(86400, "s")
    rows = enumerate(re.split(r"\r\n|\r|\n", text), 1)
    lines = [number for number, line in rows if line and number > _TMY3_HEAD]
    return _with_lines(table, lines), {**site, "name": site.get("Name", "")}, begin


def _check_head(text: str, path: Path, first: int, names: Sequence[str]) -> None:
    """Raise SceneError unless line 1 has numbers for latitude, longitude, time zone and altitude, within limits.

    first : index of the word that holds the first of them
    names : their names, in the order of the file
    """
    remedy = "The line has the latitude, the longitude, the time zone and the altitude."
    words = text.splitlines()[0].split(",")
    if len(words) < first + 4:
        raise SceneError(f"{path}: has {len(words)} fields in line 1 where {first + 4} or more are needed.", remedy)
    for name, word in zip(names, words[first : first + 4], strict=True):
        try:
            value = real(word)
            if not math.isfinite(value):
                raise ValueError
        except ValueError:
            raise SceneError(
                f"{path}: has {shown(word.strip())} in line 1, which is not a finite number.", remedy
            ) from None
        low, high, unit = _LIMITS[name]
        if not low <= value <= high:
            raise SceneError(f"{path}: has the {name} {value:g}, but allowed is from {low} to {high}{unit}.")


def _parsed(reader: str, text: str, path: Path, **how: Any) -> tuple[Any, dict[str, Any]]:
    try:
        with quiet_pvlib() as pvlib:
            table, site = getattr(pvlib.iotools, reader)(io.StringIO(text), **how)
        for name in ("latitude", "longitude", "TZ", "altitude"):
            site[name] = float(site[name])
        for name in table.columns[table.columns.duplicated()]:
            raise SceneError(f"{path}: has two columns of {shown(str(name))}.", "Leave one of them.")
    except GlpathError:
        raise
    # Broken files make pvlib and pandas raise exceptions of any kind.
    except Exception as error:
        # Cut off pandas' advice to programmers.
        reason = (str(error).splitlines() or [""])[0].partition(" You might want")[0]
        raise SceneError(
            f"{path}: is broken: {type(error).__name__}: {reason}",
            "A row an hour, after the head of the format.",
        ) from error
    return table, site


def _with_lines(table: Any, lines: list[int]) -> Any:
    """Return a table with a column `line`: the number, from 1, of the file line that holds each row."""
    return table.assign(line=lines if len(lines) == len(table) else np.arange(1, len(table) + 1))


def _without_zone(table: Any) -> Times:
    return np.asarray(table.index.tz_localize(None).to_numpy().astype("datetime64[s]"))


def _checked(table: Any, site: dict[str, Any], begin: Times, source: str) -> Weather:
    """Return the checked weather of a table. Raises SceneError and warns as `read_weather` does."""
    if np.isnat(begin).any():
        raise SceneError(f"{source}: has no date in line {table['line'].iloc[int(np.argmax(np.isnat(begin)))]}.")
    latitude, longitude, zone = site["latitude"], site["longitude"], site["TZ"]
    if not len(begin):
        raise SceneError(f"{source}: has no hour.")
    times = _of_one_year(begin)
    year = int(times[0].astype("datetime64[Y]").astype(np.int64)) + 1970
    if year not in YEARS:
        raise SceneError(f"{source}: has the year {year}, but allowed is from {YEARS[0]} to {YEARS[-1]}.")
    steps = np.diff(times).astype(np.int64)
    new_year = np.flatnonzero(steps <= 0)
    if len(new_year) == 1 and times[-1] < times[0]:  # hours are rotated, because the year may start in any month
        order = np.roll(np.arange(len(times)), -int(new_year[0]) - 1)
        table, times = table.iloc[order], times[order]
        steps = np.diff(times).astype(np.int64)
    if (steps <= 0).any():
        row = int(np.flatnonzero(steps <= 0)[0]) + 1
        before, line = table["line"].iloc[[row - 1, row]]
        raise SceneError(
            f"{source}: its line {line} is of {_shown(times[row])}, but the hour before, in line {before}, is not "
            f"earlier: {_shown(times[row - 1])}.",
            "A row an hour, in the order of time. Files with several rows an hour are not read.",
        )
    dew = _column(table, "temp_dew", source) if "temp_dew" in table else np.full(len(times), np.nan)
    dew = np.where(np.abs(dew) < 90, dew, np.nan)
    periods = site.get("periods", [_WHOLE_YEAR])
    if len(periods) == 1:  # a gap between the first and the last row is missing; one between two periods is not
        first, last = _day_of_year(begin[[0, -1]]).tolist()
        periods = [*periods, (first, last)]
    hours = _with_missing_hours(times, periods)
    values = np.full((4, len(hours)), np.nan)
    rows = np.searchsorted(hours, times)
    values[:, rows] = *(_irradiance(table, name, source) for name in ("dni", "dhi", "ghi")), dew
    direct, diffuse, total, dew = values
    missing = ~(np.isfinite(direct) & np.isfinite(diffuse))
    direct[missing] = diffuse[missing] = 0.0
    weather = Weather(
        source,
        str(site["name"]).strip(' "'),
        latitude,
        longitude,
        zone,
        site["altitude"],
        hours,
        direct,
        diffuse,
        dew,
    )
    down = (weather.sun.altitude <= 0) & (direct + diffuse > 0)
    known = np.isfinite(total) & ~missing
    lit = known & (weather.sun.altitude > 0)
    of_sun = direct * np.sin(np.radians(np.maximum(weather.sun.altitude, 0.0)))
    off = float(np.abs(total - of_sun - diffuse)[lit].sum() + (direct + diffuse)[down].sum())
    light = float(total[known].sum())
    direct[down] = diffuse[down] = 0.0
    _report(weather, np.setdiff1d(hours, times), int(missing[rows].sum()), off / light if light > 0 else 0.0)
    object.__setattr__(weather, "missing", int(missing.sum()))
    object.__setattr__(weather, "after_dark", int(down.sum()))
    return weather


def _of_one_year(begin: Times) -> Times:
    """Return dates moved to one year, because the months of a typical year are from several years."""
    years = begin.astype("datetime64[Y]")
    if (years == years[0]).all():
        return begin
    month, day, _ = _in_year(begin)
    year = TYPICAL_YEAR + bool(((month == 1) & (day == 28)).any())
    first = np.datetime64(str(year), "M") + month
    in_month = begin - begin.astype("datetime64[M]").astype("datetime64[s]")
    return np.asarray(first.astype("datetime64[s]") + in_month)


def _day_of_year(times: Times) -> NDArray[np.int64]:
    """Return 100 * month + day of each time, both counted from 1."""
    month, day, _ = _in_year(times)
    return np.asarray(100 * (month + 1) + day + 1)


def _with_missing_hours(times: Times, periods: list[tuple[int, int]]) -> Times:
    """Return `times`, all of one year, and each hour of the periods that contains none of them, in ascending order.

    Times need not be full hours. 29 February is left out if it has no hour in `times`, because typical years have
    no such day.

    periods : first and last day of each, 100 * month + day; the first may be later, for a period over New Year
    """
    year = times[0].astype("datetime64[Y]")
    hours = np.arange(year, year + 1, dtype="datetime64[h]").astype("datetime64[s]")
    day = _day_of_year(hours)
    expected = np.zeros(len(hours), np.bool_)
    for first, last in periods:
        expected |= (day >= first) & (day <= last) if first <= last else (day >= first) | (day <= last)
    if _LEAP_DAY not in _day_of_year(times):
        expected &= day != _LEAP_DAY
    return np.union1d(times, np.setdiff1d(hours[expected], times.astype("datetime64[h]")))


def _irradiance(table: Any, name: str, source: str) -> Float64:
    """Return the (H,) irradiance in W m^-2, NaN if missing. Raises SceneError for invalid values."""
    if name not in table:
        raise SceneError(f"{source}: has no column of {name}.")
    found = _column(table, name, source)
    found[~np.isfinite(found) | (np.abs(found) >= _MISSING)] = np.nan
    negative = np.flatnonzero(found < 0)
    lowest = float(np.nanmin(found, initial=0.0))
    if len(negative) and lowest >= _MIN_NOISE:
        warn(
            f"{source}: {len(negative):,} values of {name} are below 0, the lowest {lowest:g} W/m2, as "
            "pyranometers show at night. They count as 0."
        )
        found[negative] = 0.0
    elif len(negative):
        row = int(np.nanargmin(found))
        raise SceneError(
            f"{source}: has {found[row]:g} W/m2 of {name} in line {table['line'].iloc[row]}, but light cannot be "
            "negative."
        )
    return found


def _column(table: Any, name: str, source: str) -> Float64:
    """Return the (H,) values of a column. Raises SceneError for a value that is not a number."""
    column = table[name]
    if column.dtype.kind in "fiu":
        return np.array(column, np.float64)
    for line, value in zip(table["line"], column, strict=True):
        try:
            real(str(value))
        except ValueError:
            raise SceneError(
                f"{source}: has {shown(str(value))} as {name} in line {line}, which is not a number."
            ) from None
    return np.array([real(str(value)) for value in column])


def _report(weather: Weather, absent: Times, missing: int, off: float) -> None:
    source, hours = weather.source, len(weather.times)
    if len(absent):
        warn(
            f"{source}: {len(absent):,} of {hours:,} hours are missing, the first at {_shown(absent[0])}; they "
            "count as dark."
        )
    if missing:
        warn(f"{source}: {missing:,} of {hours:,} hours have no irradiance; they count as dark.")
    if abs(15 * weather.time_zone - weather.longitude) > _ZONE:
        hours_off = abs(weather.time_zone - weather.longitude / 15)
        warn(
            f"{source}: the time zone {weather.time_zone:+g} is {hours_off:.1f} hours from the longitude "
            f"{weather.longitude:g}."
        )
    if off > _CLOSURE:
        warn(
            f"{source}: the light of sun and sky differs by {off:.0%} from the global light of the file: the sun "
            f"is not where it shone from. Check the latitude {weather.latitude:g} (south is negative), the "
            f"longitude {weather.longitude:g} (west is negative) and the time zone {weather.time_zone:+g}."
        )


def _in_year(times: Times) -> NDArray[np.int64]:
    """Return (3, N) month, day and hour of times (N,), each counted from 0."""
    months, days, hours = (times.astype(f"datetime64[{unit}]") for unit in "MDh")
    return np.stack([
        months.astype(np.int64) % 12,
        (days - months.astype("datetime64[D]")).astype(np.int64),
        (hours - days.astype("datetime64[h]")).astype(np.int64),
    ])  # fmt: skip


def _shown(time: np.datetime64) -> str:
    return str(time.astype("datetime64[m]"))[5:].replace("T", " ")
