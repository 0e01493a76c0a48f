"""Patches of the sky: Tregenza's 145 patches, and Reinhart's subdivisions into 577 and 2,305 patches.

Patches are numbered row by row from the horizon up. Each row starts in the north and continues eastwards. The last
patch is a cap around the zenith. Patch 0 is the ground, which is the whole lower hemisphere. Radiance's
`reinsrc.cal` numbers patches in the same order for MF:1, 2 and 4, so matrices are compatible.

Source:   Tregenza 1987, Subdivision of the sky hemisphere for luminance measurements; Reinhart & Walkenhorst 2001,
          Validation of dynamic RADIANCE-based daylight simulations for a test office.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight.compass import Compass
from glpath.errors import UsageError
from glpath.system.arguments import short_repr

Float64 = NDArray[np.float64]

#: Number of patches in each of Tregenza's rows below the cap.
_ROWS = (30, 30, 24, 24, 18, 12, 6)
#: Number of sky patches for each subdivision.
SUBDIVISIONS = {1: 145, 2: 577, 4: 2305}
#: Default number of ground directions for each direction of a sky patch; a single direction counts as two.
_GROUND = 16
# Generator of an infinite two-dimensional lattice whose first n points are evenly spread for any n (Roberts 2018).
_LATTICE = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True)
class Directions:
    """Unit directions that sample the patches.

    directions : (D, 3) unit vectors; directions of one patch are adjacent
    patch      : (D,) int, index of the patch that each direction samples
    weight     : (D,) solid angle that each direction represents, steradians
    samples    : number of directions per sky patch; the number for the ground is different
    """

    directions: Float64
    patch: NDArray[np.intp]
    weight: Float64
    samples: int


@dataclass(frozen=True)
class SkyPatches:
    """Patches of the ground and the sky.

    subdivision : 1, 2 or 4, a key of `SUBDIVISIONS`; other values raise UsageError
    """

    subdivision: int = 1

    def __post_init__(self) -> None:
        if self.subdivision not in SUBDIVISIONS:
            allowed = ", ".join(f"{key} ({count} patches)" for key, count in SUBDIVISIONS.items())
            raise UsageError(f"subdivision {short_repr(self.subdivision)} of the sky: allowed are {allowed}.")

    def __len__(self) -> int:
        """Return the number of patches, including the ground."""
        return 1 + SUBDIVISIONS[self.subdivision]

    @cached_property
    def bounds(self) -> Float64:
        """Bounds (P, 4) of the patches.

        The columns are lowest and highest azimuth in radians, and lowest and highest sine of altitude.
        """
        m = self.subdivision
        height = np.pi / 2 / (len(_ROWS) * m + 0.5)
        found = [[0.0, 2 * np.pi, -1.0, 0.0]]
        for row in range(len(_ROWS) * m):
            count = m * _ROWS[row // m]
            half = np.pi / count
            low, high = np.sin(row * height), np.sin((row + 1) * height)
            found += [[2 * half * i - half, 2 * half * i + half, low, high] for i in range(count)]
        found.append([0.0, 2 * np.pi, np.sin(len(_ROWS) * m * height), 1.0])
        return np.array(found)

    @cached_property
    def solid_angles(self) -> Float64:
        """Solid angles (P,) of the patches, steradians; the ground has 2 pi."""
        azimuth_from, azimuth_to, low, high = self.bounds.T
        return np.asarray((azimuth_to - azimuth_from) * (high - low))

    def centres(self, compass: Compass) -> Float64:
        """Return (P, 3) unit directions to the patch centres; nadir for the ground, zenith for the cap."""
        azimuth_from, azimuth_to, low, high = self.bounds.T
        altitude = 0.5 * (np.arcsin(low) + np.arcsin(high))
        altitude[0], altitude[-1] = -np.pi / 2, np.pi / 2
        return compass.directions(0.5 * (azimuth_from + azimuth_to), np.sin(altitude))

    def containing(self, directions: Float64, compass: Compass) -> NDArray[np.intp]:
        """Return the index (N,) of the patch that contains each unit direction (N, 3) in scene coordinates."""
        east, north, up = (directions @ compass.world_from_sky).T
        rows = len(_ROWS) * self.subdivision
        height = np.pi / 2 / (rows + 0.5)
        row = np.floor(np.arcsin(np.clip(up, -1.0, 1.0)) / height).astype(np.intp)
        counts = np.array([self.subdivision * _ROWS[i // self.subdivision] for i in range(rows)] + [1])
        first = 1 + np.concatenate([[0], np.cumsum(counts)[:-1]])
        of_row = np.clip(row, 0, rows)
        share = np.arctan2(east, north) / (2 * np.pi) * counts[of_row]
        found = first[of_row] + np.round(share).astype(np.intp) % counts[of_row]
        return np.where(up < 0, 0, found)

    def directions(
        self, compass: Compass, samples: int = 4, seed: int = 0, ground: int | None = None
    ) -> Directions:
        """Return directions that sample all patches, with uniform density within each patch.

        samples : number of directions per sky patch; 1 gives the patch centre, an even number gives pairs
        ground  : number of ground directions, even; by default 16 per direction of a sky patch, and at least 32

        A pair is a lattice point and its mirror image in the patch centre, in azimuth and sine of altitude. A pair
        integrates functions that are linear in these coordinates without error. The lattice is shifted at random in
        each patch.
        """
        below = self._in(compass, np.zeros(1, np.intp), ground or _GROUND * max(samples, 2), seed)
        sky = np.arange(1, len(self))
        if samples == 1:
            return Directions(
                np.concatenate([below, self.centres(compass)[1:]]),
                np.concatenate([np.zeros(len(below), np.intp), sky]),
                np.concatenate([np.full(len(below), 2 * np.pi / len(below)), self.solid_angles[1:]]),
                samples,
            )
        return Directions(
            np.concatenate([below, self._in(compass, sky, samples, seed)]),
            np.concatenate([np.zeros(len(below), np.intp), np.repeat(sky, samples)]),
            np.concatenate(
                [np.full(len(below), 2 * np.pi / len(below)), np.repeat(self.solid_angles[1:] / samples, samples)]
            ),
            samples,
        )

    def _in(self, compass: Compass, which: NDArray[np.intp], samples: int, seed: int) -> Float64:
        """Return unit directions (len(which) * samples, 3) in the patches with indices `which`.

        The directions of a patch are adjacent, and so are the two of a mirrored pair.
        """
        random = np.random.default_rng([seed, samples, len(which)])
        shift = random.random((len(which), 1, 2))
        point = (shift + np.arange(1, samples // 2 + 1)[None, :, None] * np.array(_LATTICE)) % 1.0
        point = np.stack([point, 1.0 - point], axis=2).reshape(len(which), samples, 2)
        azimuth_from, azimuth_to, low, high = (each[:, None] for each in self.bounds[which].T)
        azimuth = azimuth_from + (azimuth_to - azimuth_from) * point[..., 0]
        return compass.directions(azimuth, low + (high - low) * point[..., 1]).reshape(-1, 3)
