"""The points, shapes and elements of a radiosity solution that a picture's pixels show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.radiosity.mesh import lattice
from glpath.radiosity.picture import EyeHits
from glpath.radiosity.solution import RadiositySolution

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class ShownHits(EyeHits):
    """`EyeHits` with their positions, shapes and elements."""

    @property
    def position(self) -> Float64:
        """Return (H, W, k * k, 3) points that the rays hit; NaN for rays that hit nothing."""
        c = self.scene.triangles[self.triangle]
        b = self.barycentric[..., None]
        along, across = c[..., 1, :] - c[..., 0, :], c[..., 2, :] - c[..., 0, :]
        where = c[..., 0, :] + b[..., 0, :] * along + b[..., 1, :] * across + self.scene.origin
        return np.where(self.triangle[..., None] >= 0, where, np.nan)

    @property
    def reflecting(self) -> NDArray[np.bool_]:
        """Return (H, W) booleans: whether a pixel and its neighbours show neither a lamp nor the background."""
        lamps = np.array([shape.emits for shape in self.scene.shapes])
        lamp = np.append(lamps[self.scene.triangle_shape], True)
        return _inner(np.logical_not(lamp[self.triangle].any(axis=2)))

    def only(self, shape: str) -> NDArray[np.bool_]:
        """Return (H, W) booleans: whether a pixel and its neighbours show only the named shape."""
        return _inner(self.shape(shape).all(axis=2))

    def shape(self, name: str) -> NDArray[np.bool_]:
        """Return (H, W, k * k) booleans: whether a ray hits the named shape."""
        names = [shape.name for shape in self.scene.shapes]
        return np.asarray(np.append(self.scene.triangle_shape, -1)[self.triangle] == names.index(name))

    def element(self, solution: RadiositySolution) -> NDArray[np.int64]:
        """Return (H, W) the element that all rays of a pixel hit; -1 if they hit several."""
        t = self.triangle.ravel()
        b = self.barycentric.reshape(-1, 2)
        n = solution.divisions.astype(np.int64)[t]
        i, j, upper, _, _ = lattice.locate(n, b[:, 0], b[:, 1])
        found = solution.first_element[t] + lattice.element_index(n, i, j, upper)
        found = np.where(t >= 0, found, -1).reshape(self.triangle.shape)
        same = (found == found[..., :1]).all(axis=2)
        return np.asarray(np.where(same, found[..., 0], -1))


def _inner(pixels: ArrayLike) -> NDArray[np.bool_]:
    """Return the pixels whose neighbours are all in the set, too.

    This leaves a margin, because a render's rays go nearer to a pixel's edge than these.
    """
    from scipy.ndimage import binary_erosion  # slow to import

    return np.asarray(binary_erosion(pixels, np.ones((3, 3)), border_value=1))
