"""Bounds of objects in a sphere-buffer, as rectangles of cells in latitude and longitude; see `light_bounds`."""

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
)
from glpath.scene.model import Float64
from glpath.system.kernels import kernel


@kernel
def _ranges_to_cells(
    south: Float64,
    north: Float64,
    west: Float64,
    east: Float64,
    rows: int,
    columns: int,
    primitive: Int64,
    cells: Int64,
) -> int:
    """Compute the primitive and the cells of each range of angles that is not empty; return the number of ranges.

    A row of `cells` is the first column, first row, last column and last row. Longitudes may have any values and
    span up to 2 pi. A range across the seam is split in two; the second parts of all ranges come last. Arrays are
    primitive (2 N,) and cells (2 N, 4).
    """
    count = len(south)
    found = 0
    for part in range(2):
        for i in range(count):
            # The nearer a pole, the wider is a margin in longitude for the same angle between directions.
            nearest_pole = min(max(abs(south[i]), abs(north[i])), np.pi / 2)
            margin = MARGIN / max(np.cos(nearest_pole), MARGIN)
            row_first = max(int(np.ceil(((south[i] - MARGIN) / np.pi + 0.5) * rows - 0.5)), 0)
            row_last = min(int(np.floor(((north[i] + MARGIN) / np.pi + 0.5) * rows - 0.5)), rows - 1)
            if east[i] - west[i] + 2 * margin >= 2 * np.pi:
                first, last = 0, columns - 1
            else:
                first = int(np.ceil((west[i] - margin) / (2 * np.pi) * columns - 0.5))
                last = int(np.floor((east[i] + margin) / (2 * np.pi) * columns - 0.5))
                turn = first // columns * columns  # moves the first column into the first full circle
                first, last = first - turn, min(last - turn, first - turn + columns - 1)
            if part == 0:
                last = min(last, columns - 1)
            else:
                first, last = 0, last - columns
            if first <= last and row_first <= row_last:
                primitive[found] = i
                cells[found, 0], cells[found, 1] = first, row_first
                cells[found, 2], cells[found, 3] = last, row_last
                found += 1
    return found


def _latitude_longitude(
    latitude: tuple[Float64, Float64], longitude: tuple[Float64, Float64], rows: int, columns: int
) -> CellRectangles:
    max_count = 2 * len(latitude[0])
    primitive, cells = np.empty(max_count, np.int64), np.empty((max_count, 4), np.int64)
    found = _ranges_to_cells(*latitude, *longitude, rows, columns, primitive, cells)
    primitive, cells = primitive[:found], cells[:found]
    return CellRectangles(primitive, np.zeros_like(primitive), cells[:, :2], cells[:, 2:])


@kernel
def _cap_ranges(axis: Float64, angle: Float64, latitude: Float64, middle: Float64, half: Float64) -> None:
    """Compute the latitude and longitude of each cap's axis, and half of the cap's range of longitudes."""
    for i in range(len(angle)):
        x, y, z = axis[i, 0], axis[i, 1], axis[i, 2]
        level = np.sqrt(x * x + y * y)
        latitude[i] = np.arctan2(z, level)
        middle[i] = np.arctan2(y, x)
        if abs(latitude[i]) + angle[i] >= np.pi / 2 - MARGIN:
            half[i] = np.pi
        else:
            half[i] = np.arcsin(min(np.sin(angle[i]) / max(np.cos(latitude[i]), TINY), 1.0))


def sphere_rectangles_of_caps(caps: Caps, rows: int, columns: int) -> CellRectangles:
    """Return, for each cap, the cells of a sphere-buffer whose rays lie in the cap."""
    axis, angle = caps
    latitude, middle, half = (np.empty(len(angle)) for _ in range(3))
    _cap_ranges(axis, angle, latitude, middle, half)
    south = np.maximum(latitude - angle, -np.pi / 2)
    north = np.minimum(latitude + angle, np.pi / 2)
    rectangles = _latitude_longitude((south, north), (middle - half, middle + half), rows, columns)

    def span(which: Int64, _face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Return the first and last column of a row whose rays lie in the cap.

        A column is inside if the cosine of the angle between its longitude and that of the cap's axis is large
        enough.
        """
        i = rectangles.primitive[which]
        theta = ((row + 0.5) / rows - 0.5) * np.pi
        # The cap's angle grows by MARGIN, so its cosine falls by MARGIN times the sine; MARGIN² covers small sines.
        min_cosine = np.cos(angle[i]) - MARGIN * np.sin(angle[i]) - MARGIN**2 - np.sin(theta) * np.sin(latitude[i])
        width = np.arccos(np.clip(min_cosine / np.maximum(np.cos(theta) * np.cos(latitude[i]), TINY), -1.0, 1.0))
        width = np.where(angle[i] < np.pi / 2, width + MARGIN, np.inf)
        range_middle = (rectangles.first[which, 0] + rectangles.last[which, 0] + 1) * np.pi / columns
        at = middle[i] + 2 * np.pi * np.round((range_middle - middle[i]) / (2 * np.pi))
        # If the cap's arc of columns overlaps the rectangle's range at both ends, the whole range is kept.
        extent = (rectangles.last[which, 0] - rectangles.first[which, 0] + 1) * np.pi / columns
        width = np.where(np.abs(at - range_middle) + width + extent < 2 * np.pi, width, np.inf)
        return (at - width) / (2 * np.pi) * columns - 0.5, (at + width) / (2 * np.pi) * columns - 0.5

    return in_bands(rectangles, span)


def sphere_rectangles_of_triangles(triangles: Float64, light: Float64, rows: int, columns: int) -> CellRectangles:
    """Return, for each triangle of (T, 3, 3), the cells of a sphere-buffer whose rays can hit it."""
    if not len(triangles):
        return NOTHING
    d = triangles - light
    length = np.linalg.norm(d, axis=2)
    scale = np.maximum(length.max(axis=1, initial=0.0), TINY)
    d = d / np.maximum(length, TINY)[:, :, None]
    latitude = np.arctan2(d[:, :, 2], np.hypot(d[:, :, 0], d[:, :, 1]))
    south, north = latitude.min(axis=1), latitude.max(axis=1)
    following = np.roll(d, -1, axis=1)
    # The arc between two corners bulges to the latitude of its great circle's highest point, if that lies on the
    # arc.
    normal = np.cross(d, following)
    size = np.linalg.norm(normal, axis=2)
    unit = normal / np.maximum(size, TINY)[:, :, None]
    highest = -unit[:, :, 2:] * unit
    highest[:, :, 2] += 1.0
    slack = -1e-9
    from_here = np.einsum("ijk,ijk->ij", np.cross(normal, d), highest)
    from_next = np.einsum("ijk,ijk->ij", np.cross(following, normal), highest)
    top = np.arccos(np.clip(np.abs(unit[:, :, 2]), 0.0, 1.0))
    north = np.maximum(north, np.where((from_here > slack) & (from_next > slack), top, -np.pi / 2).max(axis=1))
    south = np.minimum(south, np.where((from_here < -slack) & (from_next < -slack), -top, np.pi / 2).min(axis=1))

    # Longitudes change monotonically along an edge's arc, by less than half a circle. The changes along the three
    # arcs add up to 0, unless a pole is inside the triangle.
    phi = np.arctan2(d[:, :, 1], d[:, :, 0])
    step = np.roll(phi, -1, axis=1) - phi
    step -= 2 * np.pi * np.round(step / (2 * np.pi))
    around = np.abs(step.sum(axis=1)) > 1.0
    walk = np.stack([np.zeros(len(phi)), step[:, 0], step[:, 0] + step[:, 1]], axis=1)
    west, east = phi[:, 0] + walk.min(axis=1), phi[:, 0] + walk.max(axis=1)
    # Close to a pole, or if the light is close to the triangle's plane, the direction of an arc is uncertain.
    unsure = np.any(np.abs(step) > np.pi - 1e-4, axis=1) | np.any(length < 1e-9 * scale[:, None], axis=1)
    unsure |= np.any(np.hypot(d[:, :, 0], d[:, :, 1]) < MARGIN, axis=1)
    volume = np.einsum("ij,ij->i", normal[:, 0], d[:, 2])
    unsure |= around & (np.abs(volume) < 1e-12)
    whole = around | unsure
    # A pole in the triangle is on the inner side of all three arcs; `up` is True for the north pole.
    up = normal[:, :, 2].sum(axis=1) * volume > 0
    north = np.where((around & up) | unsure, np.pi / 2, north)
    south = np.where((around & ~up) | unsure, -np.pi / 2, south)
    west, east = np.where(whole, 0.0, west), np.where(whole, 2 * np.pi, east)
    rectangles = _latitude_longitude((south, north), (west, east), rows, columns)
    planes = edge_planes(triangles - light)

    def span(which: Int64, _face: Int64, row: Int64) -> tuple[Float64, Float64]:
        """Return the first and last column of a row whose rays lie in the triangle.

        The inner side of each edge's plane is an arc of columns. An arc that overlaps the range at both ends is
        ignored.
        """
        low = (rectangles.first[which, 0] + 0.5) / columns * 2 * np.pi
        high = (rectangles.last[which, 0] + 0.5) / columns * 2 * np.pi
        begin, end = np.full(len(which), -np.inf), np.full(len(which), np.inf)
        theta = ((row + 0.5) / rows - 0.5) * np.pi
        cosine, sine = np.cos(theta), np.sin(theta)
        for edge in range(3):
            n = planes[rectangles.primitive[which], edge]
            across = np.maximum(cosine * np.hypot(n[:, 0], n[:, 1]), TINY)
            half = np.arccos(np.clip(-(sine * n[:, 2] + MARGIN) / across, -1.0, 1.0))
            middle = np.arctan2(n[:, 1], n[:, 0])
            middle += 2 * np.pi * np.round((0.5 * (low + high) - middle) / (2 * np.pi))
            one = (middle + half - 2 * np.pi < low) & (middle - half + 2 * np.pi > high)
            begin = np.where(one, np.maximum(begin, middle - half), begin)
            end = np.where(one, np.minimum(end, middle + half), end)
        return begin / (2 * np.pi) * columns - 0.5, end / (2 * np.pi) * columns - 0.5

    return in_bands(rectangles, span)


def sphere_rectangles_of_planes(
    world_from_plane: Float64, light: Float64, rows: int, columns: int
) -> CellRectangles:
    """Return, for each infinite plane of (P, 3, 4), the cells of a sphere-buffer whose rays hit it."""
    parts = [NOTHING]
    theta = ((np.arange(rows) + 0.5) / rows - 0.5) * np.pi
    for index, n in enumerate(towards(world_from_plane, light)):
        # A ray hits the plane if cos(theta) |n.xy| cos(phi - middle) + sin(theta) n.z > 0.
        across = np.maximum(np.cos(theta) * np.hypot(n[0], n[1]), TINY)
        half = np.arccos(np.clip(-(np.sin(theta) * n[2] + MARGIN) / across, -1.0, 1.0))
        middle = np.arctan2(n[1], n[0])
        low, high = (middle - half) / (2 * np.pi) * columns, (middle + half) / (2 * np.pi) * columns
        first, last = cells_between(low, high)
        turn = np.floor_divide(first, columns) * columns
        first, last = first - turn, last - turn
        whole = last - first >= columns - 1
        first, last = np.where(whole, 0, first), np.where(whole, columns - 1, last)
        parts.append(rectangles_of_rows(0, index, first, np.minimum(last, columns - 1)))
        parts.append(rectangles_of_rows(0, index, np.zeros_like(first), last - columns))
    return join(parts)
