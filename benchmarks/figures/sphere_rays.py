"""Rays and the spheres that they hit, counted with numpy, to check the counters of the ray tracers.

It shares only the `Scene` with the engines, and applies the textbook's formula in float64.

Cost:     in proportion to the pixels that spheres cover, and to a sample of shadow rays times all spheres.
Poor at:  scenes other than round spheres in front of the camera with one point light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.scene import Scene
from glpath.scene.model import Float64

Int64 = NDArray[np.int64]

_SAMPLE = 2000  # number of shadow rays whose tests are counted


@dataclass(frozen=True)
class SphereRays:
    """Counts for a frame with one ray through the centre of each pixel.

    primary_tests : tests of the classical algorithm: every ray against every sphere
    hits          : pairs of a ray and a sphere that it hits; every algorithm must test these
    shadow_rays   : number of pixels that see a side that faces the light
    shadowed      : number of these whose shadow ray hits a sphere, estimated from a sample
    shadow_tests  : tests of the classical algorithm, which ends a ray's search at the first sphere that it finds;
                    estimated from the same sample
    nearest       : (H, W) sphere that each pixel sees, -1 for none
    """

    nearest: Int64
    primary_tests: int
    hits: int
    shadow_rays: int
    shadowed: float
    shadow_tests: float

    @property
    def tests_ratio(self) -> float:
        """Return the tests of the classical algorithm divided by those of one without useless primary tests."""
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
    """Return the number of pairs that hit, and for each pixel (H, W) the nearest sphere, -1 for none, and its t."""
    camera = scene.camera
    rays = camera.rays()
    nearest, t = np.full(rays.shape[:2], -1), np.full(rays.shape[:2], np.inf)
    right, up, forward = camera.frame()
    width, height = camera.resolution
    hits = 0
    for i, (centre, radius) in enumerate(zip(centres - camera.position, radii, strict=True)):
        depth, reach = centre @ forward, float(np.linalg.norm(centre))
        assert depth > radius, f"sphere {i} reaches to the camera"
        # Test the pixels of a square around the sphere, which is always large enough.
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
    """Return the first sphere, in their order, between the point and the light, other than its own; -1 for none."""
    distance = np.linalg.norm(to_light)
    way, from_here = to_light / distance, centres - position
    along = from_here @ way
    square = along**2 - (np.sum(from_here**2, axis=1) - radii**2)
    t = along - np.sqrt(np.maximum(square, 0))
    blocks = (square >= 0) & (t > 0) & (t < distance)
    blocks[own] = False
    return int(blocks.argmax()) if blocks.any() else -1
