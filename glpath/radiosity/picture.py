"""A radiosity solution as the eye sees it, on the CPU: what its elements look like, before any gather.

Masks and blended surfaces are seen as if they were opaque, reflecting what they do in the mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.shafts.rays import nearest, rays_of
from glpath.radiosity.solution import Mode, RadiositySolution
from glpath.scene import Scene, path_traceable
from glpath.scene.appearance import Appearance
from glpath.scene.model import Float64
from glpath.system.kernels import kernel


def picture_of(solution: RadiositySolution, scene: Scene, mode: Mode = "smooth") -> Float64:
    """(H, W, 3) float64 radiance at the middles of the camera's pixels: emitted, and reflected radiosity / pi.

    scene  : that it is a solution of, with the camera to look from
    mode   : of `RadiositySolution.irradiance`

    Black where nothing is seen. Raises SceneError for a solution of another scene, UsageError for another mode.
    """
    solution.check_scene(scene)
    return EyeHits.of(scene, 1).radiance(solution, mode)


@dataclass(frozen=True)
class EyeHits:
    """The hits of rays through a picture: k x k of them in every pixel, at the middles of its k x k parts.

    triangle    : (H, W, k * k) int64, -1 for nothing
    barycentric : (H, W, k * k, 2) float64, b1 and b2
    back        : (H, W, k * k) int64, 1 where the back is seen
    """

    scene: Scene
    triangle: NDArray[np.int64]
    barycentric: Float64
    back: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene, k: int = 4) -> Self:
        """Of a scene, seen by its camera."""
        triangles = path_traceable(scene.still())
        camera = triangles.camera.at()
        width, height = camera.resolution
        fine = replace(camera, resolution=(width * k, height * k))
        parts = (height, k, width, k, 3)
        starts, directions = (r.reshape(parts).swapaxes(1, 2).reshape(-1, 3) for r in (fine.origins(), fine.rays()))
        hit, found = np.empty(len(directions), np.int64), np.zeros((len(directions), 3))
        _first_hits(rays_of(triangles), starts, directions, hit, found)
        back = (np.sum(triangles.normals[hit] * directions, axis=1) > 0) & (hit >= 0)
        shape = (height, width, k * k)
        return cls(triangles, hit.reshape(shape), found[:, 1:].reshape(*shape, 2), back.astype(int).reshape(shape))

    def radiance(self, solution: RadiositySolution, mode: Mode) -> Float64:
        """(H, W, 3) radiance: what is emitted and what the solution says is reflected, each pixel the mean."""
        seen = self.triangle >= 0
        t, back = self.triangle[seen], self.back[seen]
        shapes = self.scene.shapes
        emission = Appearance(self.scene).emission(t, self.barycentric[seen])
        both = np.array([shape.emission_two_sided for shape in shapes])
        shape = self.scene.triangle_shape[t]
        shining = (back == 0) | both[shape]
        picture = np.zeros((*self.triangle.shape, 3))
        reflected = solution.lookup(self.scene, t, self.barycentric[seen], back, mode)
        picture[seen] = reflected / np.pi + np.where(shining[:, None], emission, 0)
        return np.asarray(picture.mean(axis=2))


@kernel
def _first_hits(rays: Any, origins: Any, directions: Any, hit: Any, found: Any) -> None:
    for i in range(len(directions)):
        hit[i] = nearest(rays, origins[i], directions[i], -1, found[i])
