"""Horizons and shadows at any points over a height field, in any azimuth: rays through a pyramid of maxima.

Blocks of 2, 4, 8 ... cells a side know their highest sample. A ray passes over a block that lies below what it has
seen so far, and looks into all others, down to the edges of triangles: what is found is exact.

Cost:     some 0.3 microseconds a horizon on one core, depending on how rough the field is; 1.4 bytes a sample.
Poor at:  all samples of a field, which `glpath.terrain.sweep` does several times as fast.
Source:   Tevs, Ihrke & Seidel 2008, Maximum mipmaps for fast, accurate, and scalable dynamic height field
          rendering.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glpath.system.kernels import inner_kernel, kernel

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]

#: Of a cell: how far beyond a border the next block begins, and the nearest that counts as an occluder.
_BEYOND = 1e-9
_NEAREST = 1e-6


def pyramid_of(heights: Float32) -> tuple[Float32, Int64]:
    """Maxima of the blocks of all levels, one after the other, and (L, 3) where each begins, its rows and columns.

    heights : (R, C), NaN where there is none

    Level 0 has blocks of 2 x 2 cells, so of 3 x 3 samples; each following one has 2 x 2 of these. The last is one.
    """
    rows, columns = (max(1, -(-(n - 1) // 2)) for n in heights.shape)
    shapes = [(rows, columns)]
    while shapes[-1] != (1, 1):
        shapes.append(((shapes[-1][0] + 1) // 2, (shapes[-1][1] + 1) // 2))
    starts = np.cumsum([0, *(a * b for a, b in shapes)])
    maxima = np.empty(starts[-1], np.float32)
    levels = np.array([(start, *shape) for start, shape in zip(starts[:-1], shapes, strict=True)], np.int64)
    _fill(heights, levels, maxima)
    return maxima, levels


@kernel
def _fill(heights, levels, maxima):  # type: ignore[no-untyped-def]
    rows, columns = heights.shape
    for level in range(len(levels)):
        start, high, wide = levels[level]
        for r in range(high):
            for c in range(wide):
                best = -np.inf
                if level == 0:
                    for y in range(2 * r, min(2 * r + 3, rows)):
                        for x in range(2 * c, min(2 * c + 3, columns)):
                            if heights[y, x] > best:
                                best = heights[y, x]
                else:
                    before, high_before, wide_before = levels[level - 1]
                    for y in range(2 * r, min(2 * r + 2, high_before)):
                        for x in range(2 * c, min(2 * c + 2, wide_before)):
                            best = max(best, maxima[before + y * wide_before + x])
                maxima[start + r * wide + c] = best


@inner_kernel
def steepest(field, x, y, z, gx, gy, best, enough):  # type: ignore[no-untyped-def]
    """The tangent of the highest terrain seen from a point in a direction, or `best` where all is lower.

    field   : heights, maxima and levels
    x, y, z : the point: column, row and height
    gx, gy  : columns and rows for a unit of distance
    best    : 0 or more: terrain below it does not count
    enough  : the search ends at the first tangent above it
    """
    heights, maxima, levels = field
    rows, columns = heights.shape
    top = len(levels) - 1
    # Where the ray enters the field and leaves it.
    distance, leave = 0.0, np.inf
    for axis in range(2):
        p, g, size = (x, gx, columns - 1.0) if axis == 0 else (y, gy, rows - 1.0)
        if g != 0.0:
            a, b = -p / g, (size - p) / g
            distance, leave = max(distance, min(a, b)), min(leave, max(a, b))
        elif p < 0.0 or p > size:
            return best
    beyond_x = x + (_BEYOND if gx > 0.0 else -_BEYOND)
    beyond_y = y + (_BEYOND if gy > 0.0 else -_BEYOND)
    per_column = 1.0 / gx if gx != 0.0 else 0.0
    per_row = 1.0 / gy if gy != 0.0 else 0.0
    ahead_x, ahead_y = 1 if gx >= 0.0 else 0, 1 if gy >= 0.0 else 0
    nearest = _NEAREST / max(abs(gx), abs(gy))
    level = 0
    while distance < leave - nearest:
        column = min(max(int(np.floor(beyond_x + gx * distance)), 0), columns - 2)
        row = min(max(int(np.floor(beyond_y + gy * distance)), 0), rows - 2)
        shift = level + 1
        c, r = column >> shift, row >> shift
        exit_x = ((c + ahead_x << shift) - x) * per_column if gx != 0.0 else np.inf
        exit_y = ((r + ahead_y << shift) - y) * per_row if gy != 0.0 else np.inf
        after = min(exit_x, exit_y)
        if level >= 0:
            # No terrain of the block is steeper than its highest sample at its near side.
            if maxima[levels[level, 0] + r * levels[level, 2] + c] - z > best * distance:
                level -= 1
                continue
        else:
            # Edges of the cell's triangles: the diagonal, and the one through which the ray leaves.
            found = best
            if gx != gy:
                at = ((x - column) - (y - row)) / (gy - gx)
                if at > distance and at > nearest and at < after:
                    part = x + gx * at - column
                    a, b = np.float64(heights[row, column]), np.float64(heights[row + 1, column + 1])
                    tangent = (a + part * (b - a) - z) / at
                    if tangent > found:
                        found = tangent
            if after > nearest:
                if exit_x <= exit_y:
                    part = y + gy * after - row
                    a = np.float64(heights[row, column + ahead_x])
                    b = np.float64(heights[row + 1, column + ahead_x])
                else:
                    part = x + gx * after - column
                    a = np.float64(heights[row + ahead_y, column])
                    b = np.float64(heights[row + ahead_y, column + 1])
                tangent = (a + part * (b - a) - z) / after
                if tangent > found:
                    found = tangent
            if found > best:
                best = found
                if best > enough:
                    return best
        # Rounding must not keep it on a border.
        distance = after if after > distance else distance + nearest
        level = min(level + 1, top)
    return best


@kernel
def tangents_at(heights, maxima, levels, points, gradient, tangents):  # type: ignore[no-untyped-def]
    """Fill tangents (N,) of the horizon's angle at points (N, 3): column, row, height; 0 where no terrain is above.

    gradient : columns and rows for a unit of distance
    """
    field = (heights, maxima, levels)
    gx, gy = gradient
    for i in range(len(points)):
        tangents[i] = steepest(field, points[i, 0], points[i, 1], points[i, 2], gx, gy, 0.0, np.inf)


@kernel
def add_suns(heights, maxima, levels, points, suns, sums):  # type: ignore[no-untyped-def]
    """Add up weights of the suns that points see.

    points : (N, 6): column, row, height, and the normal, x east, y south, z up
    suns   : (S, 7): columns and rows for a unit of distance, the tangent of the altitude, where to the sun is, x
             east, y south, z up, and the weight. By azimuth, each azimuth's by falling altitude
    sums   : (N, 2): of weights, and of weights times cosines to the normal
    """
    field = (heights, maxima, levels)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        begin = 0
        while begin < len(suns):
            gx, gy = suns[begin, 0], suns[begin, 1]
            end = begin + 1
            while end < len(suns) and suns[end, 0] == gx and suns[end, 1] == gy:
                end += 1
            # One horizon for all suns of an azimuth; beyond the highest it is of no interest.
            tangent = steepest(field, x, y, z, gx, gy, suns[end - 1, 2], suns[begin, 2])
            lowest = suns[end - 1, 2]
            for k in range(begin, end):
                # The lowest one is seen where nothing was steeper than it.
                if suns[k, 2] > tangent or (suns[k, 2] == lowest and tangent == lowest):
                    cosine = points[i, 3] * suns[k, 3] + points[i, 4] * suns[k, 4] + points[i, 5] * suns[k, 5]
                    if cosine > 0.0:
                        sums[i, 0] += suns[k, 6]
                        sums[i, 1] += suns[k, 6] * cosine
            begin = end
