"""Sun positions and irradiance of clear days from pvlib, which is optional: `pip install "glpath[sky]"`.

Times are UTC. Altitudes are degrees above the horizon, with the refraction of standard air. Azimuths are degrees
from north towards east, so that east is 90.

Source:   Reda & Andreas 2004, Solar position algorithm for solar radiation applications, Solar Energy 76 (5), good
          to 0.0003 degrees from the year -2000 to 6000; Ineichen & Perez 2002 for the clear day.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import GlpathError, warning_filter
from glpath.system.bounded_reading import without_bounds

Float64 = NDArray[np.float64]
Times = NDArray[np.datetime64]

#: Years of times. 64 bits of nanoseconds, with which pvlib may compute, hold no others, and would wrap around.
YEARS = range(1678, 2262)
# Maximum distance of the sun from the horizon, degrees, in the middle of an hour in which it rises or sets. The sun
# moves 7.5 degrees in half an hour.
_LOW = 12.0


class SunPosition(NamedTuple):
    """Altitude above the horizon, and azimuth from north towards east: (N,) float64 each, degrees."""

    altitude: Float64
    azimuth: Float64


@contextmanager
def quiet_pvlib() -> Iterator[Any]:
    """Yield the module pvlib, in a context in which pvlib and its libraries give no warnings to this thread.

    Raises GlpathError with the command that installs pvlib if it is missing.
    """
    with warning_filter("ignore"):
        try:
            with without_bounds():
                import pvlib
        except ImportError:
            raise GlpathError(
                "The sun of a site and time, and weather files, need the package pvlib, which is not installed.",
                'pip install "glpath[sky]"; or give the sun by `altitude` and `azimuth`, `direct` and `diffuse`.',
            ) from None
        yield pvlib


def sun_positions(times: Times, latitude: float, longitude: float, elevation: float = 0.0) -> SunPosition:
    """Return the sun positions at times (N,), UTC, for a site.

    latitude, longitude : degrees, north and east
    elevation           : metres above the sea, for refraction

    Raises GlpathError if pvlib is missing.
    """
    with quiet_pvlib() as pvlib:
        found = pvlib.solarposition.get_solarposition(_index(times), latitude, longitude, altitude=elevation)
    return SunPosition(
        found["apparent_elevation"].to_numpy(np.float64), found["azimuth"].to_numpy(np.float64) % 360.0
    )


def sun_of_hours(begin: Times, latitude: float, longitude: float, elevation: float = 0.0) -> SunPosition:
    """Return the sun positions in the middle of the hours that begin at times (N,).

    If the sun rises or sets in an hour, its position is taken in the middle of the time that the sun is up. In the
    middle of the hour it may be below the horizon, although the hour has light. An altitude below 0 means that the
    sun is down for the whole hour.
    """
    begin = np.asarray(begin, "datetime64[s]")
    middle = sun_positions(begin + _seconds(0.5), latitude, longitude, elevation)
    low = np.flatnonzero(np.abs(middle.altitude) < _LOW)
    edges = np.concatenate([begin[low], begin[low] + _seconds(1.0)])
    first, last = sun_positions(edges, latitude, longitude, elevation).altitude.reshape(2, -1)
    partly = (first > 0) != (last > 0)
    low, first, last = low[partly], first[partly], last[partly]
    if not len(low):
        return middle
    crosses = first / (first - last)
    while_up = np.where(first > 0, crosses / 2, (1 + crosses) / 2)
    there = sun_positions(begin[low] + _seconds(while_up), latitude, longitude, elevation)
    found = SunPosition(middle.altitude.copy(), middle.azimuth.copy())
    found.altitude[low], found.azimuth[low] = there.altitude, there.azimuth
    return found


def _seconds(hours: ArrayLike) -> NDArray[np.timedelta64]:
    return np.asarray(np.rint(3600 * np.asarray(hours)).astype("timedelta64[s]"))


def _index(times: Times) -> Any:
    import pandas

    return pandas.DatetimeIndex(np.asarray(times, "datetime64[ns]")).tz_localize("UTC")


def clear_day(times: Times, latitude: float, longitude: float) -> tuple[Float64, Float64]:
    """Return the irradiance of a cloudless sky, (N,) each, W m^-2: direct normal, and diffuse horizontal.

    Haze is the monthly mean of the site, from tables of pvlib.

    times : (N,), UTC
    """
    with quiet_pvlib() as pvlib:
        site = pvlib.location.Location(latitude, longitude, tz="UTC")
        found = site.get_clearsky(_index(times), model="ineichen")
    return found["dni"].to_numpy(np.float64), found["dhi"].to_numpy(np.float64)
