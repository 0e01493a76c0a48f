"""All-weather sky of Perez: appearance of a sky with a given direct and diffuse irradiance.

The irradiances and the sun's height determine the clearness and brightness of a sky. These select one of eight rows
of coefficients, and so the five parameters of the sky's relative luminance. The luminance has a gradation from
zenith to horizon, and a halo around the sun. The diffuse irradiance sets its absolute value. An earlier paper of
the same group gives the luminous efficacy of daylight, which converts watts of the whole solar spectrum to lumens.

All functions take numbers or arrays, such as the hours of a year.

Poor at:  a sun below the horizon; colours, which the model does not define: the sky is white; single clouds.
Source:   Perez, Seals & Michalsky 1993, All-weather model for sky luminance distribution, Solar Energy 50 (3), with
          their erratum in 51 (5); Perez, Ineichen, Seals, Michalsky & Stewart 1990, Modeling daylight availability
          and irradiance components from direct and global irradiance, Solar Energy 44 (5), tables 1 and 4; Kasten
          1966 for the air mass. A sky outside the range of the model is replaced by the nearest one inside, as in
          Radiance's gendaylit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.sky.maps import SKY_SIZE, horizontal_irradiance, texel_directions
from glpath.sky.sky import Environment
from glpath.sky.sun import Sun

Float64 = NDArray[np.float64]

#: Irradiance above the atmosphere in W m^-2, at the mean distance from the sun.
SOLAR_CONSTANT = 1367.0
#: Precipitable water in centimetres if no dew point is known.
PRECIPITABLE_WATER = 2.0

# Clearness at which each row of coefficients begins, from the second row on.
_BINS = np.array([1.065, 1.230, 1.500, 1.950, 2.800, 4.500, 6.200])
_CLEARNESS, _BRIGHTNESS = (1.0, 12.0), (0.01, 0.6)
# Perez 1993, table 1: for each row, x1 to x4 of a, b, c, d and e.
_COEFFICIENTS = np.array([
    [1.3525, -0.2576, -0.2690, -1.4366, -0.7670, 0.0007, 1.2734, -0.1233, 2.8000, 0.6004,
     1.2375, 1.0000, 1.8734, 0.6297, 0.9738, 0.2809, 0.0356, -0.1246, -0.5718, 0.9938],
    [-1.2219, -0.7730, 1.4148, 1.1016, -0.2054, 0.0367, -3.9128, 0.9156, 6.9750, 0.1774,
     6.4477, -0.1239, -1.5798, -0.5081, -1.7812, 0.1080, 0.2624, 0.0672, -0.2190, -0.4285],
    [-1.1000, -0.2515, 0.8952, 0.0156, 0.2782, -0.1812, -4.5000, 1.1766, 24.7219, -13.0812,
     -37.7000, 34.8438, -5.0000, 1.5218, 3.9229, -2.6204, -0.0156, 0.1597, 0.4199, -0.5562],
    [-0.5484, -0.6654, -0.2672, 0.7117, 0.7234, -0.6219, -5.6812, 2.6297, 33.3389, -18.3000,
     -62.2500, 52.0781, -3.5000, 0.0016, 1.1477, 0.1062, 0.4659, -0.3296, -0.0876, -0.0329],
    [-0.6000, -0.3566, -2.5000, 2.3250, 0.2937, 0.0496, -5.6812, 1.8415, 21.0000, -4.7656,
     -21.5906, 7.2492, -3.5000, -0.1554, 1.4062, 0.3988, 0.0032, 0.0766, -0.0656, -0.1294],
    [-1.0156, -0.3670, 1.0078, 1.4051, 0.2875, -0.5328, -3.8500, 3.3750, 14.0000, -0.9999,
     -7.1406, 7.5469, -3.4000, -0.1078, -1.0750, 1.5702, -0.0672, 0.4016, 0.3017, -0.4844],
    [-1.0000, 0.0211, 0.5025, -0.5119, -0.3000, 0.1922, 0.7023, -1.6317, 19.0000, -5.0000,
     1.2438, -1.9094, -4.0000, 0.0250, 0.3844, 0.2656, 1.0468, -0.3788, -2.4517, 1.4656],
    [-1.0500, 0.0289, 0.4260, 0.3590, -0.3250, 0.1156, 0.7781, 0.0025, 31.0625, -14.5000,
     -46.1148, 55.3750, -7.2312, 0.4050, 13.3500, 0.6234, 1.5000, -0.6426, 1.8564, 0.5636],
]).reshape(8, 5, 4)  # fmt: skip
# Perez 1990, table 4: coefficients a to d of the luminous efficacy, first of diffuse, then of direct light.
_DIFFUSE_EFFICACY = np.array([
    [97.24, -0.46, 12.00, -8.91], [107.22, 1.15, 0.59, -3.95], [104.97, 2.96, -5.53, -8.77],
    [102.39, 5.59, -13.95, -13.90], [100.71, 5.94, -22.75, -23.74], [106.42, 3.83, -36.15, -28.83],
    [141.88, 1.90, -53.24, -14.03], [152.23, 0.35, -45.27, -7.98],
])  # fmt: skip
_DIRECT_EFFICACY = np.array([
    [57.20, -4.55, -2.98, 117.12], [98.99, -3.46, -1.21, 12.38], [109.83, -4.90, -1.71, -8.81],
    [110.34, -5.84, -1.99, -4.56], [106.36, -3.97, -1.75, -6.16], [107.19, -1.25, -1.51, -26.73],
    [105.75, 0.77, -1.26, -34.44], [101.18, 1.58, -1.10, -8.29],
])  # fmt: skip


class PerezSky(NamedTuple):
    """Parameters of skies; all fields are arrays of the same shape.

    zenith_angle : zenith angle of the sun, radians
    clearness    : Perez' epsilon, from 1 (overcast) to 12
    brightness   : Perez' Delta
    a, b         : parameters of the gradation
    c, d, e      : parameters of the halo
    """

    zenith_angle: Float64
    clearness: Float64
    brightness: Float64
    a: Float64
    b: Float64
    c: Float64
    d: Float64
    e: Float64

    @classmethod
    def of(
        cls,
        direct: ArrayLike,
        diffuse: ArrayLike,
        sun_altitude: ArrayLike,
        extraterrestrial: ArrayLike = SOLAR_CONSTANT,
    ) -> PerezSky:
        """Return the skies with given irradiances in W m^-2.

        direct           : irradiance of a surface that faces the sun, 0 or more
        diffuse          : irradiance of a horizontal surface by the sky alone; 0 counts as 1e-6
        sun_altitude     : degrees above the horizon, clipped to the range from 0 to 90
        extraterrestrial : irradiance above the atmosphere of a surface that faces the sun, on that day
        """
        of_sun, of_sky, altitude, above = np.broadcast_arrays(
            *(np.asarray(x, np.float64) for x in (direct, diffuse, sun_altitude, extraterrestrial))
        )
        angle = np.radians(90.0 - np.clip(altitude, 0.0, 90.0))
        of_sky = np.maximum(of_sky, 1e-6)
        cube = 1.041 * angle**3
        clearness = np.clip(((of_sky + of_sun) / of_sky + cube) / (1 + cube), *_CLEARNESS)
        brightness = np.clip(of_sky * air_mass(altitude) / above, *_BRIGHTNESS)
        row = np.searchsorted(_BINS, clearness, side="right")
        # Perez 1993, equations 6 to 9, with the bound that the authors added for intermediate skies.
        delta = np.where((clearness > 1.065) & (clearness < 2.8), np.maximum(brightness, 0.2), brightness)
        x = np.moveaxis(_COEFFICIENTS[row], (-2, -1), (0, 1))
        a, b, c, d, e = (y[0] + y[1] * angle + delta * (y[2] + y[3] * angle) for y in x)
        halo, width = _COEFFICIENTS[0, 2], _COEFFICIENTS[0, 3]
        overcast = row == 0
        c = np.where(overcast, np.exp((delta * (halo[0] + halo[1] * angle)) ** halo[2]) - halo[3], c)
        d = np.where(overcast, -np.exp(delta * (width[0] + width[1] * angle)) + width[2] + delta * width[3], d)
        return cls(angle, clearness, brightness, a, b, c, d, e)

    def relative_luminance(self, height: ArrayLike, to_sun: ArrayLike) -> Float64:
        """Return the luminance in directions, 0 or more, up to one scale factor for each sky. Shapes are broadcast.

        height : sine of the elevation; at least 0.01 is used, as in Radiance's perezlum.cal
        to_sun : cosine of the angle to the sun
        """
        cosine = np.clip(to_sun, -1.0, 1.0)
        gradation = 1 + self.a * np.exp(self.b / np.maximum(height, 0.01))
        halo = 1 + self.c * np.exp(self.d * np.arccos(cosine)) + self.e * np.square(cosine)
        return np.asarray(np.maximum(gradation * halo, 0.0))

    def diffuse_efficacy(self, water: ArrayLike = PRECIPITABLE_WATER) -> Float64:
        """Return the luminous efficacy of the sky's light, lm W^-1.

        water : precipitable water, cm
        """
        a, b, c, d = np.moveaxis(_DIFFUSE_EFFICACY[self._row], -1, 0)
        return np.asarray(a + b * water + c * np.cos(self.zenith_angle) + d * np.log(self.brightness))

    def direct_efficacy(self, water: ArrayLike = PRECIPITABLE_WATER) -> Float64:
        """Return the luminous efficacy of the sun's light, lm W^-1.

        water : precipitable water, cm
        """
        a, b, c, d = np.moveaxis(_DIRECT_EFFICACY[self._row], -1, 0)
        found = a + b * water + c * np.exp(5.73 * self.zenith_angle - 5) + d * self.brightness
        return np.asarray(np.maximum(found, 0.0))

    @property
    def _row(self) -> NDArray[np.intp]:
        return np.searchsorted(_BINS, self.clearness, side="right")


def air_mass(sun_altitude: ArrayLike) -> Float64:
    """Return the optical air mass relative to the zenith, at sun altitudes in degrees."""
    altitude = np.clip(sun_altitude, 0.0, 90.0)
    return np.asarray(1 / (np.sin(np.radians(altitude)) + 0.15 * (altitude + 3.885) ** -1.253))


def extraterrestrial(day: ArrayLike) -> Float64:
    """Return the irradiance above the atmosphere, facing the sun, in W m^-2, for days of the year, from 1.

    Source:   Spencer 1971, Fourier series representation of the position of the sun.
    """
    t = 2 * np.pi * (np.asarray(day, np.float64) - 1) / 365
    nearness = (
        1.00011 + 0.034221 * np.cos(t) + 0.00128 * np.sin(t) + 0.000719 * np.cos(2 * t) + 0.000077 * np.sin(2 * t)
    )
    return np.asarray(SOLAR_CONSTANT * nearness)


def precipitable_water(dew_point: ArrayLike) -> Float64:
    """Return the precipitable water in centimetres from the dew point in °C [Perez 1990, equation 3]."""
    return np.exp(0.07 * np.asarray(dew_point, np.float64) - 0.075)


class Daylight(NamedTuple):
    """Sky and sun with their irradiances, in W m^-2 or lx.

    sky     : a single sky, not an array of skies
    to_sun  : (3,) float64 unit, direction to the sun
    direct  : irradiance of a surface that faces the sun
    diffuse : irradiance of a horizontal surface by the sky alone
    ground  : albedo of the ground below the horizon, in [0, 1]
    """

    sky: PerezSky
    to_sun: Float64
    direct: float
    diffuse: float
    ground: float

    def environment(self, up: Float64, size: tuple[int, int] = SKY_SIZE, solar: bool = False) -> Environment:
        """Return the sky as an environment map with a sun.

        The bilinearly filtered map gives open ground exactly the diffuse irradiance `diffuse`.

        up    : (3,) float64 unit
        size  : rows and columns of the map
        solar : True if watts are of the whole solar spectrum, see `Environment`
        """
        directions = texel_directions(up, size)
        height = directions @ up
        below = height < 0
        seen = np.where(below, 0.0, self.sky.relative_luminance(height, directions @ self.to_sun))
        if self.diffuse > 0:
            seen *= self.diffuse / horizontal_irradiance(seen)
        else:
            seen[:] = 0.0
        direct = self.direct * max(float(self.to_sun @ up), 0.0)
        seen[below] = self.ground * (self.diffuse + direct) / np.pi
        sun = Sun(self.to_sun, np.full(3, self.direct)) if self.direct > 0 else None
        return Environment(
            np.repeat(seen[..., None], 3, axis=2).astype(np.float32), up, sun=sun, solar=solar, cut=True
        )
