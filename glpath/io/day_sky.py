"""Build skies of type "perez" and "sun" from irradiances and a sun, a site and a time, or a weather file."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import UnsetType

from glpath.io import description
from glpath.io.values import unit
from glpath.io.weather import read_weather
from glpath.scene.model import Environment, Float64
from glpath.scene.source_location import SourceLocation
from glpath.sky.perez import PRECIPITABLE_WATER, SOLAR_CONSTANT, Daylight, PerezSky, extraterrestrial
from glpath.sky.sky import NORTH
from glpath.sky.sun_position import YEARS, clear_day, sun_positions
from glpath.system.units import EFFICACY, Unit

_WHERE = ("altitude", "azimuth", "latitude", "longitude", "timezone", "time", "weather", "north")
#: Fields that only skies of type "perez" or "sun" have.
OF_DAYS = ("direct", "diffuse", *_WHERE, "sun_disc", "spectrum")
_GROUND = {"perez": 0.2, "sun": 0.0}
# Maximum irradiance, W m^-2. Orbital eccentricity adds up to 4 % to the solar constant; a value above the maximum
# indicates a wrong unit, such as lux.
_MAX_IRRADIANCE = 1.05 * SOLAR_CONSTANT


class _Sun(NamedTuple):
    """Position of the sun, with the irradiance and the water vapour at its site or in its weather file.

    direction        : (3,) unit vector towards the sun
    altitude         : degrees above the horizon
    extraterrestrial : irradiance of a surface that faces the sun above the atmosphere, W m^-2
    irradiance       : direct normal and diffuse horizontal irradiance, W m^-2; None if fields of the sky give them
    water            : precipitable water, cm
    north            : (3,) unit vector from which azimuths count; None if the file gives `sun`
    """

    direction: Float64
    altitude: float
    extraterrestrial: float
    irradiance: tuple[float, float] | None
    water: float = PRECIPITABLE_WATER
    north: Float64 | None = None


def day_sky(
    given: description.Sky, up: Float64, location: SourceLocation, folder: Path, scene_unit: Unit
) -> Environment:
    """Return the environment of a sky of type "perez" or "sun". Raises SceneError.

    up     : (3,) unit vector
    folder : base folder of relative paths
    """
    solar = given.spectrum == "solar"
    if solar and scene_unit == "photometric":
        raise location.field("spectrum").error(
            "is solar in a photometric scene, but watts of the whole spectrum are no lux.",
            'Write unit = "radiometric" at the head of the file, or leave the spectrum out.',
        )
    if given.type == "sun" and not isinstance(given.sun_disc, UnsetType):
        raise location.field("sun_disc").error("is of the sun alone.", "Leave it out.")
    sun = _sun(given, up, location, folder)
    direct, diffuse = _irradiance(given, sun, location, solar)
    if not direct + diffuse > 0:
        raise location.error(
            "is dark: neither direct nor diffuse irradiance.", "Take another hour, or give `direct` and `diffuse`."
        )
    # PerezSky replaces a diffuse irradiance of 0 by 1e-6. Only a sun with a solar spectrum may omit `diffuse`, and
    # such a sun uses no efficacy.
    sky = PerezSky.of(direct, diffuse, sun.altitude, sun.extraterrestrial)
    scale = 1.0 if scene_unit == "photometric" else 1.0 / EFFICACY
    of_direct = 1.0 if solar else scale * float(sky.direct_efficacy(sun.water))
    of_diffuse = 1.0 if solar else scale * float(sky.diffuse_efficacy(sun.water))
    ground = _GROUND[str(given.type)] if isinstance(given.ground, UnsetType) else given.ground
    has_sky, has_sun = given.type == "perez", given.sun_disc is not False
    light = Daylight(sky, sun.direction, of_direct * direct * has_sun, of_diffuse * diffuse * has_sky, ground)
    return replace(light.environment(up, solar=solar), north=sun.north)


def north_of(up: Float64, given: object, location: SourceLocation) -> Float64:
    """Return the (3,) horizontal unit vector to the north: along `given`, or by convention if `given` is unset.

    Raises SceneError.
    """
    if isinstance(given, UnsetType):
        towards = np.array(NORTH[int(np.argmax(np.abs(up)))])
    else:
        towards = unit(given, location.field("north"), "north = [0, 1, 0]")  # type: ignore[arg-type]
    across = towards - (towards @ up) * up
    length = float(np.linalg.norm(across))
    if length < 1e-6:
        raise location.field("north").error("goes along `up`, so it is not horizontal.", "Turn it away.")
    return np.asarray(across / length)


def towards(altitude: float, azimuth: float, north: Float64, up: Float64) -> Float64:
    """Return the (3,) unit vector for an altitude and an azimuth, in degrees; azimuth 90 is east."""
    a, z = np.radians(altitude), np.radians(azimuth)
    east = np.cross(north, up)
    return np.asarray(np.cos(a) * (np.cos(z) * north + np.sin(z) * east) + np.sin(a) * up)


def _given(sky: description.Sky, *names: str) -> list[str]:
    return [name for name in names if not isinstance(getattr(sky, name), UnsetType)]


def _sun(given: description.Sky, up: Float64, location: SourceLocation, folder: Path) -> _Sun:
    """Return the sun of a sky. Raises SceneError if it is missing, given twice, or below the horizon."""
    methods = {
        "sun": _given(given, "sun"),
        "altitude and azimuth": _given(given, "altitude", "azimuth"),
        "latitude, longitude and time": _given(given, "latitude", "longitude"),
        "weather and time": _given(given, "weather"),
    }
    chosen = [method for method, names in methods.items() if names]
    if len(chosen) != 1:
        has = " and ".join(name for names in methods.values() for name in names) or "no sun"
        raise location.error(
            f"has {has}, but the position of the sun is given by one of: {'; '.join(methods)}.",
            "For example: altitude = 40 and azimuth = 180, from north by east.",
        )
    missing = [n for n in chosen[0].replace(" and ", ", ").split(", ") if not _given(given, n)]
    if missing:
        raise location.error(f"lacks the field `{missing[0]}`, which belongs to {chosen[0]}.")
    wrong = [n for n in _given(given, "time", "timezone") if "time" not in chosen[0]]
    wrong += [n for n in _given(given, "timezone", "direct", "diffuse") if chosen[0] == "weather and time"]
    wrong += _given(given, "north") if chosen[0] == "sun" else []
    if wrong:
        raise location.field(wrong[0]).error(f"says nothing beside {chosen[0]}.", "Leave one of them out.")
    if chosen[0] == "sun":
        direction = unit(given.sun, location.field("sun"), "sun = [1, 1, 0]")  # type: ignore[arg-type]
        altitude = float(np.degrees(np.arcsin(np.clip(direction @ up, -1.0, 1.0))))
        return _Sun(direction, _above(altitude, location.field("sun")), SOLAR_CONSTANT, None)
    north = north_of(up, given.north, location)
    if chosen[0] == "altitude and azimuth":
        altitude, azimuth = float(given.altitude), float(given.azimuth)  # type: ignore[arg-type]
        if altitude > 90:
            raise location.field("altitude").wrong(altitude, "from 0 to 90 degrees", "90 is overhead.")
        direction = towards(_above(altitude, location.field("altitude")), azimuth, north, up)
        return _Sun(direction, altitude, SOLAR_CONSTANT, None, north=north)
    of_time = (
        _of_site(given, up, north, location)
        if "latitude" in chosen[0]
        else _of_weather(given, up, north, location, folder)
    )
    return of_time._replace(north=north)


def _of_site(given: description.Sky, up: Float64, north: Float64, location: SourceLocation) -> _Sun:
    time = _time(given, None if isinstance(given.timezone, UnsetType) else given.timezone, location)
    latitude, longitude = float(given.latitude), float(given.longitude)  # type: ignore[arg-type]
    times = np.array([np.datetime64(time.astimezone(UTC).replace(tzinfo=None), "s")])
    altitude, azimuth = (float(x[0]) for x in sun_positions(times, latitude, longitude))
    direction = towards(_above(altitude, location.field("time")), azimuth, north, up)
    known = None
    if not _given(given, "direct", "diffuse"):
        direct, diffuse = clear_day(times, latitude, longitude)
        known = float(direct[0]), float(diffuse[0])
    day = float(extraterrestrial(time.timetuple().tm_yday))
    return _Sun(direction, altitude, day, known)


def _of_weather(
    given: description.Sky, up: Float64, north: Float64, location: SourceLocation, folder: Path
) -> _Sun:
    weather = read_weather(folder / str(given.weather))
    time = _time(given, weather.time_zone, location)
    local = time.astimezone(timezone(timedelta(hours=weather.time_zone))).replace(tzinfo=None)
    hour = weather.hour_of(np.datetime64(local, "s"))
    altitude, azimuth = (float(x[hour]) for x in weather.sun)
    direction = towards(_above(altitude, location.field("time")), azimuth, north, up)
    known = float(weather.direct_normal[hour]), float(weather.diffuse_horizontal[hour])
    day = int((weather.times[hour] - np.datetime64(weather.times[hour], "Y")).astype("timedelta64[D]").astype(int))
    return _Sun(direction, altitude, float(extraterrestrial(day + 1)), known, float(weather.water[hour]))


def _time(given: description.Sky, zone: float | None, location: SourceLocation) -> datetime:
    """Return the time of the sky with its UTC offset. Raises SceneError.

    zone : hours east of UTC, for a time without an offset; None if unknown
    """
    location = location.field("time")
    try:
        time = datetime.fromisoformat(str(given.time))
    except ValueError:
        raise location.wrong(
            str(given.time), "a date and time by ISO 8601", 'For example: time = "2024-06-21T12:00".'
        ) from None
    if time.year not in YEARS:
        raise location.wrong(str(given.time), f"of a year from {YEARS[0]} to {YEARS[-1]}")
    if time.tzinfo is None:
        if zone is None:
            raise location.error(
                "has no offset, and the sky no `timezone`.",
                'For example: timezone = 1, hours east of Greenwich, or time = "2024-06-21T12:00+02:00".',
            )
        return time.replace(tzinfo=timezone(timedelta(hours=zone)))
    if not isinstance(given.timezone, UnsetType):
        raise location.error("has an offset, and the sky a `timezone`.", "Leave one of them out.")
    return time


def _above(altitude: float, location: SourceLocation) -> float:
    if altitude < 0:
        raise location.error(
            f"puts the sun {-altitude:.1f} degrees below the horizon, where it lights nothing.",
            "Take another time, or check latitude (south is negative), longitude (west is negative) and time zone.",
        )
    return altitude


def _irradiance(given: description.Sky, sun: _Sun, location: SourceLocation, solar: bool) -> tuple[float, float]:
    """Return direct normal and diffuse horizontal irradiance, W m^-2. Raises SceneError."""
    if sun.irradiance is not None:
        return sun.irradiance
    needed = ("direct",) if given.type == "sun" and solar else ("direct", "diffuse")
    for name in needed:
        if not _given(given, name):
            why = "" if given.type == "perez" or name == "direct" else " to know the lumens of a watt of its light"
            raise location.error(
                f"lacks the field `{name}`, which a sky of type {given.type} needs{why}.",
                "Irradiance in W m^-2, for example direct = 800 and diffuse = 100. With latitude, longitude and "
                "time but without both it is a clear day.",
            )
    direct = float(given.direct)  # type: ignore[arg-type]
    diffuse = 0.0 if isinstance(given.diffuse, UnsetType) else float(given.diffuse)
    for name, value in (("direct", direct), ("diffuse", diffuse)):
        if value > _MAX_IRRADIANCE:
            raise location.field(name).error(
                f"is {value:g} W m^-2, but above the atmosphere the sun has {SOLAR_CONSTANT:g}.",
                "Irradiance in W m^-2, not illuminance in lx.",
            )
    return direct, diffuse
