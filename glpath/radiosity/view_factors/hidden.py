"""What a polygon sees of another past occluders: exact from every point, by quadrature over the points.

Occluders that remain between two polygons are clipped to what lies before both. From a point, each casts a pyramid
whose planes divide what is seen of the other polygon into convex parts; those that no pyramid holds are seen, and
Lambert's formula says how much of them. As visibility from a point is exact, the integrand is continuous, and
quartering triangles where two quadratures differ finds its creases.

Source: Nishita & Nakamae 1983, "Half-tone representation of 3-D objects illuminated by area sources".

Poor at:  polygons that hundreds of small occluders stand between.
"""

from __future__ import annotations

import numpy as np

from glpath.kernels import inner_kernel
from glpath.radiosity.view_factors.convex import angle, height

#: Parts of what is seen that wait to be divided further.
PARTS = 256
#: Share below which nothing is seen, or nothing hidden, and of a triangle that corners stand for then.
_SAME, _MISSED = 1e-9, 0.03
#: Quarterings of a triangle, and points of a polygon beyond which it is left at what it is, at errors of `_USUAL`
#: and more. What is asked for less, down to `_FINEST`, has as many more points, and a quartering for four times as
#: many: points that end too early are worse than fewer, as they lie in one corner of the polygon.
_DEEPEST, _MOST_POINTS, _USUAL, _FINEST = 7, 3000, 1e-3, 1e-5
#: How many tolerances an exchange area has for which three points a triangle will do.
COARSE = 6.0


@inner_kernel
def hides_all(a, n, b, m, occluders, o, eps, at_a, at_b):  # type: ignore[no-untyped-def]
    """Whether all segments from points a[:n] to b[:m] cross occluder o, so that none of their hulls' do not.

    at_a, at_b : (ROOM,) room for heights
    """
    planes, edges = occluders.planes, occluders.edges
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
    """Plane k of the pyramid from a point over occluder o: its normal inward, of any length, and what rounding is
    of a height over it."""
    n = work.shade_count[o]
    j = k + 1 if k + 1 < n else 0
    ax, ay, az = work.shades[o, k, 0] - x, work.shades[o, k, 1] - y, work.shades[o, k, 2] - z
    bx, by, bz = work.shades[o, j, 0] - x, work.shades[o, j, 1] - y, work.shades[o, j, 2] - z
    # Counter-clockwise from the front, so clockwise seen from a point before it.
    sign = -work.fronts[o]
    cx, cy, cz = sign * (ay * bz - az * by), sign * (az * bx - ax * bz), sign * (ax * by - ay * bx)
    side = work.pyramid[o, k]
    side[0], side[1], side[2] = cx, cy, cz
    side[3] = work.eps * np.sqrt(cx * cx + cy * cy + cz * cz)
    work.made[o] = k + 1


@inner_kernel
def lambert(parts, i, n, nx, ny, nz):  # type: ignore[no-untyped-def]
    """2 pi times the factor from a small element at the origin to the polygon parts[i, :n] above its horizon."""
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
def seen_from(x, y, z, nx, ny, nz, b, m, shades, planes, work):  # type: ignore[no-untyped-def]
    """Form factors from a point with a normal to polygon b[:m]: of what is seen past the occluders, and of all."""
    parts, corners, following = work.parts, work.part_corners, work.following
    for k in range(m):
        parts[0, k, 0], parts[0, k, 1], parts[0, k, 2] = b[k, 0] - x, b[k, 1] - y, b[k, 2] - z
    corners[0], following[0] = m, 0
    whole = lambert(parts, 0, m, nx, ny, nz)
    # Planes are made when they are asked for: most occluders are beside what is looked at, and the first says so.
    pyramid, made, fronts = work.pyramid, work.made, work.fronts
    for o in range(shades):
        h = height(planes, work.shade_plane[o], x, y, z)
        fronts[o] = 0.0 if abs(h) <= work.eps else 1.0 if h > 0 else -1.0
        made[o] = 0
    seen = 0.0
    in_one = True
    top = 1
    while top:
        top -= 1
        n, o = corners[top], following[top]
        alive = True
        while alive and o < shades:
            if fronts[o] == 0:  # edge-on
                o += 1
                continue
            # Outside of one plane: the pyramid leaves it alone. Inside of all: nothing of it is seen.
            outside, inside = False, True
            sides = work.shade_count[o]
            for e in range(sides):
                if e == made[o]:
                    _make_side(x, y, z, o, e, work)
                side = pyramid[o, e]
                px, py, pz, eps = side[0], side[1], side[2], side[3]
                lowest, highest = 0.0, 0.0
                for k in range(n):
                    h = px * parts[top, k, 0] + py * parts[top, k, 1] + pz * parts[top, k, 2]
                    lowest, highest = min(lowest, h), max(highest, h)
                if highest <= eps:
                    outside = True
                    break
                if lowest < -eps:
                    inside = False
            if outside:
                o += 1
                continue
            if inside:
                alive = False
                break
            if top + sides + 2 >= PARTS:
                break  # too many pieces: the rest counts as seen
            # Cut: what lies outside of a side goes on the stack, the remainder to the next side.
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
def _over_triangle(t, nx, ny, nz, b, m, shades, planes, work):  # type: ignore[no-untyped-def]
    """Means over work.triangles[t] of what is seen and of all: three points, exact to degree 2."""
    seen = whole = 0.0
    corners = work.triangles
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        x = (4 * corners[t, k, 0] + corners[t, i, 0] + corners[t, j, 0]) / 6
        y = (4 * corners[t, k, 1] + corners[t, i, 1] + corners[t, j, 1]) / 6
        z = (4 * corners[t, k, 2] + corners[t, i, 2] + corners[t, j, 2]) / 6
        s, w = seen_from(x, y, z, nx, ny, nz, b, m, shades, planes, work)
        seen += s
        whole += w
    return seen / 3, whole / 3


@inner_kernel
def _at_corners(t, seen, nx, ny, nz, b, m, shades, planes, work):  # type: ignore[no-untyped-def]
    """The mean over the corners of the triangle that work.triangles[t:t + 4] make, just inside, of what is not as
    all else: hidden where the rest is seen, or the other way round."""
    corners = work.triangles
    total = 0.0
    for i in range(3):
        # Of its quarters, the first three have its corners, and the last is the one in the middle.
        x = 0.98 * corners[t + i, i, 0] + 0.02 * corners[t + 3, 0, 0]
        y = 0.98 * corners[t + i, i, 1] + 0.02 * corners[t + 3, 0, 1]
        z = 0.98 * corners[t + i, i, 2] + 0.02 * corners[t + 3, 0, 2]
        s, w = seen_from(x, y, z, nx, ny, nz, b, m, shades, planes, work)
        total += w - s if seen else s
    return total / 3


@inner_kernel
def seen_share(  # type: ignore[no-untyped-def]
    a, n, nx, ny, nz, b, m, exchange, area, tolerance, error_wanted, shades, planes, work
):
    """The share of an exchange area that is seen past occluders; how far two quadratures of it are apart; the root
    of the summed squares of what single points stand for; and how many points there were.

    The points are on a[:n], and what is seen is b[:m].

    exchange  : of the two polygons, without occluders
    area      : of a[:n]
    tolerance : of the exchange area
    error_wanted : of a row's sum
    """
    finer = max(_USUAL / max(error_wanted, _FINEST), 1.0)
    most, deepest = _MOST_POINTS * finer, _DEEPEST + 0.5 * np.log2(finer)
    values, corners = work.values, work.triangles
    seen = whole = error = grain = 0.0
    top = points = 0
    for k in range(1, n - 1):
        for j in range(3):
            corners[top, 0, j], corners[top, 1, j], corners[top, 2, j] = a[0, j], a[k, j], a[k + 1, j]
        ex, ey, ez = a[k, 0] - a[0, 0], a[k, 1] - a[0, 1], a[k, 2] - a[0, 2]
        fx, fy, fz = a[k + 1, 0] - a[0, 0], a[k + 1, 1] - a[0, 1], a[k + 1, 2] - a[0, 2]
        cx, cy, cz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
        values[top, 2] = 0.5 * np.sqrt(cx * cx + cy * cy + cz * cz)
        s, w = _over_triangle(top, nx, ny, nz, b, m, shades, planes, work)
        values[top, 0], values[top, 1], values[top, 3] = s, w, 0.0
        top += 1
        points += 3
    while top and work.stop[0] == 0:
        top -= 1
        s, w, part, depth = values[top, 0], values[top, 1], values[top, 2], values[top, 3]
        if exchange <= COARSE * tolerance:
            seen += s * part
            whole += w * part
            error += 0.5 * min(s, w - s) * part
            grain += (w * part / 3) ** 2
            continue
        # The four of its edges' middles; the first stands where it stood.
        for j in range(3):
            p, q, r = corners[top, 0, j], corners[top, 1, j], corners[top, 2, j]
            pq, qr, rp = 0.5 * (p + q), 0.5 * (q + r), 0.5 * (r + p)
            corners[top, 0, j], corners[top, 1, j], corners[top, 2, j] = p, pq, rp
            corners[top + 1, 0, j], corners[top + 1, 1, j], corners[top + 1, 2, j] = pq, q, qr
            corners[top + 2, 0, j], corners[top + 2, 1, j], corners[top + 2, 2, j] = rp, qr, r
            corners[top + 3, 0, j], corners[top + 3, 1, j], corners[top + 3, 2, j] = qr, rp, pq
        fine_s = fine_w = 0.0
        points += 12
        for i in range(4):
            values[top + i, 2], values[top + i, 3] = 0.25 * part, depth + 1
            cs, cw = _over_triangle(top + i, nx, ny, nz, b, m, shades, planes, work)
            values[top + i, 0], values[top + i, 1] = cs, cw
            fine_s += 0.25 * cs
            fine_w += 0.25 * cw
        # Against the exact exchange, what counts is the share, not the quadrature of the kernel itself.
        expected = s * fine_w / w if w > 0 else 0.0
        off = abs(fine_s - expected) * part
        if fine_s <= _SAME * fine_w or fine_w - fine_s <= _SAME * fine_w:
            # All points say the same, but an edge of a shadow may pass between them and a corner.
            off += _MISSED * part * _at_corners(top, fine_s > 0, nx, ny, nz, b, m, shades, planes, work)
            points += 3
        if off <= 2 * tolerance * np.sqrt(part / area) or depth >= deepest or points > most:
            seen += fine_s * part
            whole += fine_w * part
            error += 0.5 * off
            grain += (fine_w * part / 12) ** 2
        else:
            top += 4
    if whole <= 0:
        return 0.0, 0.0, 0.0, points
    return seen / whole, error / whole, np.sqrt(grain) / whole, points
