"""Where the sun stands, and the light of a clear day: pvlib's, which is optional: `pip install "glpath[sky]"`.

Times are UTC. Altitudes are degrees above the horizon, with the refraction of standard air; azimuths degrees from
north by east.

Source:   Reda & Andreas 2004, Solar position algorithm for solar radiation applications, Solar Energy 76 (5), good
          to 0.0003 degrees from the year -2000 to 6000; Ineichen & Perez 2002 for the clear day.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import GlpathError
from glpath.scene.model import Float64

Times = NDArray[np.datetime64]

# Degrees: the sun does not rise or set in an hour in whose middle it is farther from the horizon; it moves 15.
_LOW = 12.0


class SunPosition(NamedTuple):
    """(N,) float64 each, degrees: above the horizon, and from north by east."""

    altitude: Float64
    azimuth: Float64


@contextmanager
def quiet_pvlib() -> Iterator[Any]:
    """Context with the module pvlib, in which it and its libraries give no warning.

    Raises GlpathError with the line to type if it is missing.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import pvlib
        except ImportError:
            raise GlpathError(
                "The sun of a site and time, and weather files, need the package pvlib, which is not installed.",
                'pip install "glpath[sky]"; or give the sun by `altitude` and `azimuth`, `direct` and `diffuse`.',
            ) from None
        yield pvlib


def sun_positions(times: Times, latitude: float, longitude: float, elevation: float = 0.0) -> SunPosition:
    """At times (N,), UTC, of a site.

    latitude, longitude : degrees, north and east
    elevation           : metres above the sea, for refraction

    Raises GlpathError where pvlib is missing.
    """
    with quiet_pvlib() as pvlib:
        found = pvlib.solarposition.get_solarposition(_index(times), latitude, longitude, altitude=elevation)
    return SunPosition(
        found["apparent_elevation"].to_numpy(np.float64), found["azimuth"].to_numpy(np.float64) % 360.0
    )


def sun_of_hours(begin: Times, latitude: float, longitude: float, elevation: float = 0.0) -> SunPosition:
    """Of the hours that begin at times (N,): where the sun stands in their middle.

    Of an hour in which it rises or sets: where it stands in the middle of the time that it is up, or else the light
    of that hour would come from below the horizon. An altitude below 0 means that it is down all the hour.
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
    """(N,) each, W m^-2: direct on a surface that faces the sun, and diffuse on a horizontal one, without clouds.

    The haze is the climate's, of the month, by the tables that pvlib has.

    times : (N,), UTC
    """
    with quiet_pvlib() as pvlib:
        site = pvlib.location.Location(latitude, longitude, tz="UTC")
        found = site.get_clearsky(_index(times), model="ineichen")
    return found["dni"].to_numpy(np.float64), found["dhi"].to_numpy(np.float64)
