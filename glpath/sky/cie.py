"""The fifteen skies of the CIE general sky, from overcast to clear and turbid, as environment maps.

The luminance of a sky relative to its zenith is a product of two factors. The gradation depends on the elevation,
the indicatrix on the angle to the sun. The sun's disc is not included: add a directional light. The ground is black
without an albedo.

Cost:     an environment map of 512 x 256 texels.
Poor at:  colours, which the standard does not define: all skies are white.
Source:   ISO 15469:2004 (CIE S 011), table 1 and equations 1 to 6; Darula & Kittler 2002, CIE general sky standard
          defining luminance distributions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.sky.maps import horizontal_irradiance, texel_directions
from glpath.sky.sky import Environment

Float64 = NDArray[np.float64]


class _Parameters(NamedTuple):
    """Parameters a, b of the gradation and c, d, e of the indicatrix."""

    a: float
    b: float
    c: float
    d: float
    e: float


#: Parameters by sky number: 1 is the CIE standard overcast sky, 5 is uniform, 12 is the CIE standard clear sky.
CIE_SKIES: dict[int, _Parameters] = {
    1: _Parameters(4.0, -0.70, 0.0, -1.0, 0.00),
    2: _Parameters(4.0, -0.70, 2.0, -1.5, 0.15),
    3: _Parameters(1.1, -0.80, 0.0, -1.0, 0.00),
    4: _Parameters(1.1, -0.80, 2.0, -1.5, 0.15),
    5: _Parameters(0.0, -1.00, 0.0, -1.0, 0.00),
    6: _Parameters(0.0, -1.00, 2.0, -1.5, 0.15),
    7: _Parameters(0.0, -1.00, 5.0, -2.5, 0.30),
    8: _Parameters(0.0, -1.00, 10.0, -3.0, 0.45),
    9: _Parameters(-1.0, -0.55, 2.0, -1.5, 0.15),
    10: _Parameters(-1.0, -0.55, 5.0, -2.5, 0.30),
    11: _Parameters(-1.0, -0.55, 10.0, -3.0, 0.45),
    12: _Parameters(-1.0, -0.32, 10.0, -3.0, 0.45),
    13: _Parameters(-1.0, -0.32, 16.0, -3.0, 0.30),
    14: _Parameters(-1.0, -0.15, 16.0, -3.0, 0.30),
    15: _Parameters(-1.0, -0.15, 24.0, -2.8, 0.15),
}


def has_sun(number: int) -> bool:
    """Return True if the luminance of sky `number` depends on the sun's position."""
    return CIE_SKIES[number].c != 0


def relative_luminance(number: int, height: ArrayLike, to_sun: ArrayLike, sun_height: float) -> Float64:
    """Return the (...) luminance of sky `number` relative to its zenith.

    height     : (...) sine of the elevation, at least 0
    to_sun     : (...) cosine of the angle to the sun
    sun_height : sine of the sun's elevation
    """
    sky = CIE_SKIES[number]

    def gradation(sine: ArrayLike) -> Float64:
        sine = np.asarray(sine, np.float64)
        return 1.0 + sky.a * np.where(sine > 0, np.exp(sky.b / np.maximum(sine, 1e-9)), 0.0)

    def indicatrix(cosine: ArrayLike) -> Float64:
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        falloff = np.exp(sky.d * angle) - np.exp(sky.d * np.pi / 2)
        return np.asarray(1.0 + sky.c * falloff + sky.e * np.square(cosine))

    return indicatrix(to_sun) * gradation(height) / (indicatrix(sun_height) * gradation(1.0))


def cie_sky(
    number: int,
    up: Float64,
    sun: Float64 | None,
    *,
    zenith: float | None = None,
    illuminance: float | None = None,
    ground: float = 0.0,
) -> Environment:
    """Return sky `number` for a given zenith radiance, or for a given irradiance under the open sky.

    number      : 1 to 15
    up          : (3,) unit
    sun         : (3,) unit, towards the sun, not below the horizon; None if the sky has no sun (`has_sun`)
    zenith      : radiance of the zenith, W sr^-1 m^-2 or cd m^-2
    illuminance : irradiance of open ground in W m^-2 or lx, instead of `zenith`. The bilinearly filtered map has
                  exactly this irradiance
    ground      : albedo of the ground below the horizon
    """
    directions = texel_directions(up)
    sun = up if sun is None else sun
    height = directions @ up
    seen = relative_luminance(number, height, directions @ sun, float(sun @ up))
    seen[height < 0] = 0.0
    # Irradiance of the upper hemisphere, from the relative luminance.
    relative = horizontal_irradiance(seen)
    if zenith is None:
        assert illuminance is not None, "one of both"
        zenith = illuminance / relative
    seen[height < 0] = ground * relative / np.pi
    return Environment(np.repeat(seen[..., None], 3, axis=2).astype(np.float32), up, scale=zenith, cut=True)
