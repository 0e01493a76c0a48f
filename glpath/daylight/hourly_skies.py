"""The skies of a year's hours as radiances of patches, and its suns as irradiances of positions of the sun.

Each hour has the sky of Perez' all-weather model, with the diffuse irradiance that the weather file says: the sum
over the patches gives it exactly to open ground. Its sun is seen where the nearest position is.

Cost:     a second for a year.
Poor at:  the edges of shadows, which the sun's positions blur, by as much as these are apart.
Source:   Bourgeois, Reinhart & Ward 2008, Standard daylight coefficient model for dynamic daylighting simulations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from glpath.daylight.coefficients import DaylightCoefficients
from glpath.daylight.sky_patches import SkyPatches
from glpath.io.weather import Weather

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: W m^-2 of the sun's whole spectrum, or lx.
Quantity = Literal["irradiance", "illuminance"]

# Directions of each patch that its radiance is the mean of; few where the patches are small.
_SAMPLES = {1: 16, 2: 4, 4: 1}
# Hours at once: of 2,336 directions 10 MB in floats.
_HOURS = 512


@dataclass(frozen=True, eq=False)
class HourlySkies:
    """Of L hours that are lit.

    hours     : (L,) int, their numbers in the year
    shape     : (P, L) float32, radiance of the patches for a diffuse irradiance of one; 0 of the ground
    to_sun    : (L, 3) float64, unit
    position  : (L,) int, that the sun is nearest to
    sine      : (L,) float64, of the sun's altitude
    diffuse   : (L,) float64, W m^-2 of a horizontal surface by the sky alone
    direct    : (L,) float64, W m^-2 of a surface that faces the sun
    sky_efficacy, sun_efficacy : (L,) float64, lm W^-1
    ground    : albedo of what lies below the horizon
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
        """For the patches and positions of `coefficients`."""
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
        """(P, L) float32: of the ground and the patches, per steradian; open ground has `diffuse` of all."""
        diffuse = self.diffuse * (self.sky_efficacy if quantity == "illuminance" else 1.0)
        found = self.shape * diffuse.astype(np.float32)
        found[0] = self.ground / np.pi * (diffuse + self.sun(quantity) * self.sine)
        return np.asarray(found, np.float32)

    def sun(self, quantity: Quantity) -> Float64:
        """(L,) float64, of a surface that faces the sun."""
        return self.direct * self.sun_efficacy if quantity == "illuminance" else self.direct


def nearest(directions: Float64, positions: Float64) -> NDArray[np.intp]:
    """(N,): the position that each direction is nearest to; both (..., 3), unit."""
    parts = [np.argmax(directions[i : i + 4096] @ positions.T, axis=1) for i in range(0, len(directions), 4096)]
    return np.concatenate(parts) if parts else np.zeros(0, np.intp)


def horizontal_weights(patches: SkyPatches) -> Float64:
    """(P,): irradiance of open ground for unit radiance of each patch; 0 of the ground."""
    azimuth_from, azimuth_to, low, high = patches.bounds.T
    found = 0.5 * (azimuth_to - azimuth_from) * (high**2 - low**2)
    found[0] = 0.0
    return np.asarray(found)


def _shape(weather: Weather, lit: NDArray[np.intp], to_sun: Float64, coefficients: DaylightCoefficients) -> Float32:
    """(P, L)"""
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
