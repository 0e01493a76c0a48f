"""Photometric webs: intensity of a luminaire in each direction, measured from far away.

Directions are those of type C photometry. gamma is the angle from the light's direction (down, for a ceiling lamp).
C is the angle around that direction. C = 0 is along a perpendicular vector that is stored with the light. C = 90 is
along the cross product of that vector with the light's direction.

Cost:     16 bytes on the device for every cell of the grid: 0.5 MB for steps of one degree.
Poor at:  nearby surfaces, because the luminaire is a point, however large it is.
Source:   IES LM-63; CIE 121, the planes of type C.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LightProfile:
    """Intensities on a regular grid of angles, with bilinear interpolation.

    candela : (R, G) float64, cd; `Light.intensity` converts it to the unit of the scene. Rows are for C = 0, 360 /
              R, ... degrees; columns for equal steps of gamma from the first of `gamma` to the last; G >= 2
    gamma   : (first, last) in degrees, 0 <= first < last <= 180; the intensity is 0 outside
    """

    candela: Float64
    gamma: tuple[float, float] = (0.0, 180.0)

    @property
    def step(self) -> float:
        """Step of gamma between columns, degrees."""
        return float((self.gamma[1] - self.gamma[0]) / (self.candela.shape[1] - 1))

    @cached_property
    def max(self) -> float:
        """Maximum intensity."""
        return float(self.candela.max())

    @cached_property
    def flux(self) -> float:
        """Total flux in lumens: the integral of `intensity` over the sphere.

        It is exact, because the intensity is linear in gamma between two columns, so that its product with
        sin(gamma) has an antiderivative.
        """
        mean = self.candela.mean(axis=0)
        edges = np.radians(np.linspace(*self.gamma, len(mean)))
        slope = np.diff(mean) / np.diff(edges)
        # Integral of (v + slope (x - a)) sin x from a to b.
        low, high = edges[:-1], edges[1:]
        parts = mean[:-1] * np.cos(low) - mean[1:] * np.cos(high) + slope * (np.sin(high) - np.sin(low))
        return float(2 * np.pi * parts.sum())

    @cached_property
    def mirrored(self) -> LightProfile:
        """Profile seen in a mirror, with -C instead of C; the profile itself if the two are equal."""
        candela = np.roll(self.candela[::-1], 1, axis=0)
        return self if np.array_equal(candela, self.candela) else LightProfile(candela, self.gamma)

    def cells(self) -> Float64:
        """Return the (R * (G - 1), 4) float64 intensities at the corners of grid cells, for look-ups on the device.

        Cells are listed row by row. The corners of a cell are (C, gamma), (C, next gamma), (next C, gamma) and
        (next C, next gamma).
        """
        beside = np.roll(self.candela, -1, axis=0)
        corners = (self.candela[:, :-1], self.candela[:, 1:], beside[:, :-1], beside[:, 1:])
        return np.stack(corners, axis=-1).reshape(-1, 4)

    def intensity(self, directions: Float64, axis: Float64, c0: Float64) -> Float64:
        """Return (N,) float64 intensities in cd, in unit directions (N, 3) from the light.

        `lights/profile.glsl` is the GPU version.

        axis, c0 : (3,) unit, perpendicular: direction of gamma = 0, and direction of C = 0, gamma = 90
        """
        x, y = directions @ c0, directions @ np.cross(c0, axis)
        gamma = np.degrees(np.arctan2(np.hypot(x, y), directions @ axis))
        return self.at(np.degrees(np.arctan2(y, x)), gamma)

    def at(self, c: Float64, gamma: Float64) -> Float64:
        """Return (N,) float64 intensities in cd at angles (N,) in degrees.

        They are 0 for gamma outside the range of the profile. c may have any value.
        """
        rows, columns = self.candela.shape
        row = np.mod(c, 360.0) * (rows / 360.0)
        column = np.clip((gamma - self.gamma[0]) / self.step, 0.0, columns - 1.0)
        i, j = np.floor(row).astype(np.int64), np.minimum(np.floor(column).astype(np.int64), columns - 2)
        s, t = row - i, column - j
        i, beside = i % rows, (i + 1) % rows
        v = self.candela
        low = (1 - t) * v[i, j] + t * v[i, j + 1]
        high = (1 - t) * v[beside, j] + t * v[beside, j + 1]
        # Rounding may move a direction on the edge of the measured range outside it.
        inside = (gamma >= self.gamma[0] - ANGLE_ROUNDING) & (gamma <= self.gamma[1] + ANGLE_ROUNDING)
        return np.asarray(np.where(inside, (1 - s) * low + s * high, 0.0))


#: Tolerance in degrees for rounding errors at the first and the last gamma of a profile.
ANGLE_ROUNDING = 1e-4
