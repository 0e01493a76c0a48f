"""Exchange areas A_a F_ab of two convex polygons that see all of each other, without a ray.

Far apart, by Gauss points on both; otherwise by Stokes' theorem, the double contour integral

    A_a F_ab = 1 / (2 pi)  sum over edges p, q of  (dp . dq)  int int ln r ds dt

of which the inner integral has a closed form, and the outer one is taken by Gauss points on halves of halves until
it stands still, so that edges which touch need no case of their own.

Sources: Sparrow 1963; Mitalas & Stephenson 1966; Schroeder & Hanrahan 1993, "On the form factor between two
polygons", whose closed form of the outer integral takes more time than the points do.
"""

from __future__ import annotations

import numpy as np

from glpath.kernels import inner_kernel
from glpath.radiosity.view_factors.convex import quadrature

#: Halvings of an edge: of what is singular at an end, each leaves a quarter of the error.
_DEEPEST = 24
#: Distances of the centres, in sums of the radii, from which few and more Gauss points are good to 1e-5.
FAR, MIDDLE = 6.0, 2.5

#: Gauss points of an edge, 0 to 1, and their weights.
_G1, _G2 = 0.06943184420297371, 0.33000947820757187
_W1, _W2 = 0.17392742256872693, 0.32607257743127307


def _triangle_rule(orbits: list[tuple[float, float]]) -> np.ndarray:
    points = []
    for a, weight in orbits:
        points += [(1 - 2 * a, a, a, weight), (a, 1 - 2 * a, a, weight), (a, a, 1 - 2 * a, weight)]
    return np.array(points)


#: Exact to degree 2 and 4 (Strang & Fix 1973; Dunavant 1985).
FEW = _triangle_rule([(1 / 6, 1 / 3)])
MORE = _triangle_rule([(0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322)])


@inner_kernel
def between_points(a, n, b, m, na, nb):  # type: ignore[no-untyped-def]
    """sum cos cos / (pi r^2) over points with weights; na, nb: (3,) the unit normals."""
    total = 0.0
    for i in range(n):
        x, y, z, w = a[i, 0], a[i, 1], a[i, 2], a[i, 3]
        part = 0.0
        for k in range(m):
            dx, dy, dz = b[k, 0] - x, b[k, 1] - y, b[k, 2] - z
            here = dx * na[0] + dy * na[1] + dz * na[2]
            there = -(dx * nb[0] + dy * nb[1] + dz * nb[2])
            square = dx * dx + dy * dy + dz * dz
            part += b[k, 3] * here * there / (square * square)
        total += w * part
    return total / np.pi


@inner_kernel
def far_exchange(a, n, b, m, na, nb, rule, points_a, points_b):  # type: ignore[no-untyped-def]
    """Of polygons a[:n] and b[:m], by the Gauss points of a rule."""
    i = quadrature(a, n, rule, points_a)
    j = quadrature(b, m, rule, points_b)
    return between_points(points_a, i, points_b, j, na, nb)


@inner_kernel
def _inner(a, k, ex, ey, ez, s, b, m):  # type: ignore[no-untyped-def]
    """sum over edges q of b of (dp . dq) times the mean of ln r along q, from the point at s on edge k of a."""
    x, y, z = a[k, 0] + s * ex, a[k, 1] + s * ey, a[k, 2] + s * ez
    total = 0.0
    for i in range(m):
        j = i + 1 if i + 1 < m else 0
        fx, fy, fz = b[j, 0] - b[i, 0], b[j, 1] - b[i, 1], b[j, 2] - b[i, 2]
        square = fx * fx + fy * fy + fz * fz
        dot = ex * fx + ey * fy + ez * fz
        if dot == 0 or square == 0:
            continue
        # The distance along q from the foot of the point, and that of the foot, in lengths of q.
        dx, dy, dz = b[i, 0] - x, b[i, 1] - y, b[i, 2] - z
        u = (dx * fx + dy * fy + dz * fz) / square
        v = u + 1
        gx, gy, gz = dx - u * fx, dy - u * fy, dz - u * fz
        h2 = (gx * gx + gy * gy + gz * gz) / square
        r0, r1 = u * u + h2, v * v + h2
        mean = 0.5 * np.log(square) - 1
        if r1 > 0:
            mean += 0.5 * v * np.log(r1)
        if r0 > 0:
            mean -= 0.5 * u * np.log(r0)
        if h2 > 1e-30:
            h = np.sqrt(h2)
            mean += h * np.arctan2(h, h2 + u * v)
        total += dot * mean
    return total


@inner_kernel
def _gauss(a, k, ex, ey, ez, s, width, b, m):  # type: ignore[no-untyped-def]
    return width * (
        _W1
        * (_inner(a, k, ex, ey, ez, s + _G1 * width, b, m) + _inner(a, k, ex, ey, ez, s + (1 - _G1) * width, b, m))
        + _W2
        * (_inner(a, k, ex, ey, ez, s + _G2 * width, b, m) + _inner(a, k, ex, ey, ez, s + (1 - _G2) * width, b, m))
    )


@inner_kernel
def near_exchange(a, n, b, m, tolerance, stack):  # type: ignore[no-untyped-def]
    """Of polygons a[:n] and b[:m], which may touch, and an estimate of its error.

    tolerance : of the result, roughly
    stack     : (_DEEPEST + 2, 3) float64
    """
    total, error = 0.0, 0.0
    allowed = 2 * np.pi * tolerance / n
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        ex, ey, ez = a[j, 0] - a[k, 0], a[j, 1] - a[k, 1], a[j, 2] - a[k, 2]
        stack[0, 0], stack[0, 1] = 0.0, 1.0
        stack[0, 2] = _gauss(a, k, ex, ey, ez, 0.0, 1.0, b, m)
        top = 1
        while top:
            top -= 1
            s, width, whole = stack[top, 0], stack[top, 1], stack[top, 2]
            half = 0.5 * width
            left = _gauss(a, k, ex, ey, ez, s, half, b, m)
            right = _gauss(a, k, ex, ey, ez, s + half, half, b, m)
            off = abs(left + right - whole)
            if off <= allowed * max(width, 0.125) or half < 1e-6:
                total += left + right
                error += off
            else:
                stack[top, 0], stack[top, 1], stack[top, 2] = s, half, left
                stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = s + half, half, right
                top += 2
    return total / (2 * np.pi), 0.25 * error / (2 * np.pi)
