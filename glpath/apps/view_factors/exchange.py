"""Exchange areas A_a F_ab of two convex polygons without occluders between them.

Distant polygons use Gauss points on both, with a rule that depends on the distance. Close polygons use Stokes'
theorem, the double contour integral

    A_a F_ab = 1 / (2 pi)  sum over edges p, q of  (dp . dq)  int int ln r ds dt

The inner integral has a closed form. The outer one uses Gauss-Kronrod points and is halved until both rules agree,
so that touching edges need no special case.

Sources: Sparrow 1963; Mitalas & Stephenson 1966; Schroeder & Hanrahan 1993, "On the form factor between two
polygons", whose closed form of the outer integral takes more time than the points do.
"""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from glpath.apps.view_factors.convex import angle, measure, quadrature
from glpath.system.kernels import inner_kernel, inner_sum

#: Distance between two polygons' centres, as a multiple of the sum of their radii, below which they are close. It
#: must be above 1.
_CLOSE = 1.1

#: Tolerance of the contour integral, as a fraction of the allowed error. It is below 1, because both rules may
#: agree although they are wrong. This happens on an edge much longer than the polygons' distance, if no point is
#: close.
_NEAR = 0.2
#: Maximum error of Kronrod's seven points, as a fraction of their difference from Gauss's three points.
_SEVEN = 0.1

#: Kronrod's seven points of an edge, measured from its middle in half lengths, and the weights of both rules. The
#: middle and `_K2` are Gauss's three points (Piessens et al. 1983).
_K1, _K2, _K3 = 0.9604912687080203, 0.7745966692414834, 0.4342437493468026
_W1, _W2, _W3, _W0 = 0.1046562260264673, 0.2684880898683334, 0.4013974147759622, 0.4509165386584741
_G2, _G0 = 5 / 9, 8 / 9


def _triangle_rule(thrice: list[tuple[float, float]], *others: tuple[float, float, float, float]) -> np.ndarray:
    """Return (r, 4), barycentric coordinates and weights of a rule's points.

    Each entry (a, weight) of `thrice` stands for the three points with coordinates 1 - 2a, a and a in any order.
    """
    points = [p for a, w in thrice for p in ((1 - 2 * a, a, a, w), (a, 1 - 2 * a, a, w), (a, a, 1 - 2 * a, w))]
    return np.array([*points, *others])


def _six(a: float, b: float, weight: float) -> list[tuple[float, float, float, float]]:
    return [(x, y, z, weight) for x, y, z in permutations((a, b, 1 - a - b))]


#: Triangle rules that are exact to degree 2, 4, 6 and 8 (Strang & Fix 1973; Dunavant 1985).
RULE_2 = _triangle_rule([(1 / 6, 1 / 3)])
RULE_4 = _triangle_rule([(0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322)])
RULE_6 = _triangle_rule(
    [(0.249286745170910, 0.116786275726379), (0.063089014491502, 0.050844906370207)],
    *_six(0.310352451033785, 0.053145049844816, 0.082851075618374),
)
RULE_8 = _triangle_rule(
    [
        (0.459292588292723, 0.095091634267285),
        (0.170569307751760, 0.103217370534718),
        (0.050547228317031, 0.032458497623198),
    ],
    (1 / 3, 1 / 3, 1 / 3, 0.144315607677787),
    *_six(0.263112829634638, 0.008394777409958, 0.027230314174435),
)
#: Error bounds of the rules, in units of d^-(degree + 2) A_a A_b / (pi r^2). Here r is the distance of the centres,
#: and d is r divided by the sum of the radii. The largest errors on random polygons are about half of these bounds.
_OFF_2, _OFF_4, _OFF_6, _OFF_8 = 0.2, 0.04, 0.01, 1.5e-3


@inner_kernel
def exchange(a, b, na, nb, floor, relative, work):  # type: ignore[no-untyped-def]
    """Return the exchange area of two polygons, each entirely in front of the other, and its estimated error.

    na, nb          : (3,) unit normals
    floor, relative : allowed error, as an exchange area, and as a fraction of the result; the larger one counts
    """
    area_a, radius_a = measure(a, work.centre_a)
    area_b, radius_b = measure(b, work.centre_b)
    square = 0.0
    for k in range(3):
        square += (work.centre_a[k] - work.centre_b[k]) ** 2
    apart2 = square / (radius_a + radius_b) ** 2
    rough = max(_by_points(a, b, na, nb, work.rule_2, work), 0.0)
    tolerance = max(floor, relative * rough)
    if apart2 >= _CLOSE**2:
        facing = area_a * area_b / (np.pi * square)
        near4 = 1 / (apart2 * apart2)
        off = _OFF_2 * facing * near4
        if off <= tolerance:
            return rough, off
        off = _OFF_4 * facing * near4 / apart2
        if off <= tolerance:
            return max(_by_points(a, b, na, nb, work.rule_4, work), 0.0), off
        off = _OFF_6 * facing * near4 * near4
        if off <= tolerance:
            return max(_by_points(a, b, na, nb, work.rule_6, work), 0.0), off
        off = _OFF_8 * facing * near4 * near4 / apart2
        if off <= tolerance:
            return max(_by_points(a, b, na, nb, work.rule_8, work), 0.0), off
    first, second = (a, b) if radius_a <= radius_b else (b, a)
    found, off = near_exchange(first, second, _NEAR * floor, work.halves)
    return max(found, 0.0), off


@inner_kernel
def _by_points(a, b, na, nb, rule, work):  # type: ignore[no-untyped-def]
    """Return the exchange area of two polygons from the Gauss points of a rule."""
    i = quadrature(a, rule, work.points_a)
    j = quadrature(b, rule, work.points_b)
    return _between_points(work.points_a, i, work.points_b, j, na, nb)


@inner_sum
def _between_points(a, n, b, m, na, nb):  # type: ignore[no-untyped-def]
    """Return the weighted sum of cos cos / (pi r^2) over pairs of points; a, b (4, m) are positions and weights."""
    total = 0.0
    for i in range(n):
        x, y, z, w = a[0, i], a[1, i], a[2, i], a[3, i]
        part = 0.0
        for k in range(m):
            dx, dy, dz = b[0, k] - x, b[1, k] - y, b[2, k] - z
            here = dx * na[0] + dy * na[1] + dz * na[2]
            there = -(dx * nb[0] + dy * nb[1] + dz * nb[2])
            square = dx * dx + dy * dy + dz * dz
            part += b[3, k] * here * there / (square * square)
        total += w * part
    return total / np.pi


class _Edge(NamedTuple):
    """Edge: its start, and the vector to its end."""

    x: float
    y: float
    z: float
    ex: float
    ey: float
    ez: float


@inner_kernel
def _inner(edge, s, polygon):  # type: ignore[no-untyped-def]
    """Return the sum over edges q of a polygon of (dp . dq) times the mean of ln r along q.

    r is measured from the point at parameter s on an edge p. A constant of the means is left out, because it
    cancels over a closed polygon.
    """
    ex, ey, ez = edge.ex, edge.ey, edge.ez
    x, y, z = edge.x + s * ex, edge.y + s * ey, edge.z + s * ez
    b, m = polygon
    total = 0.0
    dx, dy, dz = b[m - 1, 0] - x, b[m - 1, 1] - y, b[m - 1, 2] - z
    square = dx * dx + dy * dy + dz * dz
    log_d = np.log(square) if square > 0 else 0.0
    for i in range(m):
        gx, gy, gz = b[i, 0] - x, b[i, 1] - y, b[i, 2] - z
        square = gx * gx + gy * gy + gz * gz
        log_g = np.log(square) if square > 0 else 0.0
        j = i - 1 if i else m - 1
        fx, fy, fz = b[i, 0] - b[j, 0], b[i, 1] - b[j, 1], b[i, 2] - b[j, 2]
        dot = ex * fx + ey * fy + ez * fz
        length2 = fx * fx + fy * fy + fz * fz
        if dot != 0 and length2 > 0:
            # Distances in units of q's length. The foot is the point of q's line that is nearest to the point. u
            # leads along q from the foot to the start of q, and h from the point to the foot.
            u = (dx * fx + dy * fy + dz * fz) / length2
            v = u + 1
            hx, hy, hz = dx - u * fx, dy - u * fy, dz - u * fz
            h2 = (hx * hx + hy * hy + hz * hz) / length2
            mean = 0.5 * (v * log_g - u * log_d)
            if h2 > 1e-30:
                h = np.sqrt(h2)
                mean += h * angle(h, h2 + u * v)
            total += dot * mean
        dx, dy, dz, log_d = gx, gy, gz, log_g
    return total


@inner_kernel
def _touches(a, k, polygon):  # type: ignore[no-untyped-def]
    """Return True if point a[k] is a corner of the polygon, where the logarithm but not its integral diverges."""
    b, m = polygon
    for i in range(m):
        dx, dy, dz = b[i, 0] - a[k, 0], b[i, 1] - a[k, 1], b[i, 2] - a[k, 2]
        if dx * dx + dy * dy + dz * dz == 0:
            return True
    return False


@inner_kernel
def _along(edge, start, width, smoothed, polygon):  # type: ignore[no-untyped-def]
    """Return the integral of `_inner` over a part of an edge by seven points, and its difference from three points.

    smoothed : True to substitute s = t^2 (3 - 2 t), so that the integrand is smooth at an end that touches the
               polygon
    """
    half = 0.5 * width
    seven = three = 0.0
    for i in range(4):
        node, weight = (0.0, _W0) if i == 0 else (_K2, _W2) if i == 1 else (_K1, _W1) if i == 2 else (_K3, _W3)
        pair = 0.0
        for sign in range(1 if i == 0 else 2):
            s, scale = start + half * (1 + (2 * sign - 1) * node), 1.0
            if smoothed:
                s, scale = s * s * (3 - 2 * s), 6 * s * (1 - s)
            pair += scale * _inner(edge, s, polygon)
        seven += weight * pair
        three += pair * (_G0 if i == 0 else _G2 if i == 1 else 0.0)
    return half * seven, half * abs(seven - three)


@inner_kernel
def near_exchange(first, second, tolerance, stack):  # type: ignore[no-untyped-def]
    """Return the exchange area of polygons that may touch, and its estimated error.

    tolerance : approximate tolerance of the result
    stack     : (24, 2) float64 or larger; parts of an edge that were halved twenty times are not halved further
    """
    a, n = first
    total, error = 0.0, 0.0
    allowed = 2 * np.pi * tolerance / n
    for k in range(n):
        j = k + 1 if k + 1 < n else 0
        ex, ey, ez = a[j, 0] - a[k, 0], a[j, 1] - a[k, 1], a[j, 2] - a[k, 2]
        edge = _Edge(a[k, 0], a[k, 1], a[k, 2], ex, ey, ez)
        smoothed = _touches(a, k, second) or _touches(a, j, second)
        stack[0, 0], stack[0, 1] = 0.0, 1.0
        top = 1
        while top:
            top -= 1
            s, width = stack[top, 0], stack[top, 1]
            found, off = _along(edge, s, width, smoothed, second)
            off *= _SEVEN
            if off <= allowed * max(width, 0.125) or width < 1e-6:
                total += found
                error += off
            else:
                half = 0.5 * width
                stack[top, 0], stack[top, 1] = s, half
                stack[top + 1, 0], stack[top + 1, 1] = s + half, half
                top += 2
    return total / (2 * np.pi), error / (2 * np.pi)
