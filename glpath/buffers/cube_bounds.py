"""Bounds of objects on the six faces of a cube-buffer, as rectangles of cells; see `light_bounds`."""

from __future__ import annotations

import numpy as np

from glpath.buffers.light_bounds import (
    MARGIN,
    NOTHING,
    TINY,
    Caps,
    CellRectangles,
    Int64,
    cells_between,
    edge_planes,
    in_bands,
    join,
    rectangles_of_rows,
    towards,
    without_empty,
)
from glpath.scene.model import Float64

FACES = 6


def cube_rectangles_of_planes(world_from_plane: Float64, light: Float64, side: int) -> CellRectangles:
    """Return, for each infinite plane of (P, 3, 4), the cells of a cube-buffer whose rays hit it."""
    parts = [NOTHING]
    y = np.tan(((np.arange(side) + 0.5) / side - 0.5) * np.pi / 2)
    for index, world in enumerate(towards(world_from_plane, light)):
        for face in range(FACES):
            n = to_face(face, world)
            # The ray (x, y, 1) of a face hits the plane if n.x x + n.y y + n.z > 0.
            rest = n[1] * y + n[2] + MARGIN
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = np.nan_to_num(-rest / n[0], nan=np.inf, posinf=np.inf, neginf=-np.inf)
            if n[0] == 0.0:
                low, high = np.where(rest > 0, -1.0, 2.0), np.full(side, 1.0)
            elif n[0] > 0:
                low, high = cut, np.full(side, 1.0)
            else:
                low, high = np.full(side, -1.0), cut
            first, last = cells_between(*((np.arctan(s) * 2 / np.pi + 0.5) * side for s in (low, high)))
            parts.append(rectangles_of_rows(face, index, np.maximum(first, 0), np.minimum(last, side - 1)))
    return join(parts)


def to_face(face: int, d: Float64) -> Float64:
    """Return vectors (..., 3) in the frame of a cube's face, as in point_shadow_map.glsl.

    The first two axes lie in the face, the third is the face's normal.
    """
    axis = face // 2
    f = np.roll(d, -1 - axis, axis=-1).copy()
    f[..., 2] *= -1.0 if face & 1 else 1.0
    return f


def _face_cells(low: Float64, high: Float64, side: int) -> tuple[Int64, Int64]:
    """Convert ranges of angles (N, 2) across a face, enlarged by a margin, to ranges of the face's cells."""
    first, last = cells_between(
        ((low - MARGIN) * 2 / np.pi + 0.5) * side, ((high + MARGIN) * 2 / np.pi + 0.5) * side
    )
    return np.maximum(first, 0), np.minimum(last, side - 1)


def cube_rectangles_of_caps(caps: Caps, side: int) -> CellRectangles:
    """Return, for each cap, the cells of a cube-buffer whose rays lie in the cap.

    Along one axis of a face, a cap extends between two planes that touch the cap and contain the face's other axis
    (Mara & McGuire 2013).
    """
    parts = []
    index = np.arange(len(caps.angle))
    radius = np.where(caps.angle < np.pi / 2, np.sin(np.minimum(caps.angle, np.pi / 2)), 1.0)
    for face in range(FACES):
        f = to_face(face, caps.axis)
        along = f[:, 2:]
        middle = np.arctan2(f[:, :2], along)
        distance = np.hypot(f[:, :2], along)
        half = np.where(
            radius[:, None] < distance - 1e-12,
            np.arcsin(np.minimum(radius[:, None] / np.maximum(distance, TINY), 1.0)),
            2 * np.pi,  # the face's other axis lies in the cap
        )
        low, high = np.maximum(middle - half, -np.pi / 4), np.minimum(middle + half, np.pi / 4)
        missed = np.any(low > high + MARGIN, axis=1)
        first, last = _face_cells(low, high, side)
        last[missed] = -1
        parts.append(without_empty(index, np.full_like(index, face), first, last))
    rectangles = join(parts)
    axes_of_face = np.stack([to_face(face, caps.axis) for face in range(FACES)])
    cosine = np.cos(np.minimum(caps.angle + MARGIN, np.pi / 2))

    def span(which: Int64, face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Return the first and last column of a row whose rays lie in the cap.

        A ray (x, y, 1) lies in the cap if the angle between ray and axis is at most the cap's. With squared cosines
        and a given y, this is a quadratic equation in x.
        """
        i = rectangles.primitive[which]
        a, square = axes_of_face[face, i], cosine[i] ** 2
        y = np.tan(((row + 0.5) / side - 0.5) * np.pi / 2)
        along = a[:, 1] * y + a[:, 2]
        p, q, r = a[:, 0] ** 2 - square, a[:, 0] * along, along**2 - square * (1 + y * y)
        inside = q * q - p * r
        # Only ellipses narrow a row. Other conics are rare, and their rows stay whole. Rows that just touch are
        # kept.
        ellipse = (p < -1e-6) & (inside > -1e-9)
        root = np.sqrt(np.maximum(inside, 0.0)) + MARGIN
        with np.errstate(divide="ignore", invalid="ignore"):
            begin, end = (-q + root) / p, (-q - root) / p
        begin = np.where(ellipse, begin, np.where(p < -1e-6, np.inf, -np.inf))
        end = np.where(ellipse, end, np.where(p < -1e-6, -np.inf, np.inf))
        return (np.arctan(begin) * 2 / np.pi + 0.5) * side - 0.5, (np.arctan(end) * 2 / np.pi + 0.5) * side - 0.5

    return in_bands(rectangles, span)


def cube_rectangles_of_triangles(triangles: Float64, light: Float64, side: int) -> CellRectangles:
    """Return, for each triangle of (T, 3, 3), the cells of a cube-buffer whose rays can hit it.

    The rectangle on a face bounds each edge, clipped by the four planes through the light and the face's edges. It
    also bounds the corners of the face that the triangle covers.
    """
    parts = []
    index = np.arange(len(triangles))
    corners = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    planes = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]])
    world = triangles - light
    world = world / np.maximum(np.abs(world).max(axis=(1, 2), initial=0.0), TINY)[:, None, None]
    for face in range(FACES):
        d = to_face(face, world)
        heights = d @ planes.T  # (T, corner, plane): inside where >= 0
        # Most triangles lie outside one of the four planes, so they are not on this face.
        near = np.flatnonzero(~np.any(np.all(heights < -MARGIN, axis=1), axis=1))
        d, heights = d[near], heights[near]
        low, high = np.full((len(near), 2), np.inf), np.full((len(near), 2), -np.inf)
        for i in range(3):
            j = (i + 1) % 3
            a, b, at_a, at_b = d[:, i], d[:, j], heights[:, i], heights[:, j]
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = at_a / (at_a - at_b)
            start = np.where((at_a < 0) & (at_b >= 0), cut, 0.0).max(axis=1)
            end = np.where((at_a >= 0) & (at_b < 0), cut, 1.0).min(axis=1)
            gone = np.any((at_a < 0) & (at_b < 0), axis=1) | (start > end + 1e-9)
            for s in (start, end):
                p = a + s[:, None] * (b - a)
                z = p[:, 2:]
                with np.errstate(divide="ignore", invalid="ignore"):
                    q = np.where(z > 1e-12, p[:, :2] / z, np.nan)
                # For a point at the light itself, every direction is possible.
                q_low, q_high = np.where(np.isnan(q), -1.0, q), np.where(np.isnan(q), 1.0, q)
                low = np.where(gone[:, None], low, np.minimum(low, q_low))
                high = np.where(gone[:, None], high, np.maximum(high, q_high))
        normals = np.cross(d, np.roll(d, -1, axis=1))
        for corner in corners:
            side_of = normals @ corner
            tolerance = 1e-9
            covered = np.all(side_of >= -tolerance, axis=1) | np.all(side_of <= tolerance, axis=1)
            # A triangle that covers the direction opposite to the corner passes the test above, but is excluded
            # here.
            covered &= np.any(d @ corner > 0, axis=1)
            low = np.where(covered[:, None], np.minimum(low, corner[:2]), low)
            high = np.where(covered[:, None], np.maximum(high, corner[:2]), high)
        found = np.all(low <= high, axis=1)
        low, high = (np.arctan(np.where(found[:, None], s, 0.0)) for s in (low, high))
        first, last = _face_cells(low, high, side)
        last[~found] = -1
        parts.append(without_empty(index[near], np.full(len(near), face, dtype=np.int64), first, last))
    rectangles = join(parts)
    edges = edge_planes(triangles - light)
    edges_of_face = np.stack([to_face(face, edges) for face in range(FACES)])

    def span(which: Int64, face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Return the first and last column of a row in the triangle; each edge's plane intersects the row once."""
        y = np.tan(((row + 0.5) / side - 0.5) * np.pi / 2)
        begin, end = np.full(len(which), -1.0), np.full(len(which), 1.0)
        for edge in range(3):
            n = edges_of_face[face, rectangles.primitive[which], edge]
            rest = n[:, 1] * y + n[:, 2] + 2 * MARGIN
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = -rest / n[:, 0]
            begin = np.where(n[:, 0] > 0, np.maximum(begin, cut), begin)
            end = np.where(n[:, 0] < 0, np.minimum(end, cut), end)
            end = np.where((n[:, 0] == 0) & (rest < 0), -2.0, end)
        return (np.arctan(begin) * 2 / np.pi + 0.5) * side - 0.5, (np.arctan(end) * 2 / np.pi + 0.5) * side - 0.5

    return in_bands(rectangles, span)
