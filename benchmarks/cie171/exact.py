"""Exact irradiance: of diffuse polygons in closed form, and through openings by adaptive quadrature.

Cost:     about a millisecond for a polygon, some tens of milliseconds for an opening and a point.
Poor at:  radiance that jumps inside an opening: divide it there first (`divided`).
Source:   Lambert 1760, Photometria; Baum, Rushmeier & Winget 1989 for the form of the sum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]
#: Function from unit directions (N, 3) to radiances (N,).
Radiance = Callable[[Float64], Float64]

#: Points along each side of a cell, for two rules: their difference estimates the error of the first.
_COARSE, _FINE = 8, 12
_DEEPEST = 40


@dataclass(frozen=True)
class Rectangle:
    """A parallelogram with right angles.

    corner : (3,)
    edges  : (2, 3), whose cross product is the normal
    """

    corner: Float64
    edges: Float64

    @classmethod
    def of(cls, corner: ArrayLike, edges: ArrayLike) -> Rectangle:
        return cls(np.asarray(corner, np.float64), np.asarray(edges, np.float64))

    @property
    def corners(self) -> Float64:
        """Return (4, 3) corners, around the outline."""
        a, b = self.edges
        return np.array([self.corner, self.corner + a, self.corner + a + b, self.corner + b])

    @property
    def area(self) -> float:
        return float(np.linalg.norm(np.cross(*self.edges)))

    def divided(self, shares: ArrayLike) -> list[Rectangle]:
        """Cut into strips along the second edge, at fractions of it; those outside (0, 1) make no cut."""
        cuts = [0.0, *sorted(x for x in np.ravel(np.asarray(shares, np.float64)) if 1e-12 < x < 1 - 1e-12), 1.0]
        a, b = self.edges
        pairs = pairwise(cuts)
        return [Rectangle(self.corner + low * b, np.array([a, (high - low) * b])) for low, high in pairs]


def lambert(points: ArrayLike, normals: ArrayLike, corners: ArrayLike) -> Float64:
    """Return (N,) pi times a polygon's view factors from points (N, 3): its irradiances if its radiance is 1.

    The whole polygon must be before each point.

    corners : (K, 3), around the outline, in either direction
    """
    to = np.asarray(corners, np.float64)[None] - np.asarray(points, np.float64)[:, None]
    to /= np.linalg.norm(to, axis=-1, keepdims=True)
    following = np.roll(to, -1, axis=1)
    across = np.cross(to, following)
    sine = np.linalg.norm(across, axis=-1)
    angle = np.arctan2(sine, np.sum(to * following, axis=-1))
    each = angle / np.maximum(sine, 1e-300) * np.einsum("nki,ni->nk", across, np.asarray(normals, np.float64))
    return np.asarray(np.abs(0.5 * each.sum(axis=1)))


def through(
    point: ArrayLike, normal: ArrayLike, opening: Rectangle, radiance: Radiance, rtol: float = 1e-8
) -> float:
    """Return the irradiance of one point through an opening, for the radiance that is seen there.

    point, normal : (3,); the whole opening must be before the point
    rtol          : cells are halved until the difference between two rules, summed over cells, is below this
                    fraction

    A cell is halved along both edges if two Gauss-Legendre rules differ on it, so a kink, such as the middle of a
    corona, does no harm.
    """
    at, facing = np.asarray(point, np.float64), np.asarray(normal, np.float64)
    a, b = opening.edges
    area = np.cross(a, b)

    def integrals(cells: Float64, n: int) -> Float64:
        """Return (C,) integrals over cells (C, 3): start along both edges, and width, as fractions of the edges."""
        u, w = _rule(n)
        s = cells[:, 0, None, None] + cells[:, 2, None, None] * u[:, None]
        t = cells[:, 1, None, None] + cells[:, 2, None, None] * u
        to = opening.corner + s[..., None] * a + t[..., None] * b - at
        square = np.sum(to * to, axis=-1)
        wi = to / np.sqrt(square)[..., None]
        seen = radiance(wi.reshape(-1, 3)).reshape(square.shape)
        values = seen * np.maximum(wi @ facing, 0.0) * np.abs(wi @ area) / square
        return np.asarray(cells[:, 2] ** 2 * np.einsum("cij,i,j->c", values, w, w))

    cells = np.array([[0.0, 0.0, 1.0]])
    total, whole = 0.0, 0.0
    for _ in range(_DEEPEST):
        fine = integrals(cells, _FINE)
        error = np.abs(fine - integrals(cells, _COARSE))
        whole = max(whole, total + float(fine.sum()))
        # The difference bounds the error of the fine rule, whose result is used.
        good = error <= rtol * whole * np.maximum(cells[:, 2] ** 2, 1e-3)
        total += float(fine[good].sum())
        rest = cells[~good]
        if not len(rest):
            return total
        half = rest[:, 2] / 2
        corners = [(i, j) for i in (0, 1) for j in (0, 1)]
        cells = np.concatenate([
            np.column_stack([rest[:, 0] + i * half, rest[:, 1] + j * half, half]) for i, j in corners
        ])  # fmt: skip
    return total + float(integrals(cells, _FINE).sum())


def _rule(n: int) -> tuple[Float64, Float64]:
    """Return (n,) Gauss-Legendre nodes and weights on [0, 1]."""
    x, w = leggauss(n)
    return (x + 1) / 2, w / 2
