"""Visibility between polygons past occluders: exact from every point of one, quadrature over these points.

Occluders between two polygons are clipped to the part in front of both. For a point on one polygon, each occluder
has a shadow pyramid, whose planes divide the other polygon into convex parts. Parts outside all pyramids are
visible, and Lambert's formula gives their form factor. Because visibility from a point is exact, the integrand is
continuous.

Source: Nishita & Nakamae 1983, "Half-tone representation of 3-D objects illuminated by area sources".

Poor at:  polygons with hundreds of small occluders between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glpath.apps.view_factors.convex import angle, height, triangle_area
from glpath.system.kernels import inner_kernel

#: Maximum number of parts of the visible polygon that wait to be divided further.
PARTS = 1024
#: Number of blocks into which points are divided; differences of the blocks' means give the standard error.
BLOCKS = 4
#: If nearly all points agree, a shadow may still lie between them. The square of this value divided by their number
#: is then added to the variance of the visible fraction.
MISSED = 0.3
#: Number of stored points of Sobol's sequence.
MAX_POINTS = 1 << 16
#: The points also estimate the unoccluded exchange area, whose exact value is known. The square of this fraction
#: of the estimate's relative error is added to the variance of the visible fraction.
UNKNOWN = 0.5
_UNIT = 2.0**-32


class Sampling(NamedTuple):
    """Counts of sample points for a visible fraction, from the first count to the last.

    The count is doubled until the standard error of the fraction is small enough.

    first, max_points : powers of 2 from `BLOCKS` to `MAX_POINTS`
    tolerance         : target standard error
    """

    first: int
    max_points: int
    tolerance: float


@inner_kernel
def hides_all(first, second, occluders, o, work):  # type: ignore[no-untyped-def]
    """Return True if all segments between the points of two polygons cross occluder o."""
    a, n = first
    b, m = second
    planes, edges, eps, at_a, at_b = occluders.planes, occluders.edges, work.eps, work.at_a, work.at_b
    sign = 0.0
    for i in range(n):
        at_a[i] = height(planes, o, a[i, 0], a[i, 1], a[i, 2])
        if abs(at_a[i]) > eps:
            if sign * at_a[i] < 0:
                return False
            sign = at_a[i]
    for i in range(m):
        at_b[i] = height(planes, o, b[i, 0], b[i, 1], b[i, 2])
        if at_b[i] * sign > 0 and abs(at_b[i]) > eps:
            return False
    if sign == 0:
        return False
    for e in range(occluders.sides[o]):
        f0, f1, f2, f3 = edges[o, e, 0], edges[o, e, 1], edges[o, e, 2], edges[o, e, 3]
        for i in range(n):
            inside_a = f0 * a[i, 0] + f1 * a[i, 1] + f2 * a[i, 2] + f3
            ha = abs(at_a[i])
            for j in range(m):
                hb = abs(at_b[j])
                inside_b = f0 * b[j, 0] + f1 * b[j, 1] + f2 * b[j, 2] + f3
                if ha * inside_b + hb * inside_a < -eps * (ha + hb):
                    return False
    return True


@inner_kernel
def _make_side(x, y, z, o, k, work):  # type: ignore[no-untyped-def]
    """Write plane k of occluder o's shadow pyramid from a point: inward normal, not normalized, and a tolerance.

    Heights above the plane within the tolerance count as rounding errors.
    """
    n = work.clipped_count[o]
    j = k + 1 if k + 1 < n else 0
    ax, ay, az = work.clipped[o, k, 0] - x, work.clipped[o, k, 1] - y, work.clipped[o, k, 2] - z
    bx, by, bz = work.clipped[o, j, 0] - x, work.clipped[o, j, 1] - y, work.clipped[o, j, 2] - z
    # The occluder is counter-clockwise seen from its front, so the sign depends on the side of the point.
    sign = -work.fronts[o]
    cx, cy, cz = sign * (ay * bz - az * by), sign * (az * bx - ax * bz), sign * (ax * by - ay * bx)
    side = work.pyramid[o, k]
    side[0], side[1], side[2] = cx, cy, cz
    side[3] = work.eps * np.sqrt(cx * cx + cy * cy + cz * cz)
    work.made[o] |= 1 << k  # a bit for each side


@inner_kernel
def lambert(parts, i, n, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Return 2 pi times the form factor from an element at the origin to polygon parts[i, :n] over its horizon."""
    total = 0.0
    ax, ay, az = parts[i, n - 1, 0], parts[i, n - 1, 1], parts[i, n - 1, 2]
    for k in range(n):
        bx, by, bz = parts[i, k, 0], parts[i, k, 1], parts[i, k, 2]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        sine = np.sqrt(cx * cx + cy * cy + cz * cz)
        if sine > 0:
            total += angle(sine, ax * bx + ay * by + az * bz) * (cx * nx + cy * ny + cz * nz) / sine
        ax, ay, az = bx, by, bz
    return abs(total)


@inner_kernel
def seen_from(point, plane, polygon, clipped, work):  # type: ignore[no-untyped-def]
    """Return form factors from a point in a plane to a polygon: past the occluders work.clipped, and unoccluded."""
    x, y, z = point
    nx, ny, nz = plane[0], plane[1], plane[2]
    b, m = polygon
    parts, corners, following = work.parts, work.part_corners, work.following
    for k in range(m):
        parts[0, k, 0], parts[0, k, 1], parts[0, k, 2] = b[k, 0] - x, b[k, 1] - y, b[k, 2] - z
    corners[0], following[0] = m, 0
    whole = lambert(parts, 0, m, nx, ny, nz)
    # Planes are built on demand, because one plane is enough for most occluders, which lie beside the polygon.
    pyramid, made, fronts = work.pyramid, work.made, work.fronts
    for o in range(clipped):
        h = height(work.clipped_planes, o, x, y, z)
        fronts[o] = 0.0 if abs(h) <= work.eps else 1.0 if h > 0 else -1.0
        made[o] = 0
    seen = 0.0
    in_one = True
    top = 1
    while top:
        top -= 1
        n, o = corners[top], following[top]
        alive = True
        while alive and o < clipped:
            if fronts[o] == 0:  # the point lies in the occluder's plane, so the occluder hides nothing
                o += 1
                continue
            # A part outside one plane is not affected by the pyramid; a part inside all planes is hidden.
            outside, inside = False, True
            sides = work.clipped_count[o]
            e = work.parting[o]
            for _ in range(sides):
                if made[o] >> e & 1 == 0:
                    _make_side(x, y, z, o, e, work)
                side = pyramid[o, e]
                px, py, pz, eps = side[0], side[1], side[2], side[3]
                lowest, highest = 0.0, 0.0
                for k in range(n):
                    h = px * parts[top, k, 0] + py * parts[top, k, 1] + pz * parts[top, k, 2]
                    lowest, highest = min(lowest, h), max(highest, h)
                if highest <= eps:
                    outside = True
                    work.parting[o] = (
                        e  # this plane of the pyramid probably rejects the occluder for the next sample point too
                    )
                    break
                if lowest < -eps:
                    inside = False
                e = e + 1 if e + 1 < sides else 0
            if outside:
                o += 1
                continue
            if inside:
                alive = False
                break
            if top + sides + 2 >= PARTS:
                work.lost[0] += 1  # too many pieces: the rest counts as seen
                break
            # Cut the part: the piece outside a side is pushed, the remainder is cut by the next side.
            in_one = False
            rest = top + sides + 1
            for k in range(n):
                for j in range(3):
                    parts[rest, k, j] = parts[top, k, j]
            left = n
            put = top
            for e in range(sides):
                side = pyramid[o, e]
                px, py, pz, eps = side[0], side[1], side[2], side[3]
                out, within = 0, 0
                last = left - 1
                before = px * parts[rest, last, 0] + py * parts[rest, last, 1] + pz * parts[rest, last, 2]
                cut = False
                for k in range(left):
                    h = px * parts[rest, k, 0] + py * parts[rest, k, 1] + pz * parts[rest, k, 2]
                    if (h > eps and before < -eps) or (h < -eps and before > eps):
                        t = before / (before - h)
                        for j in range(3):
                            value = parts[rest, last, j] + t * (parts[rest, k, j] - parts[rest, last, j])
                            parts[put, out, j] = value
                            parts[rest + 1, within, j] = value
                        out += 1
                        within += 1
                    if h >= -eps:
                        for j in range(3):
                            parts[rest + 1, within, j] = parts[rest, k, j]
                        within += 1
                    if h <= eps:
                        for j in range(3):
                            parts[put, out, j] = parts[rest, k, j]
                        out += 1
                    cut = cut or h < -eps
                    last, before = k, h
                if cut and out > 2 and out < parts.shape[1] - 2:
                    corners[put], following[put] = out, o + 1
                    put += 1
                left = within
                if left < 3 or left > parts.shape[1] - 3:
                    break
                for k in range(left):
                    for j in range(3):
                        parts[rest, k, j] = parts[rest + 1, k, j]
            top = put
            alive = False
        if alive:
            seen += whole if in_one else lambert(parts, top, n, nx, ny, nz)
    return seen / (2 * np.pi), whole / (2 * np.pi)


@inner_kernel
def point_of(polygon, first, second, fan, begin):  # type: ignore[no-untyped-def]
    """Map two 32-bit integers to a point of a polygon, uniformly by area.

    fan   : (n,) working memory for cumulative areas of the fan's triangles
    begin : True to compute `fan` first
    """
    a, n = polygon
    if begin:
        area = 0.0
        for k in range(1, n - 1):
            area += triangle_area(a, k)
            fan[k] = area
    u, v = (first + 0.5) * _UNIT * fan[n - 2], (second + 0.5) * _UNIT
    k, before = 1, 0.0
    while k < n - 2 and u >= fan[k]:
        before = fan[k]
        k += 1
    root = np.sqrt(min(max((u - before) / max(fan[k] - before, 1e-300), 0.0), 1.0))
    p, q, r = 1 - root, root * (1 - v), root * v
    return (
        p * a[0, 0] + q * a[k, 0] + r * a[k + 1, 0],
        p * a[0, 1] + q * a[k, 1] + r * a[k + 1, 1],
        p * a[0, 2] + q * a[k, 2] + r * a[k + 1, 2],
    )


@inner_kernel
def seen_share(a, plane, b, exchange, sampling, seed, clipped, work):  # type: ignore[no-untyped-def]
    """Return the fraction of an exchange area visible past occluders, its standard error, and the number of points.

    From each of the scrambled Sobol points on polygon a, which lies in `plane`, the visibility of polygon b is
    computed. The standard error is estimated from the means of `BLOCKS` successive blocks of points. All blocks
    together are distributed more evenly than each block, so the estimate is cautious.

    exchange : exchange area of the two polygons without occluders
    sampling : first and maximum count of points, and the tolerated standard error as an exchange area
    seed     : seed of the scrambling
    """
    r0 = mixed(seed)
    r1 = mixed(r0)
    sums, sobol = work.blocks, work.sobol
    for o in range(clipped):
        work.parting[o] = 0
    size = sampling.first // BLOCKS
    filled = points = 0
    while True:
        for block in range(filled, BLOCKS):
            seen = whole = 0.0
            for _ in range(size):
                first, second = _scrambled(sobol[points, 0], r0), _scrambled(sobol[points, 1], r1)
                point = point_of(a, first, second, work.fan, points == 0)
                points += 1
                s, w = seen_from(point, plane, b, clipped, work)
                seen += s
                whole += w
            sums[block, 0], sums[block, 1] = seen, whole
            if work.stop[0] != 0:
                return 0.0, 0.0, points
        seen = whole = 0.0
        for block in range(BLOCKS):
            seen += sums[block, 0]
            whole += sums[block, 1]
        if whole <= 0:
            return 0.0, 0.0, points
        share = seen / whole
        # Variance of the ratio of visible to total sums. The ratio is applied to the exact exchange area, so errors
        # that both sums share cancel.
        variance = 0.0
        for block in range(BLOCKS):
            variance += (sums[block, 0] - share * sums[block, 1]) ** 2
        variance *= BLOCKS / ((BLOCKS - 1.0) * whole * whole)
        if min(share, 1 - share) * points < 1:
            variance += (MISSED / points) ** 2
        # The relative error of the points' total, whose exact value is known, is added too; see `UNKNOWN`.
        if exchange > 0:
            variance += (UNKNOWN * min(abs(whole * work.fan[a.n - 2] / (points * exchange) - 1), 1.0)) ** 2
        uncertain = np.sqrt(variance)
        if uncertain * exchange <= sampling.tolerance or points >= sampling.max_points:
            return share, uncertain, points
        for block in range(BLOCKS // 2):
            for j in range(2):
                sums[block, j] = sums[2 * block, j] + sums[2 * block + 1, j]
        filled = BLOCKS // 2
        size *= 2


@inner_kernel
def _reversed(x):  # type: ignore[no-untyped-def]
    x = (x >> 1 & 0x55555555) | ((x & 0x55555555) << 1)
    x = (x >> 2 & 0x33333333) | ((x & 0x33333333) << 2)
    x = (x >> 4 & 0x0F0F0F0F) | ((x & 0x0F0F0F0F) << 4)
    x = (x >> 8 & 0x00FF00FF) | ((x & 0x00FF00FF) << 8)
    return x >> 16 | ((x & 0xFFFF) << 16)


@inner_kernel
def _times(x, low, high):  # type: ignore[no-untyped-def]
    """Return the lower 32 bits of x times a factor, without exceeding 63 bits.

    low, high : lower and upper 16 bits of the factor
    """
    return (x * low + ((x * high & 0xFFFF) << 16)) & 0xFFFFFFFF


@inner_kernel
def _scrambled(x, seed):  # type: ignore[no-untyped-def]
    """Return 32-bit x with nested scrambling (Owen 1995): a hash of the higher bits decides if a bit is flipped.

    Smooth functions need fewer points than with a shift. The hash is that of Laine & Karras 2011.
    """
    x = (_reversed(x) + (seed << 1 | seed >> 30)) & 0xFFFFFFFF
    x ^= _times(x, 0xB47C, 0x6C50)
    x ^= _times(x, 0x1E52, 0xB82F)
    x ^= _times(x, 0xE638, 0xC7AF)
    x ^= _times(x, 0xF6E6, 0x8D22)
    return _reversed(x)


@inner_kernel
def mixed(x):  # type: ignore[no-untyped-def]
    """Return a 31-bit hash of a 31-bit number x.

    All products fit into 63 bits, because LLVM leaves overflow undefined.
    """
    x = (x + 0x1E3779B9) & 0x7FFFFFFF
    x = ((x ^ (x >> 16)) * 0x45D9F3B) & 0x7FFFFFFF
    x = ((x ^ (x >> 15)) * 0x45D9F3B) & 0x7FFFFFFF
    return x ^ (x >> 16)


def sobol_points(count: int) -> np.ndarray:
    """Return (count, 4) int64, 32-bit points of Sobol's sequence, with the direction numbers of Joe & Kuo 2008."""
    k = np.arange(count)
    points = np.zeros((count, 4), np.int64)
    for dimension, (coefficients, start) in enumerate(((0, [1] * 32), (0, [1]), (1, [1, 3]), (1, [1, 3, 1]))):
        m, degree = list(start), len(start)
        while len(m) < 32:
            new = m[-degree] ^ (m[-degree] << degree)
            for bit in range(1, degree):
                new ^= (coefficients >> (degree - 1 - bit) & 1) * (m[-bit] << bit)
            m.append(new)
        for bit in range(max(count - 1, 1).bit_length()):
            points[(k >> bit & 1).astype(np.bool_), dimension] ^= m[bit] << (31 - bit)
    return points


SOBOL = sobol_points(MAX_POINTS)
