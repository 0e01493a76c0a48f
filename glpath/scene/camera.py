"""The camera, and the one place that knows how a pinhole projects.

Positions in an image are in pixels from its upper left corner, x to the right and y down, so that the middle of the
first pixel is (0.5, 0.5). Row 0 of an image is at the top.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from pyrr import matrix33

from glpath.scene.geometry import Float64


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    position, target, up : (3,) float64, scene units; `up` need not be perpendicular to the view
    fov                  : vertical field of view of the whole image, degrees, 0 < fov < 180
    resolution           : (width, height) in pixels
    """

    position: Float64
    target: Float64
    up: Float64
    fov: float
    resolution: tuple[int, int]

    def frame(self) -> tuple[Float64, Float64, Float64]:
        """Unit vectors (right, up, forward), each (3,) float64. Row 0 of an image is towards `up`."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def turned(self, degrees: float) -> Camera:
        """The camera carried around its target, about the axis `up` through it, counter-clockwise from above."""
        arm = self.position - self.target
        rotation = matrix33.create_from_axis_rotation(np.asarray(self.up, np.float64), np.radians(degrees))
        return replace(self, position=self.target + arm @ rotation)

    def turntable(self, frames: int) -> list[Camera]:
        """The camera at so many equal steps of its way once around the target."""
        return [self.turned(360.0 * i / frames) for i in range(frames)]

    @property
    def focal(self) -> float:
        """Focal length in pixels: how far from the eye an image lies whose pixels have sides of length 1."""
        return float(self.resolution[1] / (2.0 * np.tan(np.radians(self.fov) / 2.0)))

    @property
    def extent(self) -> tuple[float, float]:
        """Half the width and half the height of the image that lies at distance 1."""
        width, height = self.resolution
        return 0.5 * width / self.focal, 0.5 * height / self.focal

    def pixel_centres(self) -> Float64:
        """(H, W, 2) float64 positions in the image."""
        width, height = self.resolution
        return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)

    def rays(self, at: ArrayLike | None = None) -> Float64:
        """(..., 3) float64 unit directions from `position` through positions in the image.

        at : (..., 2) positions, inside the image or beside it; the centres of all pixels, (H, W, 2), without it
        """
        x, y = np.moveaxis(self.pixel_centres() if at is None else np.asarray(at, np.float64), -1, 0)
        width, height = self.resolution
        right, up, forward = self.frame()
        across, above = (x - width / 2) / self.focal, (height / 2 - y) / self.focal
        directions = forward + across[..., None] * right + above[..., None] * up
        return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))

    def project(self, points: ArrayLike) -> tuple[Float64, Float64]:
        """Where points (..., 3) appear: (..., 2) positions in the image, and (...) depth along the view.

        Of no meaning where the depth is not above 0: behind the eye.
        """
        right, up, forward = self.frame()
        seen = np.asarray(points, np.float64) - self.position
        depth = seen @ forward
        width, height = self.resolution
        with np.errstate(divide="ignore", invalid="ignore"):
            x = width / 2 + self.focal * (seen @ right) / depth
            y = height / 2 - self.focal * (seen @ up) / depth
        return np.stack([x, y], axis=-1), depth

    def corner_rays(self) -> Float64:
        """(4, 3) float64 directions through the corners of the image, around it; not of unit length."""
        (right, up, forward), (wide, high) = self.frame(), self.extent
        corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.array([forward + a * wide * right + b * high * up for a, b in corners])
