"""A city of boxes on a ground, with any number of triangles, and points on its ground and roofs.

Blocks of random widths and heights stand on a square grid with spacing 1. The ground is two triangles. A block has
ten, because it stands on the ground and needs no bottom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from glpath.scene.model import Camera, Float64, Material, Mesh, Scene, Shape, Shapes

TRIANGLES_A_BLOCK = 10
# Corners of a box's roof and walls, counter-clockwise from outside; bit k is set for the upper end along axis k.
_FACES = ((4, 5, 7, 6), (0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6))


@dataclass(frozen=True)
class City:
    """lower, upper : (B, 3) corners of the blocks, row by row of a square grid whose cells' middles are 1 apart."""

    lower: Float64
    upper: Float64

    @classmethod
    def of(cls, triangles: int, seed: int = 0) -> City:
        """Return a city of about this many triangles; the same seed gives the same city."""
        random = np.random.default_rng(seed)
        side = max(1, round((triangles / TRIANGLES_A_BLOCK) ** 0.5))
        middle = np.stack(np.meshgrid(*[np.arange(side)] * 2), axis=-1).reshape(-1, 2)
        half = random.uniform(0.2, 0.35, (len(middle), 2))
        height = random.uniform(0.3, 2.0, len(middle))
        lower = np.concatenate([middle - half, np.zeros((len(middle), 1))], axis=1)
        return cls(lower, np.concatenate([middle + half, height[:, None]], axis=1))

    @property
    def side(self) -> int:
        """Return the number of blocks along the grid."""
        return math.isqrt(len(self.lower))

    @property
    def triangles(self) -> Float64:
        """Return (T, 3, 3) triangles: ten for each block, and two for the ground."""
        which = np.array([[corner >> k & 1 for k in range(3)] for corner in range(8)], np.bool_)
        corners = np.where(which, self.upper[:, None], self.lower[:, None])
        quads = np.stack([corners[:, list(face)] for face in _FACES], axis=1)
        end = self.side
        ground = np.array([[-1.0, -1, 0], [end, -1, 0], [end, end, 0], [-1, end, 0]])
        quads = np.concatenate([quads.reshape(-1, 4, 3), ground[None]])
        return np.asarray(quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3))

    @property
    def scene(self) -> Scene:
        """Return a grey scene with z up and without lights."""
        return Scene(
            name=f"city of {len(self.lower):,} blocks",
            camera=Camera(np.array([-9.0, -9.0, 9.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]), 40.0, (8, 8)),
            shapes=Shapes((Shape("city", Mesh.of_triangles(self.triangles), 0),)),
            materials=(Material("grey", np.full(3, 0.3)),),
        )

    def points(self, count: int, seed: int = 1) -> Float64:
        """Return (N, 3) random points on the ground and the roofs."""
        random = np.random.default_rng(seed)
        points = np.zeros((count, 3))
        points[:, :2] = random.uniform(-1.0, self.side, (count, 2))
        cell = np.clip(np.round(points[:, :2]).astype(int), 0, self.side - 1)
        block = cell[:, 1] * self.side + cell[:, 0]
        over = (points[:, :2] > self.lower[block, :2]) & (points[:, :2] < self.upper[block, :2])
        roof = over.all(axis=1)
        points[roof, 2] = self.upper[block[roof], 2]
        return points
