"""What lighting engineers count of a year: daylight autonomy, useful daylight, annual sunlight; when blinds close.

All functions take hours that count, such as those in which a room is occupied.

Source:   Reinhart & Walkenhorst 2001 for daylight autonomy; Nabil & Mardaljevic 2006, Useful daylight illuminances,
          with the bounds of Mardaljevic et al. 2012; IES LM-83-12, Spatial daylight autonomy (sDA) and annual
          sunlight exposure (ASE), for the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: lx of daylight autonomy, and the share of the time that sDA asks of a sensor.
AUTONOMY, AUTONOMY_SHARE = 300.0, 0.5
#: lx that useful daylight is divided by: too little, to be supplemented, enough, too much.
USEFUL = (100.0, 300.0, 3000.0)
#: lx by the sun alone, and hours of the year that ASE allows them to a sensor.
SUNLIGHT, SUNLIGHT_HOURS = 1000.0, 250.0
#: Share of the sensors in sunlight at which blinds close.
BLINDS = 0.02


def daylight_autonomy(lux: ArrayLike, threshold: float = AUTONOMY) -> Float64:
    """(N,) float64: shares of the hours with `threshold` lx or more.

    lux : (N, H) of sensors in hours
    """
    return np.asarray(np.mean(np.asarray(lux) >= threshold, axis=1))


def useful_daylight(lux: ArrayLike, bounds: tuple[float, float, float] = USEFUL) -> Float64:
    """(N, 4) float64: shares of the hours below the first bound, up to each next one, and above the last.

    lux : (N, H) of sensors in hours
    """
    values = np.asarray(lux)
    first, middle, last = bounds
    low, enough, much = values < first, values < middle, values > last
    return np.stack(
        [low.mean(axis=1), (enough & ~low).mean(axis=1), (~enough & ~much).mean(axis=1), much.mean(axis=1)], axis=1
    )


def sunlit_share(sunlight: ArrayLike, limit: float = SUNLIGHT) -> Float64:
    """(H,) float64: in each hour, the share of the sensors with `limit` lx or more by the sun alone.

    sunlight : (N, H) lx, straight from the sun through windows without blinds
    """
    return np.asarray(np.mean(np.asarray(sunlight) >= limit, axis=0))


def blinds_closed(sunlit: ArrayLike, share: float = BLINDS) -> Bools:
    """(H,) bool: the blinds are closed, as more than `share` of the sensors are in sunlight.

    sunlit : (H,) of `sunlit_share`
    """
    return np.asarray(np.asarray(sunlit) > share)


def spatial_autonomy(autonomy: ArrayLike, share: float = AUTONOMY_SHARE) -> float:
    """The share of the sensors whose daylight autonomy is `share` or more. sDA where blinds are operated."""
    return float(np.mean(np.asarray(autonomy) >= share))


def sunlight_exposure(hours: ArrayLike, limit: float = SUNLIGHT_HOURS) -> float:
    """ASE: the share of the sensors that have more than `limit` hours of sunlight in a year.

    hours : (N,), occupied, of `SUNLIGHT` lx or more by the sun alone, without blinds
    """
    return float(np.mean(np.asarray(hours) > limit))
