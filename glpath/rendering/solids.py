"""Find triangle sides that are inside a closed, opaque solid without a light in it, because these are never seen.

In a closed surface, two triangles share each edge in opposite order, and the surface does not cross itself. One of
its sides is then the inside everywhere, whatever its winding. The sign of its volume decides which side (Jordan and
Brouwer). This is a proof, not sampling, and a side without proof counts as seen.

Cost:     a segment through a BVH for each edge of closed surfaces.
Poor at:  solids that are open where they stand on the floor, or whose edges are not bit-identical. They are not
          closed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.radiosity.shafts.rays import Rays
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.scene.sight import winding_number
from glpath.system.kernels import kernel
from glpath.system.threads import worker_threads
from glpath.system.time_limit import check_time

Int64 = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Minimum volume of a solid, relative to its area to the power of 1.5. A doubled sheet has no volume.
_THIN = 1e-7
#: Fraction of an edge left out at both ends of its segment, where other triangles touch it.
_ENDS = 1e-5


@dataclass(frozen=True, eq=False)
class Closed:
    """Surfaces of a scene, each a set of triangles connected by edges that two of them share.

    vertex  : (T, 3) indices of corners, equal for equal positions
    surface : (T,) index of each triangle's surface
    closed  : (surfaces,) bool, True if two triangles share every edge
    inner   : (surfaces,) side that is inside, 0 for the front, 1 for the back; -1 if the volume is nearly zero
    """

    vertex: Int64
    surface: Int64
    closed: Bools
    inner: Int64

    @classmethod
    def of(cls, scene: Scene) -> Closed:
        """Return the surfaces of a triangulated scene, without a test if they cross themselves."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        check_time()
        vertex = welded(scene)
        check_time()
        count = len(vertex)
        start, end = vertex.ravel(), vertex[:, [1, 2, 0]].ravel()
        face = np.repeat(np.arange(count), 3)
        low, high = np.minimum(start, end), np.maximum(start, end)
        edge = low * (int(vertex.max()) + 1) + high
        order = np.argsort(edge, kind="stable")
        first = np.flatnonzero(np.diff(edge[order], prepend=-1))
        uses = np.diff(np.append(first, len(order)))
        pairs = first[uses == 2]
        a, b = order[pairs], order[pairs + 1]
        opposite = start[a] == end[b]
        a, b = a[opposite], b[opposite]
        shared = np.zeros(3 * count, np.bool_)
        shared[a] = shared[b] = True
        check_time()
        joined = coo_array((np.ones(len(a), np.int8), (face[a], face[b])), shape=(count, count))
        number, surface = connected_components(joined, directed=False)
        closed = np.bincount(surface, ~shared.reshape(-1, 3).all(axis=1), number) == 0
        # Coordinates are relative to a corner of the surface, so that surfaces far from the origin keep their
        # precision.
        anchor = np.zeros((number, 3))
        anchor[surface] = scene.triangles[:, 0]
        p, q, r = np.moveaxis(scene.triangles - anchor[surface][:, None], 1, 0)
        volume = np.bincount(surface, np.einsum("ij,ij->i", p, np.cross(q, r)), number) / 6
        area = np.bincount(surface, scene.areas, number)
        inner = np.where(np.abs(volume) > _THIN * area**1.5, np.where(volume > 0, 1, 0), -1)
        return cls(vertex, np.asarray(surface, np.int64), closed, inner)


def welded(scene: Scene) -> Int64:
    """Return (T, 3) indices of corners, equal for bit-identical positions."""
    points = np.ascontiguousarray(scene.shapes.vertices + 0.0)  # turns -0.0 into 0.0
    rows = points.view(np.dtype((np.void, points.strides[0]))).ravel() if len(points) else points[:, 0]
    _, which = np.unique(rows, return_inverse=True)
    return np.asarray(which.astype(np.int64)[scene.shapes.faces])


def inside_solids(scene: Scene, rays: Rays, opaque: Bools, shines: Bools) -> Bools:
    """Return (T, 2) bool: True for fronts (0) and backs (1) that are the inside of a solid.

    A closed surface is a room, not a solid, if its inside emits, or if the camera or a part of a lamp is inside.

    opaque : (T,) bool, True for triangles that block all light
    shines : (T, 2) bool, True for sides that emit light
    """
    none = np.zeros((len(opaque), 2), np.bool_)
    found = Closed.of(scene)
    count = len(found.closed)
    solid = found.closed & (found.inner >= 0)
    solid &= np.bincount(found.surface, ~opaque, count) == 0
    lamps: Bools = np.asarray(shines.any(axis=1))
    inner = found.inner[found.surface]
    own = shines[np.arange(len(inner)), np.maximum(inner, 0)]
    solid &= np.bincount(found.surface, own, count) == 0
    if not solid.any():
        return none
    crossed = np.zeros(count, np.bool_)
    edges = np.stack([found.vertex, found.vertex[:, [1, 2, 0]]], axis=2)
    once = edges[..., 0] < edges[..., 1]
    wanted = np.asarray((solid[found.surface][:, None] & once) | np.asarray(lamps)[:, None])
    which, corner = np.nonzero(wanted)
    ends = np.stack([scene.triangles[which, corner], scene.triangles[which, (corner + 1) % 3]], axis=1)
    with worker_threads(rays.stop) as pool:
        pool.submit(
            _cross, rays, found.vertex, found.surface, lamps, which, edges[which, corner], ends, crossed
        ).result()
    solid &= ~crossed
    # A lamp that does not cross a solid is wholly inside or wholly outside, so one point of the lamp decides.
    _, firsts = np.unique(found.surface[lamps], return_index=True)
    some = np.flatnonzero(lamps)[firsts] if lamps.any() else np.zeros(0, np.int64)
    seen_from = [
        (scene.triangles[some].mean(axis=1), found.surface[some]),
        *((light.position[None], np.array([-1])) for light in scene.lights if light.kind != "directional"),
        (scene.camera.at().position[None], np.array([-1])),
    ]
    points, own_surface = (np.concatenate(part) for part in zip(*seen_from, strict=True))
    solid &= ~_inhabited(scene, found, solid, points, own_surface)
    row = np.flatnonzero(solid[found.surface])
    none[row, inner[row]] = True
    return none


def _inhabited(scene: Scene, found: Closed, solid: Bools, points: Float64, own: Int64) -> Bools:
    """Return (surfaces,) bool: True for solids that contain one of the points (N, 3).

    own : (N,) surface that a point is on, which is not tested for this point; -1 for none
    """
    inhabited = np.zeros(len(solid), np.bool_)
    order = np.argsort(found.surface, kind="stable")
    first = np.searchsorted(found.surface[order], np.arange(len(solid) + 1))
    low = np.minimum.reduceat(scene.triangles.min(axis=1)[order], first[:-1])
    high = np.maximum.reduceat(scene.triangles.max(axis=1)[order], first[:-1])
    candidates = np.flatnonzero(solid)
    for point, surface in zip(points, own, strict=True):
        around = (low[candidates] < point).all(axis=1) & (high[candidates] > point).all(axis=1)
        for number in candidates[around & (candidates != surface)]:
            if not inhabited[number]:
                corners = scene.triangles[order[first[number] : first[number + 1]]]
                # The winding number is 0 outside, 1 or -1 inside, and between these values on the surface.
                inhabited[number] = abs(winding_number(corners, point)) > 0.25
    return inhabited


@kernel
def _cross(rays, vertex, surface, lamps, triangle, edge, ends, crossed):  # type: ignore[no-untyped-def]
    """Mark surfaces that cross themselves or a lamp.

    An edge is tested against triangles of its own surface and of lamps. An edge of a lamp is tested against all.

    triangle : (E,) triangles of the edges
    edge     : (E, 2) corner indices of the edges
    ends     : (E, 2, 3) positions of the edges' ends
    crossed  : (surfaces,) bool, True for marked surfaces
    """
    boxes, corners = rays.boxes, rays.corners
    for i in range(len(triangle)):
        if rays.stop[0]:
            return
        own = surface[triangle[i]]
        shines = lamps[triangle[i]]
        if crossed[own] and not shines:
            continue
        dx, dy, dz = ends[i, 1, 0] - ends[i, 0, 0], ends[i, 1, 1] - ends[i, 0, 1], ends[i, 1, 2] - ends[i, 0, 2]
        ox, oy, oz = ends[i, 0, 0], ends[i, 0, 1], ends[i, 0, 2]
        ix, iy, iz = 1 / dx, 1 / dy, 1 / dz
        length2 = dx * dx + dy * dy + dz * dz
        node = 0
        while node < len(rays.skip):
            ax, bx = (boxes[node, 0] - ox) * ix, (boxes[node, 3] - ox) * ix
            ay, by = (boxes[node, 1] - oy) * iy, (boxes[node, 4] - oy) * iy
            az, bz = (boxes[node, 2] - oz) * iz, (boxes[node, 5] - oz) * iz
            near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), 0.0))
            end = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), 1.0))
            if near > end:
                node = rays.skip[node]
                continue
            for item in range(rays.first[node], rays.first[node] + rays.items[node]):
                t = rays.order[item]
                if surface[t] != own and not lamps[t] and not shines:
                    continue
                touches = False
                for k in range(3):
                    touches = touches or vertex[t, k] == edge[i, 0] or vertex[t, k] == edge[i, 1]
                if touches:
                    continue
                # Intersection by Moeller & Trumbore 1997.
                e1x, e1y, e1z = corners[t, 3], corners[t, 4], corners[t, 5]
                e2x, e2y, e2z = corners[t, 6], corners[t, 7], corners[t, 8]
                px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
                determinant = e1x * px + e1y * py + e1z * pz
                e1, e2 = e1x * e1x + e1y * e1y + e1z * e1z, e2x * e2x + e2y * e2y + e2z * e2z
                if determinant * determinant <= 1e-18 * length2 * e1 * e2:
                    continue  # the edge is parallel to the triangle
                over = 1 / determinant
                sx, sy, sz = ox - corners[t, 0], oy - corners[t, 1], oz - corners[t, 2]
                b1 = (sx * px + sy * py + sz * pz) * over
                qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
                b2 = (dx * qx + dy * qy + dz * qz) * over
                at = (e2x * qx + e2y * qy + e2z * qz) * over
                if b1 >= 0 and b2 >= 0 and b1 + b2 <= 1 and at > _ENDS and at < 1 - _ENDS:
                    if surface[t] == own:
                        crossed[own] = True
                    else:
                        crossed[surface[t]] = crossed[own] = True
            node += 1
