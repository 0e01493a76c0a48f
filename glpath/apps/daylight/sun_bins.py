"""Sun positions that represent all positions of the sun in a year at a latitude.

The sun's band is a rectangle of hour angles and declinations. It is divided into square bins, as small as their
maximum number allows. Bins that lie wholly below the horizon are left out.

Poor at:  weather of a few days, which has fewer suns than there are bins.
Source:   Cooper 1969, The absorption of radiation in solar stills, for the obliquity; McNeil 2013, The five-phase
          method, for suns in bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.apps.daylight.compass import Compass
from glpath.errors import UsageError
from glpath.system.arguments import check_count

Float64 = NDArray[np.float64]

#: Maximum declination of the sun, degrees.
OBLIQUITY = 23.45
#: Default maximum number of bins.
MAX_BINS = 600
#: Maximum value of the option `suns`.
MAX_SUNS = 100_000


@dataclass(frozen=True)
class SunBins:
    """Sun positions at a latitude.

    directions : (S, 3) unit vectors of the scene, all above the horizon
    spacing    : approximate angle between neighbouring bins, degrees
    latitude   : degrees, positive in the north
    """

    directions: Float64
    spacing: float
    latitude: float

    @classmethod
    def of(cls, latitude: float, compass: Compass, count: int = MAX_BINS) -> SunBins:
        """Return at most `count` bins. Raises UsageError for an invalid latitude and a count below 1."""
        if not -90.0 <= latitude <= 90.0:
            raise UsageError(f"latitude {latitude:g}: must be from -90 to 90 degrees, positive in the north.")
        check_count("suns", count, 1, MAX_SUNS)
        # Bisect the number of rows of declinations. If even one row has too many bins, some of them are chosen
        # below.
        low, high = 1, 1
        while len(_bins(latitude, high)[0]) <= count:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if len(_bins(latitude, middle)[0]) <= count else (low, middle)
        azimuth, sine = _bins(latitude, low)
        if len(azimuth) > count:  # even one row of declinations has more bins than `count`
            chosen = np.unique(np.linspace(0, len(azimuth) - 1, count).round().astype(int))
            azimuth, sine = azimuth[chosen], sine[chosen]
        return cls(compass.directions(azimuth, sine), 2.0 * OBLIQUITY / low, latitude)

    def nearest(self, directions: ArrayLike) -> NDArray[np.intp]:
        """Return the index (N,) of the bin nearest to each unit direction (N, 3)."""
        found = np.asarray(directions, np.float64)
        return np.concatenate(
            [
                np.argmax(found[first : first + 4096] @ self.directions.T, axis=1)
                for first in range(0, len(found), 4096)
            ]
            or [np.zeros(0, np.intp)]
        )


def sun_angles(latitude: float, declination: ArrayLike, hour_angle: ArrayLike) -> tuple[Float64, Float64]:
    """Return azimuths from north over east, and sines of the altitude; all angles are in radians.

    hour_angle : 0 at noon, positive in the afternoon
    """
    d, h = np.broadcast_arrays(np.asarray(declination, np.float64), np.asarray(hour_angle, np.float64))
    sine = np.sin(latitude) * np.sin(d) + np.cos(latitude) * np.cos(d) * np.cos(h)
    east = -np.cos(d) * np.sin(h)
    north = np.cos(latitude) * np.sin(d) - np.sin(latitude) * np.cos(d) * np.cos(h)
    return np.arctan2(east, north), np.clip(sine, -1.0, 1.0)


def _bins(latitude: float, rows: int) -> tuple[Float64, Float64]:
    """Return azimuths and sines of the altitude of the bins for a number of rows of declinations."""
    step = 2.0 * np.radians(OBLIQUITY) / rows
    declination = -np.radians(OBLIQUITY) + step * (np.arange(rows) + 0.5)
    columns = max(4, round(2.0 * np.pi / step))
    hour = 2.0 * np.pi * (np.arange(columns) + 0.5) / columns - np.pi
    azimuth, sine = sun_angles(np.radians(latitude), declination[:, None], hour)
    # A bin with its centre below the horizon may still have an edge above it.
    up = sine > -np.sin(0.5 * step)
    return azimuth[up], np.maximum(sine[up], np.sin(0.05 * step))
