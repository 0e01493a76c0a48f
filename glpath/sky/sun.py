"""Disc of the sun: a small part of the sky with uniform radiance.

The disc belongs to a sky (`glpath.sky.sky.Environment`), but is separate from the texels of its map. Eyes,
mirrors and thin dielectrics see it. Light samples are drawn inside it with a density proportional to its fraction
of the sky's light.

Cost:     a comparison for each ray that reaches the sky.
Poor at:  caustics: few paths find sunlight that a mirror or solid glass sends to a diffuse surface.
Source:   0.533 degrees is the mean diameter, as in Radiance's gendaylit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.errors import SceneError
from glpath.system.digest import digest_of
from glpath.system.vectors import perpendicular

Float64 = NDArray[np.float64]

#: Diameter of the sun in degrees, seen from the earth.
SUN_DIAMETER = 0.533


@dataclass(frozen=True, eq=False)
class Sun:
    """Disc in the sky.

    direction  : (3,) float64 unit, towards its centre
    irradiance : (3,) float64 >= 0, linear Rec. 709, of a surface that faces it: W m^-2, or lx in photometric scenes
    diameter   : degrees, above 0 and below 180

    Raises SceneError for other values.
    """

    direction: Float64
    irradiance: Float64
    diameter: float = SUN_DIAMETER

    def __post_init__(self) -> None:
        if not 0 < self.diameter < 180:
            raise SceneError(f"Sun.diameter: {self.diameter:g}, but must be above 0 and below 180 degrees.")
        if not (np.isfinite(self.irradiance).all() and np.min(self.irradiance) >= 0):
            raise SceneError(f"Sun.irradiance: {self.irradiance}, but must be three numbers, 0 or more.")
        length = float(np.linalg.norm(self.direction))
        if not abs(length - 1) < 1e-6:
            raise SceneError(f"Sun.direction: of length {length:g}, but must be a unit vector.")

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hex) of everything that changes the image; see `glpath.system.digest`."""
        return digest_of(self.direction, self.irradiance, self.diameter)

    @property
    def square_chord(self) -> float:
        """Squared chord from centre to rim on the unit sphere: accurate in 32 bits, unlike the cosine."""
        return float(4 * np.sin(np.radians(self.diameter) / 4) ** 2)

    @property
    def solid_angle(self) -> float:
        """Solid angle of the disc in steradians."""
        return float(np.pi * self.square_chord)

    @property
    def radiance_of_disc(self) -> Float64:
        """Radiance (3,) of the disc, W sr^-1 m^-2, or cd m^-2 in photometric scenes."""
        return np.asarray(self.irradiance / (np.pi * np.sin(np.radians(self.diameter) / 2) ** 2))

    @property
    def integral(self) -> Float64:
        """Integral (3,) of the radiance over all directions, W m^-2."""
        return self.radiance_of_disc * self.solid_angle

    def radiance(self, directions: ArrayLike) -> Float64:
        """Return the (..., 3) radiance in unit directions (..., 3). `lights/sky.glsl` is the GPU version.

        The unit is W sr^-1 m^-2.
        """
        apart = np.asarray(directions, np.float64) - self.direction
        inside = np.einsum("...i,...i->...", apart, apart) < self.square_chord
        return np.asarray(inside[..., None] * self.radiance_of_disc)

    def directions(self, u: Float64) -> Float64:
        """Return (N, 3) unit directions, uniform over the disc, from u (N, 2) in [0, 1)."""
        below = 0.5 * self.square_chord * u[:, 0]  # 1 - cosine
        r, phi = np.sqrt(below * (2 - below)), 2 * np.pi * u[:, 1]
        x = perpendicular(self.direction)
        y = np.cross(self.direction, x)
        return np.asarray(
            (r * np.cos(phi))[:, None] * x + (r * np.sin(phi))[:, None] * y + (1 - below)[:, None] * self.direction
        )
