"""Photometric webs: how much a luminaire sends in which direction, as measured from far away.

Directions are those of type C photometry: gamma from the axis of the luminaire (0: down, for a ceiling lamp), and C
about it, C = 0 along an axis that the light has and C = 90 where that crossed with its direction points.

Cost:     16 bytes on the device for every cell of the grid: 0.5 MB for steps of a degree.
Poor at:  what is near: the luminaire is a point, however large it is.
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
    """Intensities over a regular grid of angles, bilinear between them.

    candela : (C, G) float64, cd, which `Light.intensity` brings into the unit of the scene: rows for C = 0,
              360 / C, ... below 360 degrees, columns for gamma from the first of `gamma` to the last; G >= 2
    gamma   : (first, last) in degrees, 0 <= first < last <= 180; nothing is sent beyond them
    """

    candela: Float64
    gamma: tuple[float, float] = (0.0, 180.0)

    @property
    def step(self) -> float:
        """Degrees of gamma between columns."""
        return float((self.gamma[1] - self.gamma[0]) / (self.candela.shape[1] - 1))

    @cached_property
    def max(self) -> float:
        """The highest of the intensities."""
        return float(self.candela.max())

    @cached_property
    def flux(self) -> float:
        """Lumens that it sends in all: the integral over the sphere of what `intensity` has.

        Exact: between two columns it is linear in gamma, which times its sine has an antiderivative.
        """
        mean = self.candela.mean(axis=0)
        edges = np.radians(np.linspace(*self.gamma, len(mean)))
        slope = np.diff(mean) / np.diff(edges)
        # The integral of (v + slope (x - a)) sin x from a to b.
        low, high = edges[:-1], edges[1:]
        parts = mean[:-1] * np.cos(low) - mean[1:] * np.cos(high) + slope * (np.sin(high) - np.sin(low))
        return float(2 * np.pi * parts.sum())

    def cells(self) -> Float64:
        """(C * (G - 1), 4) float64: of each cell the corners (C, gamma), (C, next gamma), (next C, gamma), (both).

        Row by row of C; what the device looks up.
        """
        beside = np.roll(self.candela, -1, axis=0)
        corners = (self.candela[:, :-1], self.candela[:, 1:], beside[:, :-1], beside[:, 1:])
        return np.stack(corners, axis=-1).reshape(-1, 4)

    def intensity(self, directions: Float64, axis: Float64, c0: Float64) -> Float64:
        """(N,) float64, cd, in unit directions (N, 3) away from the light. `lights/profile.glsl` is the same.

        axis, c0 : (3,) unit, perpendicular: towards gamma = 0, and towards C = 0 at gamma = 90
        """
        x, y = directions @ c0, directions @ np.cross(c0, axis)
        gamma = np.degrees(np.arctan2(np.hypot(x, y), directions @ axis))
        return self.at(np.degrees(np.arctan2(y, x)), gamma)

    def at(self, c: Float64, gamma: Float64) -> Float64:
        """(N,) float64 at angles (N,) in degrees."""
        rows, columns = self.candela.shape
        row = np.mod(c, 360.0) * (rows / 360.0)
        column = np.clip((gamma - self.gamma[0]) / self.step, 0.0, columns - 1.0)
        i, j = np.floor(row).astype(np.int64), np.minimum(np.floor(column).astype(np.int64), columns - 2)
        s, t = row - i, column - j
        i, beside = i % rows, (i + 1) % rows
        v = self.candela
        low = (1 - t) * v[i, j] + t * v[i, j + 1]
        high = (1 - t) * v[beside, j] + t * v[beside, j + 1]
        # A direction on the edge of what was measured has lost it to rounding.
        inside = (gamma >= self.gamma[0] - ANGLE_ROUNDING) & (gamma <= self.gamma[1] + ANGLE_ROUNDING)
        return np.asarray(np.where(inside, (1 - s) * low + s * high, 0.0))


#: Degrees by which a direction may seem to miss the edge of a profile.
ANGLE_ROUNDING = 1e-4
