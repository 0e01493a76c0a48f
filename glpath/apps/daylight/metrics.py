"""Annual daylight metrics: daylight autonomy, useful daylight, sunlight exposure, and the hours with closed blinds.

All functions take only the hours to count, such as those in which a room is occupied. Fractions of the
sensors are by `weights` (N,), such as areas; by default all sensors count equally.

Source:   Reinhart & Walkenhorst 2001 for daylight autonomy; Nabil & Mardaljevic 2006, Useful daylight illuminances,
          with the bounds of Mardaljevic et al. 2012; IES LM-83-12, Spatial daylight autonomy (sDA) and annual
          sunlight exposure (ASE), for the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Illuminance threshold of daylight autonomy, lx.
AUTONOMY = 300.0
#: Minimum fraction of hours with `AUTONOMY` lx or more for a sensor to count for sDA.
AUTONOMY_SHARE = 0.5
#: Bounds of useful daylight, lx, between four classes: too little, supplementary, enough, too much.
USEFUL = (100.0, 300.0, 3000.0)
#: Illuminance threshold of direct sunlight, lx.
SUNLIGHT = 1000.0
#: Hours per year with `SUNLIGHT` lx or more of direct sunlight, above which a sensor counts for ASE.
SUNLIGHT_HOURS = 250.0
#: Fraction of sensors in sunlight above which blinds close.
BLINDS = 0.02


def daylight_autonomy(lux: ArrayLike, threshold: float = AUTONOMY) -> Float64:
    """Return (N,) float64 fractions of the hours with `threshold` lx or more.

    lux : (N, H) illuminance of sensors in hours, lx
    """
    return np.asarray(np.mean(np.asarray(lux) >= threshold, axis=1))


def useful_daylight(lux: ArrayLike, bounds: tuple[float, float, float] = USEFUL) -> Float64:
    """Return (N, 4) float64 fractions of the hours below the first bound, between bounds, and above the last.

    lux : (N, H) illuminance of sensors in hours, lx
    """
    values = np.asarray(lux)
    first, middle, last = bounds
    low, enough, much = values < first, values < middle, values > last
    return np.stack(
        [low.mean(axis=1), (enough & ~low).mean(axis=1), (~enough & ~much).mean(axis=1), much.mean(axis=1)], axis=1
    )


def sunlit_share(sunlight: ArrayLike, limit: float = SUNLIGHT, weights: ArrayLike | None = None) -> Float64:
    """Return (H,) float64 fraction of the sensors with `limit` lx or more of direct sunlight in each hour.

    sunlight : (N, H) illuminance by direct sunlight through windows without blinds, lx
    """
    return _fraction(np.asarray(sunlight) >= limit, weights)


def blinds_closed(sunlit: ArrayLike, share: float = BLINDS) -> Bools:
    """Return (H,) bool, True if blinds are closed because more than `share` of the sensors are in sunlight.

    sunlit : (H,) result of `sunlit_share`
    """
    return np.asarray(np.asarray(sunlit) > share)


def spatial_autonomy(autonomy: ArrayLike, share: float = AUTONOMY_SHARE, weights: ArrayLike | None = None) -> float:
    """Return the fraction of sensors with a daylight autonomy of `share` or more: sDA if blinds are operated."""
    return float(_fraction(np.asarray(autonomy) >= share, weights))


def sunlight_exposure(hours: ArrayLike, limit: float = SUNLIGHT_HOURS, weights: ArrayLike | None = None) -> float:
    """Return ASE, the fraction of sensors that have more than `limit` hours of sunlight in a year.

    hours : (N,) occupied hours with `SUNLIGHT` lx or more of direct sunlight, without blinds
    """
    return float(_fraction(np.asarray(hours) > limit, weights))


def _fraction(condition: Bools, weights: ArrayLike | None) -> Float64:
    """Return the fraction of sensors, along the first axis, for which `condition` is True."""
    weight = np.ones(len(condition)) if weights is None else np.asarray(weights, np.float64)
    return np.asarray(weight @ condition / weight.sum())
