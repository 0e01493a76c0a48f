"""Nearest hits of rays in a BVH of triangles, on the CPU."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glpath.accel.bvh import build_bvh
from glpath.scene import Scene
from glpath.scene.model import Float64, Int32
from glpath.system.kernels import inner_kernel
from glpath.system.threads import Stop

#: Minimum distance of a hit, as a fraction of the scene's extent.
_START = 1e-9


class Rays(NamedTuple):
    """BVH and triangles for `nearest`.

    boxes   : (M, 6) boxes of the nodes; see `Bvh` for skip, first, items (its count) and order
    corners : (T, 9): corner 0 of each triangle, and the edges from it to corners 1 and 2
    start   : minimum distance of a hit
    stop    : flag of `worker_threads`; while it is set, `nearest` finds nothing
    """

    boxes: Float64
    skip: Int32
    first: Int32
    items: Int32
    order: Int32
    corners: Float64
    start: float
    stop: Stop


def rays_of(scene: Scene) -> Rays:
    """Build the ray queries of a triangulated scene."""
    low, high = scene.bounds
    return rays_through(scene.triangles, float(np.max(high - low)))


def rays_through(triangles: Float64, extent: float) -> Rays:
    """Build the ray queries of T >= 1 triangles (T, 3, 3) in a scene whose box has a longest side of `extent`."""
    tree = build_bvh(triangles.min(axis=1), triangles.max(axis=1))
    start = _START * extent
    # Boxes are widened by more than the rounding error of a hit, so that a test of a box misses no hit.
    boxes = np.concatenate([tree.lower - start, tree.upper + start], axis=1)
    corners = np.concatenate(
        [triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]], 1
    )
    stop = np.zeros(1, np.int64)
    return Rays(boxes, tree.skip, tree.first, tree.count, tree.order, np.ascontiguousarray(corners), start, stop)


@inner_kernel
def nearest(rays, o, d, own, found):  # type: ignore[no-untyped-def]
    """Return the first triangle along a ray except `own`, or -1. Fills `found`: distance and b1, b2 of the hit."""
    if rays.stop[0]:
        return -1
    boxes, corners = rays.boxes, rays.corners
    ox, oy, oz, dx, dy, dz = o[0], o[1], o[2], d[0], d[1], d[2]
    # Infinite values give correct results. Only 0 * infinity is NaN, which min and max ignore.
    ix, iy, iz = 1 / dx, 1 / dy, 1 / dz
    far, hit = np.inf, -1
    node = 0
    while node < len(rays.skip):
        ax, bx = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
        ay, by = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
        az, bz = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
        near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), 0.0))
        end = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), far))
        if near > end:
            node = rays.skip[node]
            continue
        for item in range(rays.first[node], rays.first[node] + rays.items[node]):
            t = rays.order[item]
            if t == own:
                continue
            # Moeller & Trumbore 1997.
            e1x, e1y, e1z = corners[t, 3], corners[t, 4], corners[t, 5]
            e2x, e2y, e2z = corners[t, 6], corners[t, 7], corners[t, 8]
            px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
            determinant = e1x * px + e1y * py + e1z * pz
            if determinant == 0:
                continue
            over = 1 / determinant
            sx, sy, sz = ox - corners[t, 0], oy - corners[t, 1], oz - corners[t, 2]
            b1 = (sx * px + sy * py + sz * pz) * over
            if b1 < 0 or b1 > 1:
                continue
            qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
            b2 = (dx * qx + dy * qy + dz * qz) * over
            distance = (e2x * qx + e2y * qy + e2z * qz) * over
            if b2 >= 0 and b1 + b2 <= 1 and rays.start < distance < far:
                far, hit = distance, t
                found[0], found[1], found[2] = distance, b1, b2
        node += 1
    return hit
