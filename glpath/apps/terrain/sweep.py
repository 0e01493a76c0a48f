"""Horizons at all samples of a height field in one azimuth, by sweeps along lines with a convex hull.

An azimuth is a lattice direction: the step from a sample to the next sample of its line, in `columns` and `rows`,
which are coprime. Each sample then lies on exactly one line. The line's height profile is exact, because its
vertices are the crossings with edges of triangles. The sweep starts at the far end. A stack holds the upper convex
hull of the profile passed so far, and the tangent from a sample to that hull is the horizon.

Cost:     2 max(columns, rows) profile points per sample, each pushed and popped once, for a field of any size.
          About 10 ns per point on one core.
Poor at:  azimuths that need long steps; points between samples (`glpath.apps.terrain.pyramid`).
Source:   Dozier & Frew 1990, Rapid calculation of terrain parameters for radiation modeling; Timonen & Westerholm
          2010, Scalable height field self-shadowing, whose lines pass beside the samples.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glpath.system.kernels import kernel
from glpath.system.machine import core_count

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

#: Maximum step of lattice directions, in samples.
MAX_STEP = 40


@dataclass(frozen=True)
class LatticeDirection:
    """Direction from sample to sample.

    columns, rows : coprime counts of columns and rows in a step; rows count southwards
    azimuth       : radians, clockwise from north
    """

    columns: int
    rows: int
    azimuth: float


def lattice_directions(count: int, spacing: tuple[float, float]) -> list[LatticeDirection]:
    """Return `count` directions around the horizon, in order of azimuth.

    spacing : distances between columns and between rows

    They approximate `count` equally spaced azimuths. Each is the shortest step that deviates from its azimuth by at
    most a quarter of the distance between azimuths. If no step up to `MAX_STEP` is that close, it is the closest.
    """
    candidates = [
        (max(abs(c), abs(r)), math.atan2(c * spacing[0], -r * spacing[1]) % (2 * math.pi), c, r)
        for c in range(-MAX_STEP, MAX_STEP + 1)
        for r in range(-MAX_STEP, MAX_STEP + 1)
        if math.gcd(c, r) == 1
    ]
    steps, azimuths = np.array([each[0] for each in candidates]), np.array([each[1] for each in candidates])
    sector = 2 * math.pi / count
    found = []
    for k in range(count):
        off = np.abs((azimuths - k * sector + math.pi) % (2 * math.pi) - math.pi)
        near = np.flatnonzero(off <= 0.25 * sector)
        best = min(near, key=lambda i: (steps[i], off[i])) if len(near) else int(off.argmin())
        _, azimuth, columns, rows = candidates[best]
        found.append(LatticeDirection(columns, rows, azimuth))
    return found


def _crossings(columns: int, rows: int) -> tuple[Float64, NDArray[np.int64]]:
    """Return the crossings of a step with edges of triangles, in order.

    The first array (P, 2) has the fraction of the step and the weight of the edge's second end. The second array
    (P, 4) has column and row of both ends, relative to the start of the step.
    """
    found = []
    for i in range(1, abs(columns)):
        t = i / abs(columns)
        below = math.floor(rows * t)
        x = int(math.copysign(i, columns))
        found.append((t, rows * t - below, x, below, x, below + 1))
    for i in range(1, abs(rows)):
        t = i / abs(rows)
        left = math.floor(columns * t)
        y = int(math.copysign(i, rows))
        found.append((t, columns * t - left, left, y, left + 1, y))
    across = columns - rows
    for i in range(1, abs(across)):
        t = i / abs(across)
        left, above = math.floor(columns * t), math.floor(rows * t)
        found.append((t, columns * t - left, left, above, left + 1, above + 1))
    found.sort()
    table = np.array(found).reshape(-1, 6)
    return np.ascontiguousarray(table[:, :2]), np.ascontiguousarray(table[:, 2:].astype(np.int64))


def horizon_tangents(
    heights: Float32, spacing: tuple[float, float], direction: LatticeDirection, tangents: Float32
) -> None:
    """Fill tangents (R, C) of the horizon's elevation at each sample; 0 if no terrain is higher.

    heights : (R, C), NaN in holes, whose tangents are 0

    Uses one thread per core.
    """
    rows, columns = heights.shape
    length = math.hypot(direction.columns * spacing[0], direction.rows * spacing[1])
    at, ends = _crossings(direction.columns, direction.rows)
    step = max(abs(direction.columns), abs(direction.rows))
    room = (len(at) + 1) * (max(rows, columns) // step + 2)
    # A line starts at a sample from which a step backwards leaves the field. Rows that are all starts come first.
    first_rows = min(abs(direction.rows), rows)
    count = rows * columns - (rows - first_rows) * max(columns - abs(direction.columns), 0)
    threads = core_count()
    edges = np.linspace(0, count, 8 * threads + 1).astype(int)

    def sweep(i: int) -> None:
        stack = np.empty((room, 2))
        _sweep(
            heights, at, ends, (direction.columns, direction.rows, length), edges[i], edges[i + 1], stack, tangents
        )

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(sweep, range(len(edges) - 1)))


@kernel
def _sweep(heights, at, ends, step, begin, end, stack, tangents):  # type: ignore[no-untyped-def]
    """Sweep lines `begin` to `end`; `stack` is scratch memory for distances and heights of a hull."""
    rows, columns = heights.shape
    dc, dr, length = step
    first_rows, first_columns = min(abs(dr), rows), min(abs(dc), columns)
    of_rows = first_rows * columns
    crossings = len(at)
    for line in range(begin, end):
        # Neighbouring lines follow each other, because they read the same memory.
        if line < of_rows:
            c, r = line // first_rows, line % first_rows
        else:
            c, r = (line - of_rows) % first_columns, first_rows + (line - of_rows) // first_columns
        if dc < 0:
            c = columns - 1 - c
        if dr < 0:
            r = rows - 1 - r
        # Number of samples on the line.
        count = max(rows, columns)
        if dc > 0:
            count = min(count, (columns - 1 - c) // dc + 1)
        elif dc < 0:
            count = min(count, c // -dc + 1)
        if dr > 0:
            count = min(count, (rows - 1 - r) // dr + 1)
        elif dr < 0:
            count = min(count, r // -dr + 1)
        top = 0
        for k in range(count - 1, -1, -1):
            x, y = c + k * dc, r + k * dr
            for i in range(crossings - 1, -1, -1):
                xa, ya, xb, yb = x + ends[i, 0], y + ends[i, 1], x + ends[i, 2], y + ends[i, 3]
                # The line continues beyond its last sample, where crossings may lie outside the field.
                if k == count - 1 and (
                    min(xa, xb) < 0 or min(ya, yb) < 0 or max(xa, xb) >= columns or max(ya, yb) >= rows
                ):
                    continue
                a, b = np.float64(heights[ya, xa]), np.float64(heights[yb, xb])
                height = a + at[i, 1] * (b - a)
                if height != height:
                    continue
                distance = (k + at[i, 0]) * length
                # Pop the last hull point while it lies below the line from this point to the hull point before it.
                while top > 1 and (stack[top - 1, 1] - height) * (stack[top - 2, 0] - distance) <= (
                    stack[top - 2, 1] - height
                ) * (stack[top - 1, 0] - distance):
                    top -= 1
                stack[top, 0], stack[top, 1] = distance, height
                top += 1
            height = np.float64(heights[y, x])
            if height != height:
                tangents[y, x] = 0.0
                continue
            distance = k * length
            while top > 1 and (stack[top - 1, 1] - height) * (stack[top - 2, 0] - distance) <= (
                stack[top - 2, 1] - height
            ) * (stack[top - 1, 0] - distance):
                top -= 1
            tangent = 0.0
            if top > 0:
                tangent = max(0.0, (stack[top - 1, 1] - height) / (stack[top - 1, 0] - distance))
            tangents[y, x] = tangent
            stack[top, 0], stack[top, 1] = distance, height
            top += 1
