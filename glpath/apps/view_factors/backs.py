"""Estimate the fraction of each face's light that arrives at backs, which is in no view factor and not in the sky.

Backs are not rows, so they have no factors. The fractions are estimated by cosine-weighted rays from Sobol points
of each facet. A few rays for each facet find out if any back is visible at all. Only if so, all facets get as many
rays as the error requires.

Cost:    0.3 to 3 microseconds a ray. A closed model takes 16 rays a facet, an open one 128; if backs are visible, a
         facet that sees them takes some 70,000 at an error of 1e-3.
Poor at: backs that only a few facets see a little of. If all first rays miss them, they are ignored.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import chain
from threading import Thread
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.apps.view_factors.convex import Polygon
from glpath.apps.view_factors.hidden import BLOCKS, MAX_POINTS, SOBOL, Sampling, mixed, point_of
from glpath.system.kernels import inner_kernel, kernel

if TYPE_CHECKING:
    from glpath.apps.view_factors.faces import Geometry

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

#: Number of first rays of a facet in closed models.
_CLOSED = 16
#: Number of first rays of a facet in models that are not closed.
_OPEN = 128
#: Minimum total number of first rays; each facet of a small model gets more to reach it.
_ALTOGETHER = 4096
#: Target standard error of a back fraction, relative to the target error of a row's sum.
_SHARE = 0.4
#: Maximum number of facets of a task.
_TASK = 64


def back_shares(
    where: Geometry, closed: bool, error: float, threads: int, stop: Int64, report: Callable[[], None]
) -> tuple[Float64, Float64]:
    """Return (rows,) fractions of each row's light that arrive at backs, and (rows,) their standard errors.

    closed : True if faces are closed surfaces, so that backs are rarely visible
    stop   : (1,), a value other than 0 ends the computation
    report : function that is called now and then
    """
    total = len(where.facets.sides)
    shares, errors = np.zeros((2, total))
    few = max(_CLOSED if closed else _OPEN, _ALTOGETHER // total)
    few = min(1 << (few - 1).bit_length(), MAX_POINTS)

    def cast(first: int, max_points: int) -> None:
        starts = iter(range(0, total, _TASK))
        sampling = Sampling(first, max_points, _SHARE * error)
        failures: list[BaseException] = []

        def work() -> None:
            try:
                for begin in starts:
                    end = min(begin + _TASK, total)
                    room = _Work(where.eps, SOBOL, np.empty(len(where.facets.corners[0])), stop)
                    back_rays(begin, end, where.facets, where.tree, sampling, shares, errors, room)
            except BaseException as failed:
                failures.append(failed)

        running = [Thread(target=work, daemon=True) for _ in range(threads)]
        try:
            for thread in running:
                thread.start()
            for thread in running:
                while thread.is_alive():
                    thread.join(0.1)
                    report()
        except BaseException:
            stop[0] = 1
            raise
        if failures:
            raise failures[0]

    cast(few, few)
    if shares.any():
        enough = min(max(256, 1 << round(-np.log2(error))), 4096)
        cast(max(few, enough), MAX_POINTS)
    else:
        errors[:] = 0.0
    rows = len(where.areas)
    weights = where.facets.areas / where.areas[where.row]
    share = np.bincount(where.row, weights * shares, rows).astype(np.float64)
    return share, np.sqrt(np.bincount(where.row, (weights * errors) ** 2, rows)).astype(np.float64)


def is_closed(outlines: Sequence[Sequence[int]]) -> bool:
    """Return True if each edge has exactly two faces, which run along it in opposite directions."""
    edges = Counter(chain.from_iterable(zip(o, (*o[1:], o[0]), strict=True) for o in outlines))
    return all(count == 1 and edges.get((b, a)) == 1 for (a, b), count in edges.items())


class _Work(NamedTuple):
    """Working memory of a task; `eps`, `sobol`, `fan` and `stop` are as in `records.Work`."""

    eps: float
    sobol: Int64
    fan: Float64
    stop: Int64


class _Ray(NamedTuple):
    """Ray with an origin, a direction, and the minimum distance of hits."""

    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float
    min_t: float


@kernel
def back_rays(begin, end, facets, tree, sampling, shares, errors, work):  # type: ignore[no-untyped-def]
    """Fill in shares of facets `begin` to `end` and their standard errors, with one ray for each sample point."""
    eps, sobol = work.eps, work.sobol
    sums = (0.0, 0.0, 0.0, 0.0)
    for i in range(begin, end):
        r0 = mixed(mixed(i) ^ 0x2545F49)
        r1 = mixed(r0)
        r2 = mixed(r1)
        r3 = mixed(r2)
        plane = facets.planes[i]
        nx, ny, nz = plane[0], plane[1], plane[2]
        # Duff et al. 2017, "Building an orthonormal basis, revisited".
        sign = 1.0 if nz >= 0 else -1.0
        p = -1.0 / (sign + nz)
        q = nx * ny * p
        tx, ty, tz = 1.0 + sign * nx * nx * p, sign * q, -sign * nx
        bx, by, bz = q, sign + ny * ny * p, -ny
        polygon = Polygon(facets.corners[i], facets.sides[i])
        size, points, filled = sampling.first // BLOCKS, 0, 0
        sums = (0.0, 0.0, 0.0, 0.0)
        while True:
            s0, s1, s2, s3 = sums
            for block in range(filled, BLOCKS):
                hits = 0.0
                for _ in range(size):
                    u = ((sobol[points, 2] ^ (r2 << 1)) + 0.5) * 2.0**-32
                    v = ((sobol[points, 3] ^ (r3 << 1)) + 0.5) * 2.0**-32
                    a, b = sobol[points, 0] ^ (r0 << 1), sobol[points, 1] ^ (r1 << 1)
                    x, y, z = point_of(polygon, a, b, work.fan, points == 0)
                    points += 1
                    radius, turn = np.sqrt(u), 2 * np.pi * v
                    c, s, up = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - u)
                    dx = c * tx + s * bx + up * nx
                    dy = c * ty + s * by + up * ny
                    dz = c * tz + s * bz + up * nz
                    hits += _meets_back(_Ray(x, y, z, dx, dy, dz, eps / up), facets, tree, eps)
                if work.stop[0] != 0:
                    return
                if block == 0:
                    s0 = hits
                elif block == 1:
                    s1 = hits
                elif block == 2:
                    s2 = hits
                else:
                    s3 = hits
            found = s0 + s1 + s2 + s3
            mean = 0.25 * found
            square = (s0 - mean) ** 2 + (s1 - mean) ** 2 + (s2 - mean) ** 2 + (s3 - mean) ** 2
            # A few rays may agree accidentally, so 0.1 is added to the squared error of the count if only some rays
            # hit backs.
            off = np.sqrt(square * BLOCKS / (BLOCKS - 1.0) + (0.1 if 0 < found < points else 0.0)) / points
            shares[i], errors[i] = found / points, off
            if off <= sampling.tolerance or points >= sampling.max_points:
                break
            sums = (s0 + s1, s2 + s3, 0.0, 0.0)
            filled = BLOCKS // 2
            size *= 2


@inner_kernel
def _meets_back(ray, facets, tree, eps):  # type: ignore[no-untyped-def]
    """Return 1.0 if a ray's first hit is the back of a facet that no front coincides with, otherwise 0.0."""
    x, y, z, dx, dy, dz, min_t = ray
    front = back = np.inf
    ix, iy, iz = 1.0 / dx, 1.0 / dy, 1.0 / dz
    boxes, skip = tree.boxes, tree.skip
    node, count = 0, len(skip)
    while node < count:
        near, far = min_t - eps, min(front, back) + 4 * eps
        a, b = (boxes[node, 0] - eps - x) * ix, (boxes[node, 3] + eps - x) * ix
        near, far = max(near, min(a, b)), min(far, max(a, b))
        a, b = (boxes[node, 1] - eps - y) * iy, (boxes[node, 4] + eps - y) * iy
        near, far = max(near, min(a, b)), min(far, max(a, b))
        a, b = (boxes[node, 2] - eps - z) * iz, (boxes[node, 5] + eps - z) * iz
        near, far = max(near, min(a, b)), min(far, max(a, b))
        if near > far:
            node = skip[node]
            continue
        if tree.leaf[node]:
            j = np.int64(tree.first[node])
            p = facets.planes
            slope = p[j, 0] * dx + p[j, 1] * dy + p[j, 2] * dz
            if slope != 0:
                t = -(p[j, 0] * x + p[j, 1] * y + p[j, 2] * z + p[j, 3]) / slope
                if t > min_t and t < min(front, back) + 4 * eps:
                    hx, hy, hz = x + t * dx, y + t * dy, z + t * dz
                    inside = True
                    for e in range(facets.sides[j]):
                        edge = facets.edges[j, e]
                        if edge[0] * hx + edge[1] * hy + edge[2] * hz + edge[3] < -eps:
                            inside = False
                            break
                    if inside and slope < 0:
                        front = min(front, t)
                    elif inside:
                        back = min(back, t)
        node += 1
    return 1.0 if back < front - 2 * eps else 0.0
