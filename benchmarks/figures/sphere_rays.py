"""Rays and the spheres that they meet, counted in numpy: what the counters of the ray tracers are held against.

It shares nothing with the engines but the `Scene`: the textbook's formula, in float64.

Cost:     the pixels that spheres cover, and a sample of shadow rays times all spheres.
Poor at:  anything but round spheres in front of the camera, and one point light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.scene import Scene
from glpath.scene.model import Float64

Int64 = NDArray[np.int64]

_SAMPLE = 2000  # shadow rays, whose tests are counted


@dataclass(frozen=True)
class SphereRays:
    """Of a frame of one ray through the centre of every pixel.

    primary_tests : of the classical algorithm, every ray against every sphere
    hits          : pairs of a ray and a sphere that it meets: what has to be tested in any case
    shadow_rays   : one for each pixel that sees a side that faces the light
    shadowed      : of these, how many meet a sphere on their way, and
    shadow_tests  : of the classical algorithm, where the first sphere that is found ends a ray's search; both are
                    estimated from a sample of the rays
    nearest       : (H, W) the sphere that each pixel sees, -1 for none
    """

    nearest: Int64
    primary_tests: int
    hits: int
    shadow_rays: int
    shadowed: float
    shadow_tests: float

    @property
    def tests_ratio(self) -> float:
        """Tests of the classical algorithm over those of one that shoots no primary ray in vain."""
        return (self.primary_tests + self.shadow_tests) / (self.hits + self.shadow_tests)

    @classmethod
    def of(cls, scene: Scene, seed: int = 0) -> SphereRays:
        centres, radii = scene.spheres[:, :, 3], np.linalg.norm(scene.spheres[:, :, 0], axis=1)
        hits, nearest, t = _met(scene, centres, radii)
        seen = nearest >= 0
        own = nearest[seen]
        position = scene.camera.position + t[seen][:, None] * scene.camera.rays()[seen]
        to_light = scene.lights[0].position - position
        facing = np.sum((position - centres[own]) * to_light, axis=1) > 0
        rays = np.flatnonzero(facing)
        chosen = np.random.default_rng(seed).permutation(rays)[:_SAMPLE]
        met = np.array([_first_met(position[i], to_light[i], int(own[i]), centres, radii) for i in chosen], int)
        count = len(rays) / max(len(met), 1)
        tests = np.where(met < 0, len(centres), met + 1)
        shadowed, in_all = count * float((met >= 0).sum()), count * float(tests.sum())
        return cls(nearest, seen.size * len(centres), hits, len(rays), shadowed, in_all)


def _met(scene: Scene, centres: Float64, radii: Float64) -> tuple[int, Int64, Float64]:
    """How many pairs meet, and (H, W) the nearest sphere of each pixel, -1 for none, and its t."""
    camera = scene.camera
    rays = camera.rays()
    nearest, t = np.full(rays.shape[:2], -1), np.full(rays.shape[:2], np.inf)
    right, up, forward = camera.frame()
    width, height = camera.resolution
    hits = 0
    for i, (centre, radius) in enumerate(zip(centres - camera.position, radii, strict=True)):
        depth, reach = centre @ forward, float(np.linalg.norm(centre))
        assert depth > radius, f"sphere {i} reaches to the camera"
        # Pixels of a square around it, far too large rather than too small.
        extent = 2 * camera.focal * radius * reach / (depth - radius) ** 2 + 2
        x = width / 2 + camera.focal * (centre @ right) / depth
        y = height / 2 - camera.focal * (centre @ up) / depth
        part = (
            slice(max(0, int(y - extent)), max(0, int(y + extent) + 1)),
            slice(max(0, int(x - extent)), max(0, int(x + extent) + 1)),
        )
        along = rays[part] @ centre
        square = along**2 - (centre @ centre - radius**2)
        meets = square >= 0
        hits += int(meets.sum())
        at = np.where(meets, along - np.sqrt(np.maximum(square, 0)), np.inf)
        nearer = at < t[part]
        t[part] = np.where(nearer, at, t[part])
        nearest[part] = np.where(nearer, i, nearest[part])
    return hits, nearest, t


def _first_met(position: Float64, to_light: Float64, own: int, centres: Float64, radii: Float64) -> int:
    """The first sphere, in their order, that stands on the way to the light; -1 for none. Its own never does."""
    distance = np.linalg.norm(to_light)
    way, from_here = to_light / distance, centres - position
    along = from_here @ way
    square = along**2 - (np.sum(from_here**2, axis=1) - radii**2)
    t = along - np.sqrt(np.maximum(square, 0))
    blocks = (square >= 0) & (t > 0) & (t < distance)
    blocks[own] = False
    return int(blocks.argmax()) if blocks.any() else -1
