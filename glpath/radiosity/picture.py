"""Image of a radiosity solution as the camera sees it, on the CPU: radiance of the elements without a gather.

Masked and blended surfaces are rendered as opaque, with their mean reflectance.
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
from glpath.system.arguments import checked
from glpath.system.kernels import kernel


@checked
def picture_of(solution: RadiositySolution, scene: Scene, mode: Mode = "smooth") -> Float64:
    """Return the radiance (H, W, 3) float64 at the camera's pixel centres: emission plus reflected radiosity / pi.

    scene  : scene of this solution, with the camera to render from
    mode   : mode of `RadiositySolution.irradiance`

    Pixels without a hit are black. Raises SceneError for a solution of another scene, UsageError for another mode.
    """
    solution.check_scene(scene)
    return EyeHits.of(scene, 1).radiance(solution, mode)


@dataclass(frozen=True)
class EyeHits:
    """First hits of camera rays, k x k in every pixel, through the middles of its k x k parts.

    triangle    : (H, W, k * k) int64, -1 for no hit
    barycentric : (H, W, k * k, 2) float64, b1 and b2
    back        : (H, W, k * k) int64, 1 if the back is hit
    """

    scene: Scene
    triangle: NDArray[np.int64]
    barycentric: Float64
    back: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene, k: int = 4) -> Self:
        """Trace k x k rays per pixel from the scene's camera, and return their first hits."""
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
        """Return the radiance (H, W, 3), emitted plus reflected light of `solution`, averaged over each pixel."""
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
