"""Convex polygons for the kernels: clipping by planes, and quadrature points.

A plane has four numbers, unit normal and distance. The height of a point over it is normal . point + distance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.system.kernels import inner_kernel

#: Maximum number of corners of a facet or occluder. Each clip by a plane may add a corner; `ROOM` allows for that.
CORNERS = 12
ROOM = CORNERS + 4


class Polygon(NamedTuple):
    """Polygon with corners points[:n], (n, 3) float64, counter-clockwise seen from its front."""

    points: NDArray[np.float64]
    n: int


#: Coefficients of atan(t) / t in powers of t^2, up to t = tan(pi / 8), interpolated at Chebyshev points; error
#: 3e-14.
_ATAN = (
    0.9999999999999736, -0.3333333333080474, 0.19999999605095062, -0.14285690433030468, 0.11110385243084064,
    -0.09078394365569775, 0.07563718533864056, -0.05874557604431399, 0.030663189607383973,
)  # fmt: skip
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _A8 = _ATAN
_EIGHTH = 0.41421356237309503


@inner_kernel
def angle(y, x):  # type: ignore[no-untyped-def]
    """Return arctan2(y, x) for y >= 0, accurate to 1e-13.

    It takes a third of arctan2's time, because it has no call and no branches.
    """
    across = abs(x)
    small, large = min(across, y), max(across, y)
    folded = small > _EIGHTH * large
    t = (small - large if folded else small) / (small + large if folded else large) if large > 0 else 0.0
    z = t * t
    z2 = z * z
    low = (_A0 + _A1 * z) + (_A2 + _A3 * z) * z2
    high = (_A4 + _A5 * z) + (_A6 + _A7 * z + _A8 * z2) * z2
    found = t * (low + high * (z2 * z2)) + (0.25 * np.pi if folded else 0.0)
    found = 0.5 * np.pi - found if y > across else found
    return np.pi - found if x < 0 else found


@inner_kernel
def height(planes, i, x, y, z):  # type: ignore[no-untyped-def]
    """Return the height of a point over planes[i]."""
    return planes[i, 0] * x + planes[i, 1] * y + planes[i, 2] * z + planes[i, 3]


@inner_kernel
def clip(polygon, planes, i, eps, target):  # type: ignore[no-untyped-def]
    """Write the part of a polygon in front of planes[i] to `target`; return its number of corners, 0 if empty.

    Corners within eps of the plane count as on it, so that neighbours in that plane leave no slivers.
    """
    source, n = polygon
    highest, lowest = 0.0, 0.0
    for k in range(n):
        h = height(planes, i, source[k, 0], source[k, 1], source[k, 2])
        highest, lowest = max(highest, h), min(lowest, h)
    if highest <= eps:
        return 0
    if lowest >= -eps:
        for k in range(n):
            for j in range(3):
                target[k, j] = source[k, j]
        return n
    m = 0
    last = n - 1
    before = height(planes, i, source[last, 0], source[last, 1], source[last, 2])
    for k in range(n):
        h = height(planes, i, source[k, 0], source[k, 1], source[k, 2])
        if (h > eps and before < -eps) or (h < -eps and before > eps):
            t = before / (before - h)
            for j in range(3):
                target[m, j] = source[last, j] + t * (source[k, j] - source[last, j])
            m += 1
        if h >= -eps:
            for j in range(3):
                target[m, j] = source[k, j]
            m += 1
        last, before = k, h
    return m if m > 2 else 0


@inner_kernel
def measure(polygon, centre):  # type: ignore[no-untyped-def]
    """Return a polygon's area and radius, and write the mean of its corners to `centre`.

    The radius is the largest distance of a corner from the centre.
    """
    points, n = polygon
    for j in range(3):
        centre[j] = 0.0
        for k in range(n):
            centre[j] += points[k, j]
        centre[j] /= n
    radius = 0.0
    x = y = z = 0.0
    for k in range(n):
        ax, ay, az = points[k, 0] - centre[0], points[k, 1] - centre[1], points[k, 2] - centre[2]
        j = k + 1 if k + 1 < n else 0
        bx, by, bz = points[j, 0] - centre[0], points[j, 1] - centre[1], points[j, 2] - centre[2]
        radius = max(radius, ax * ax + ay * ay + az * az)
        x += ay * bz - az * by
        y += az * bx - ax * bz
        z += ax * by - ay * bx
    return 0.5 * (x * x + y * y + z * z) ** 0.5, radius**0.5


@inner_kernel
def triangle_area(points, k):  # type: ignore[no-untyped-def]
    """Return the area of the fan's triangle of corners 0, k and k + 1."""
    ax, ay, az = points[k, 0] - points[0, 0], points[k, 1] - points[0, 1], points[k, 2] - points[0, 2]
    bx, by, bz = points[k + 1, 0] - points[0, 0], points[k + 1, 1] - points[0, 1], points[k + 1, 2] - points[0, 2]
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return 0.5 * (x * x + y * y + z * z) ** 0.5


@inner_kernel
def quadrature(polygon, rule, points):  # type: ignore[no-untyped-def]
    """Write quadrature points of a polygon to `points` (4, m), with weights in the last row; return their number.

    rule : (r, 4) float64, rule of a triangle: barycentric coordinates and weights that add up to 1
    """
    corners, n = polygon
    m = 0
    for k in range(1, n - 1):
        area = triangle_area(corners, k)
        for r in range(len(rule)):
            for j in range(3):
                points[j, m] = (
                    rule[r, 0] * corners[0, j] + rule[r, 1] * corners[k, j] + rule[r, 2] * corners[k + 1, j]
                )
            points[3, m] = rule[r, 3] * area
            m += 1
    return m
