"""Skies of a year's hours as radiances of sky patches, and suns as irradiances of sun positions.

Each hour has the sky of Perez' all-weather model, scaled to the diffuse irradiance of the weather file. The sum
over the patches gives open ground exactly that irradiance. The visibility of the sun is that of the nearest sun
position.

Cost:     a second for a year.
Poor at:  edges of shadows, which are inaccurate by about the distance between sun positions.
Source:   Bourgeois, Reinhart & Ward 2008, Standard daylight coefficient model for dynamic daylighting simulations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.sky_patches import SkyPatches
from glpath.io.weather import Weather

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Irradiance in W m^-2 of the sun's whole spectrum, or illuminance in lx.
Quantity = Literal["irradiance", "illuminance"]

# Number of directions over which a patch's radiance is averaged, by subdivision; small patches need few.
_SAMPLES = {1: 16, 2: 4, 4: 1}
# Number of hours in a block: 10 MB of floats for 2,336 directions.
_HOURS = 512


@dataclass(frozen=True, eq=False)
class HourlySkies:
    """Skies and suns of the L hours with light.

    hours     : (L,) int, indices of the hours in the year
    shape     : (P, L) float32, radiance of the patches for a diffuse horizontal irradiance of 1; 0 for the ground
    to_sun    : (L, 3) float64, unit vectors to the sun
    position  : (L,) int, index of the sun position nearest to the sun
    sine      : (L,) float64, sine of the sun's altitude
    diffuse   : (L,) float64, diffuse horizontal irradiance by the sky alone, W m^-2
    direct    : (L,) float64, direct normal irradiance, W m^-2
    sky_efficacy, sun_efficacy : (L,) float64, luminous efficacies, lm W^-1
    ground    : albedo of the ground below the horizon
    """

    hours: NDArray[np.intp]
    shape: Float32
    to_sun: Float64
    position: NDArray[np.intp]
    sine: Float64
    diffuse: Float64
    direct: Float64
    sky_efficacy: Float64
    sun_efficacy: Float64
    ground: float

    def __len__(self) -> int:
        return len(self.hours)

    @classmethod
    def of(cls, weather: Weather, coefficients: DaylightCoefficients, ground: float) -> HourlySkies:
        """Return the skies of a weather file for the patches and sun positions of `coefficients`."""
        altitude, azimuth = weather.sun
        lit = np.flatnonzero((altitude > 0) & (weather.direct_normal + weather.diffuse_horizontal > 0))
        sine = np.sin(np.radians(altitude[lit]))
        to_sun = coefficients.compass.directions(np.radians(azimuth[lit]), sine)
        return cls(
            lit,
            _shape(weather, lit, to_sun, coefficients),
            to_sun,
            nearest(to_sun, coefficients.suns),
            sine,
            weather.diffuse_horizontal[lit],
            weather.direct_normal[lit],
            weather.skies.diffuse_efficacy(weather.water)[lit],
            weather.skies.direct_efficacy(weather.water)[lit],
            ground,
        )

    def sky(self, quantity: Quantity) -> Float32:
        """Return (P, L) float32 radiance or luminance of ground and patches."""
        diffuse = self.diffuse * (self.sky_efficacy if quantity == "illuminance" else 1.0)
        found = self.shape * diffuse.astype(np.float32)
        found[0] = self.ground / np.pi * (diffuse + self.sun(quantity) * self.sine)
        return np.asarray(found, np.float32)

    def sun(self, quantity: Quantity) -> Float64:
        """Return (L,) float64 irradiance or illuminance of a surface that faces the sun."""
        return self.direct * self.sun_efficacy if quantity == "illuminance" else self.direct


def nearest(directions: Float64, positions: Float64) -> NDArray[np.intp]:
    """Return the index (N,) of the position nearest to each direction; both are unit vectors (..., 3)."""
    parts = [np.argmax(directions[i : i + 4096] @ positions.T, axis=1) for i in range(0, len(directions), 4096)]
    return np.concatenate(parts) if parts else np.zeros(0, np.intp)


def horizontal_weights(patches: SkyPatches) -> Float64:
    """Return (P,) irradiance of an unobstructed horizontal surface for unit radiance of each patch.

    It is 0 for patch 0, the ground.
    """
    azimuth_from, azimuth_to, low, high = patches.bounds.T
    found = 0.5 * (azimuth_to - azimuth_from) * (high**2 - low**2)
    found[0] = 0.0
    return np.asarray(found)


def _shape(weather: Weather, lit: NDArray[np.intp], to_sun: Float64, coefficients: DaylightCoefficients) -> Float32:
    """Return the `shape` (P, L) of the skies in the hours with light."""
    patches = coefficients.patches
    into = patches.directions(coefficients.compass, _SAMPLES[patches.subdivision])
    of_sky = into.patch > 0
    directions, patch = into.directions[of_sky], into.patch[of_sky]
    starts = np.flatnonzero(np.diff(patch, prepend=0))
    height = (directions @ coefficients.up)[:, None]
    level = horizontal_weights(patches)[1:].astype(np.float32)
    found = np.zeros((len(patches), len(lit)), np.float32)
    for first in range(0, len(lit), _HOURS):
        part = slice(first, first + _HOURS)
        skies = type(weather.skies)(*(each[lit[part]] for each in weather.skies))
        seen = skies.relative_luminance(height, directions @ to_sun[part].T)
        mean = np.add.reduceat(seen, starts, axis=0) / into.samples
        found[1:, part] = mean / np.maximum(level @ mean, 1e-30)
    return found
