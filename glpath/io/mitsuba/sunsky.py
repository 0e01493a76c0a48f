"""Reader of Mitsuba's `sunsky`, with Mitsuba's sun and sky irradiance, but the pattern of Perez' all-weather sky.

Poor at:  the pattern of the sky. Mitsuba's is that of Hosek & Wilkie (2012), whose colours vary towards the horizon
          and the sun; here the whole sky has one colour.
Source:   irradiances of Mitsuba 3.9.1, scalar_rgb, for an albedo of 0.3; Perez et al. 1993.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from glpath.scene.geometry import Float64
from glpath.scene.model import Environment
from glpath.sky.perez import Daylight, PerezSky
from glpath.sky.sun import Sun

if TYPE_CHECKING:
    from glpath.io.mitsuba.plugin import Plugin

_DATE = (("year", 2010), ("month", 7), ("day", 10))
# Default, maximum, and number in an hour of each part of a time.
_TIME = (("hour", 15.0, 24.0, 1), ("minute", 0.0, 60.0, 60), ("second", 0.0, 60.0, 3600))
_TURBIDITIES = (1.0, 2.0, 3.0, 5.0, 8.0, 10.0)
_ALTITUDES = (3.0, 15.0, 30.0, 60.0, 88.0)
# Irradiances, linear Rec. 709 in Mitsuba's unit: of a horizontal surface by the sky (three columns), and of a
# surface that faces the sun. Rows run over the altitudes of the first turbidity, then of the next.
_IRRADIANCES = np.array([
    [0.05412, 0.06913, 0.0736, 0.6049, 0.2211, 0.01217],
    [0.07835, 0.1392, 0.216, 1.294, 0.8985, 0.4338],
    [0.09394, 0.1786, 0.3201, 1.46, 1.154, 0.7666],
    [0.1129, 0.2123, 0.421, 1.543, 1.295, 0.9962],
    [0.1189, 0.2375, 0.4429, 1.558, 1.323, 1.045],
    [0.05829, 0.07086, 0.07366, 0.5101, 0.1866, 0.01149],
    [0.09166, 0.1489, 0.2195, 1.248, 0.8634, 0.4178],
    [0.1137, 0.1953, 0.3282, 1.433, 1.131, 0.7517],
    [0.1337, 0.2326, 0.4372, 1.526, 1.28, 0.9849],
    [0.1477, 0.2636, 0.4587, 1.544, 1.309, 1.035],
    [0.06376, 0.0733, 0.0735, 0.3883, 0.1425, 0.01022],
    [0.112, 0.164, 0.2242, 1.175, 0.8085, 0.3925],
    [0.1444, 0.2211, 0.3415, 1.39, 1.093, 0.7277],
    [0.168, 0.2672, 0.4637, 1.499, 1.255, 0.9667],
    [0.1978, 0.2935, 0.4731, 1.52, 1.287, 1.018],
    [0.0757, 0.07816, 0.07262, 0.1643, 0.06092, 0.006282],
    [0.1739, 0.2064, 0.2362, 0.9572, 0.6456, 0.3172],
    [0.2417, 0.2982, 0.3796, 1.25, 0.9725, 0.6514],
    [0.2871, 0.3789, 0.5516, 1.411, 1.173, 0.9068],
    [0.3154, 0.4107, 0.536, 1.442, 1.214, 0.9631],
    [0.08342, 0.07941, 0.06924, 0.03722, 0.01359, 0.001911],
    [0.2434, 0.2447, 0.2469, 0.6343, 0.4112, 0.207],
    [0.3789, 0.4013, 0.4315, 1.011, 0.7696, 0.5217],
    [0.5051, 0.5872, 0.7, 1.248, 1.025, 0.7977],
    [0.501, 0.5499, 0.6245, 1.297, 1.08, 0.8619],
    [0.07717, 0.06891, 0.05911, 0.00233, 0.0006866, 0.0001178],
    [0.2807, 0.2642, 0.2464, 0.2559, 0.1522, 0.08083],
    [0.5155, 0.5037, 0.4899, 0.6318, 0.4584, 0.3191],
    [0.9333, 0.9655, 0.9307, 0.9524, 0.7599, 0.6005],
    [0.7732, 0.8037, 0.8093, 1.026, 0.8332, 0.6741],
])  # fmt: skip
# Coefficients, highest power first, of a polynomial in the ground albedo. It gives the sky light relative to that
# for albedo 0.3, at turbidity 3.
_OF_ALBEDO = (0.2375, 0.239, 0.907)
# Approximate W m^-2 of daylight per Mitsuba unit. The pattern of Perez' sky depends on irradiances in watts.
_WATTS = 700.0
# Minimum altitude of the sun for the pattern of the sky, degrees.
_LOWEST = 0.01


def sun_and_sky(plugin: Plugin) -> Environment:
    """Return the sky of a `sunsky`, with its sun as a disc. It is dark if the sun is below the horizon."""
    turbidity = plugin.number("turbidity", 3.0, 1.0, 10.0)
    for name in ("sky_scale", "sun_scale"):
        plugin.number(name, 1.0, 0.0)
    albedo = plugin.share("albedo", 0.3)
    plugin.flag("complex_sun", False)
    world = plugin.transform("to_world")[:3, :3]
    local = _towards_sun(plugin, world)
    altitude = float(np.degrees(np.arcsin(np.clip(local[2], -1.0, 1.0))))
    is_dark = not altitude > 0
    altitude = max(altitude, _LOWEST)
    table = _IRRADIANCES.reshape(len(_TURBIDITIES), len(_ALTITUDES), 6)
    of_altitudes = np.array(
        [
            [np.interp(turbidity, _TURBIDITIES, table[:, row, column]) for column in range(6)]
            for row in range(len(_ALTITUDES))
        ]
    )
    both = np.array([np.interp(altitude, _ALTITUDES, column) for column in of_altitudes.T])
    of_sky = both[:3] * np.polyval(_OF_ALBEDO, albedo) * plugin.number("sky_scale", 1.0)
    of_sun = both[3:] * plugin.number("sun_scale", 1.0)
    if is_dark:
        of_sky, of_sun = 0.0 * of_sky, 0.0 * of_sun
    up, to_sun = (world @ direction for direction in (np.array([0.0, 0.0, 1.0]), local))
    up, to_sun = up / np.linalg.norm(up), to_sun / np.linalg.norm(to_sun)
    shape = PerezSky.of(_WATTS * both[3:].mean(), _WATTS * both[:3].mean(), altitude)
    grey = Daylight(shape, to_sun, 0.0, 1.0, 0.0).environment(up)
    diameter = plugin.number("sun_aperture", 0.5358, 1e-3, 179.0)
    sun = Sun(to_sun, of_sun, diameter) if of_sun.any() else None
    return Environment(grey.image * of_sky.astype(np.float32), up, sun=sun, cut=True)


def _towards_sun(plugin: Plugin, world: Float64) -> Float64:
    """Return the (3,) unit direction to the sun, z up, x to the south and y to the west.

    world : (3, 3) rotation of the sky to the world, in which `sun_direction` is given
    """
    if "sun_direction" in plugin:
        direction = plugin.vector("sun_direction")
        if not np.linalg.norm(direction) > 0:
            raise plugin.where("sun_direction").error("has the length zero.", "For example 0, 0, 1.")
        local = np.linalg.solve(world, direction)
        return np.asarray(local / np.linalg.norm(local))
    from glpath.sky.sun_position import YEARS, sun_positions

    latitude = plugin.number("latitude", 35.6894, -90.0, 90.0)
    longitude = plugin.number("longitude", 139.6917, -180.0, 180.0)
    year, month, day = (plugin.whole(name, default, 1) for name, default in _DATE)
    if year not in YEARS:
        raise plugin.where("year").error(f"is {year}, but must be between {YEARS[0]} and {YEARS[-1]}.")
    try:
        midnight = datetime(year, month, day)
    except (ValueError, OverflowError) as error:
        raise plugin.location.error(f"has a date that does not exist: {error}.") from error
    hours = sum(plugin.number(name, default, 0.0, high) / parts for name, default, high, parts in _TIME)
    utc = midnight + timedelta(hours=hours - plugin.number("timezone", 9.0, -14.0, 14.0))
    position = sun_positions(np.array([utc], "datetime64[us]"), latitude, longitude)
    a, z = np.radians(position.altitude[0]), np.radians(position.azimuth[0])
    return np.array([-np.cos(a) * np.cos(z), -np.cos(a) * np.sin(z), np.sin(a)])
