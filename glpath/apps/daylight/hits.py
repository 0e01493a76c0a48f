"""Rays from points to a scene's elements: first hits, and weights that give irradiance from the hits' radiosity.

Rays of a plane receiver have a cosine density. Rays of a cylinder or sphere are uniform over all directions. Rays
are stratified in batches. Glass reflects or transmits rays at random, and partly opaque surfaces transmit them at
random, as in the radiosity solver.

Cost:     about a microsecond of a core for each ray.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight.receivers import RECEIVERS, Receiver
from glpath.radiosity.mesh.glass import at_glass
from glpath.radiosity.shafts.rays import nearest
from glpath.radiosity.solvers.particles import ParticleSurfaces, next_random
from glpath.system.kernels import inner_kernel, kernel
from glpath.system.machine import core_count
from glpath.system.threads import worker_threads

Float64 = NDArray[np.float64]

#: Number of batches of a point's rays; the spread between batches gives the error estimate.
BATCHES = 8
# Number of azimuth strata in a batch of rays.
_TURNS = 16
# Maximum number of glass surfaces that a ray passes in a row.
_MAX_THROUGH = 64
# Maximum number of rays in a block of points; the hits take 16 MiB, and their weight matrix takes more.
_BLOCK = 1 << 21


class Hits(NamedTuple):
    """Sides that the rays of n points hit, and the weights of the rays.

    first  : index of the first point
    side   : (n, R) int32, twice the number of the element, plus 1 for its back; -1 if the ray leaves the scene
    weight : (n, R) float32; a point's irradiance is the mean of weight times radiosity of the side
    """

    first: int
    side: NDArray[np.int32]
    weight: NDArray[np.float32]


def ray_count(rays: int) -> int:
    """Return `rays` rounded up to a whole number of strata."""
    step = BATCHES * _TURNS
    return step * max(1, -(-rays // step))


def cast_hits(
    surfaces: ParticleSurfaces,
    points: Float64,
    axes: Float64,
    receiver: Receiver,
    rays: int,
    seed: int,
    numbers: NDArray[np.int64] | int = 0,
) -> Iterator[Hits]:
    """Yield the hits of the points' rays, block by block; the result does not depend on the number of threads.

    points  : (N, 3), lifted off their surfaces; axes (N, 3) unit, the normals for planes
    rays    : number of rays per point, rounded up by `ray_count`
    numbers : (N,) indices of the points, which seed random numbers; or the first index of consecutive points
    """
    if isinstance(numbers, int):
        numbers = np.arange(numbers, numbers + len(points))
    count = ray_count(rays)
    # A multiple of 4 points, so that a block has all sample points of an element's side (`bounces.POINTS`).
    step = 4 * max(1, _BLOCK // count // 4)
    threads = core_count()
    kind = RECEIVERS.index(receiver)
    with worker_threads(surfaces.rays.stop) as pool:
        for first in range(0, len(points), step):
            last = min(first + step, len(points))
            side = np.empty((last - first, count), np.int32)
            weight = np.empty((last - first, count), np.float32)

            def work(part: slice, first: int = first, side: NDArray[np.int32] = side,
                     weight: NDArray[np.float32] = weight) -> None:  # fmt: skip
                some = slice(first + part.start, first + part.stop)
                _cast(
                    Shooting(points[some], axes[some], numbers[some], kind, seed),
                    surfaces, side[part], weight[part], np.empty((3, 3)),
                )  # fmt: skip

            ends = np.linspace(0, last - first, 4 * threads + 1).astype(int).tolist()
            list(pool.map(work, [slice(a, b) for a, b in pairwise(ends) if b > a]))
            yield Hits(first, side, weight)


class Shooting(NamedTuple):
    """Receivers whose rays are traced.

    points  : (n, 3), lifted off their surfaces
    axes    : (n, 3) unit; normals of planes
    numbers : (n,) indices of the points, which seed random numbers
    kind    : index in `RECEIVERS`
    seed    : seed of all rays
    """

    points: Float64
    axes: Float64
    numbers: NDArray[np.int64]
    kind: int
    seed: int


@inner_kernel
def _first_state(shooting, p):  # type: ignore[no-untyped-def]
    """Return the random state before the first ray of point p."""
    state, _ = next_random(
        np.uint64(shooting.seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(shooting.numbers[p])
    )
    return state


@inner_kernel
def _begin(shooting, p, r, count, state, o, d):  # type: ignore[no-untyped-def]
    """Fill o and d (3,), the origin and direction of ray r of `count` rays of point p.

    Returns the random state and the ray's weight.
    """
    for k in range(3):
        o[k] = shooting.points[p, k]
    heights = count // (BATCHES * _TURNS)
    stratum = r % (heights * _TURNS)
    state, u = next_random(state)
    state, v = next_random(state)
    ax, ay, az = shooting.axes[p, 0], shooting.axes[p, 1], shooting.axes[p, 2]
    z = 1 - 2 * (stratum // _TURNS + u) / heights
    turn = 2 * np.pi * (stratum % _TURNS + v) / _TURNS
    level = np.sqrt(max(0.0, 1 - z * z))
    d[0], d[1], d[2] = level * np.cos(turn), level * np.sin(turn), z
    w = 1.0
    if shooting.kind == 0:
        _to_cosine(d, ax, ay, az)
    elif shooting.kind == 1:
        along = d[0] * ax + d[1] * ay + d[2] * az
        w = 4 * np.sqrt(max(0.0, 1 - along * along)) / np.pi
    return state, w


@inner_kernel
def _to_cosine(d, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Turn d, a point of the unit sphere about +z, into a direction with a cosine density about a normal."""
    # The strata are rotated from +z to the normal, so that they keep about the same size.
    sign = 1.0 if nz >= 0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    x, y, h = d[0], d[1], d[2] + 1.0
    d[0] = x * (1.0 + sign * nx * nx * a) + y * b + h * nx
    d[1] = x * sign * b + y * (sign + ny * ny * a) + h * ny
    d[2] = -x * sign * nx - y * ny + h * nz
    length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    if length > 1e-9:
        d[0], d[1], d[2] = d[0] / length, d[1] / length, d[2] / length
    else:
        d[0], d[1], d[2] = nx, ny, nz


@inner_kernel
def _to_diffuse(surfaces, o, d, own, w, state, found):  # type: ignore[no-untyped-def]
    """Follow a ray (o, d) from triangle `own` through glass and openings to a diffuse side; o becomes the hit.

    Returns the triangle (-1 if the ray leaves the scene), 1 if its back is hit or else 0, w multiplied by the
    factors of passed surfaces, and the random state. After too many surfaces, the triangle is -1 and the weight 0.
    """
    glass = surfaces.glass
    passed = 0
    while passed <= _MAX_THROUGH:
        hit = nearest(surfaces.rays, o, d, own, found)
        if hit < 0:
            return -1, 0, w, state
        own = hit
        passed += 1
        along = 0.0
        for k in range(3):
            along += surfaces.normals[hit, k] * d[k]
            o[k] += found[0] * d[k]
        back = 1 if along > 0 else 0
        if surfaces.culled[hit] and back == 1:
            continue
        state, u = next_random(state)
        opacity = surfaces.opacity[hit]
        if u >= opacity:
            continue
        rest = 1.0
        if surfaces.is_glass[hit]:
            inside = back == 1 and glass.ior[hit] > 0
            mirrored, left = at_glass(glass, hit, abs(along), inside)
            c0, c1, c2 = glass.clear[hit, 0], glass.clear[hit, 1], glass.clear[hit, 2]
            clear = max(c0, c1, c2)
            through = clear * left
            state, u = next_random(state)
            if u < mirrored + through:
                scale, bends = 1.0, -2 * along
                if u >= mirrored:
                    bends = 0.0
                    index = glass.ior[hit]
                    if index > 0:
                        scale = index if inside else 1 / index
                        far = np.sqrt(max(0.0, 1 - scale * scale * (1 - along * along)))
                        bends = (far if along > 0 else -far) - scale * along
                    w *= (0.2126 * c0 + 0.7152 * c1 + 0.0722 * c2) / clear
                for k in range(3):
                    d[k] = scale * d[k] + bends * surfaces.normals[hit, k]
                length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
                for k in range(3):
                    d[k] /= length
                continue
            rest = max(1 - mirrored - through, 1e-9)
        return hit, back, w / (opacity * rest), state
    return -1, 0, 0.0, state


@kernel
def _cast(shooting, surfaces, side, weight, work):  # type: ignore[no-untyped-def]
    """Trace the rays of points; fill the element sides hit and the weights (n, R). work: (3, 3) scratch."""
    o, d, found = work[0], work[1], work[2]
    count = side.shape[1]
    for p in range(len(shooting.points)):
        state = _first_state(shooting, p)
        for r in range(count):
            state, w = _begin(shooting, p, r, count, state, o, d)
            hit, back, w, state = _to_diffuse(surfaces, o, d, -1, w, state, found)
            side[p, r], weight[p, r] = -1, w
            if hit >= 0:
                n = surfaces.divisions[hit]
                x, y = n * found[1], n * found[2]
                i = min(int(x), n - 1)
                j = max(0, min(int(y), n - 1 - i))
                upper = 1 if (x - i + y - j > 1 and i + j < n - 1) else 0
                at = surfaces.begin[hit] + j * (2 * n - j) + 2 * i + upper
                side[p, r] = 2 * at + back


@kernel
def follow(shooting, surfaces, reflected, through, max_reflections, light, work):  # type: ignore[no-untyped-def]
    """Fill light (n, R) with the weights of rays that reach the sky after at least one reflection, others with 0.

    reflected, through : (2, T) `reflected` and `transmitted` of `ReflectingSides`
    work               : (3, 3) scratch
    """
    o, d, found = work[0], work[1], work[2]
    count = light.shape[1]
    for p in range(len(shooting.points)):
        state = _first_state(shooting, p)
        for r in range(count):
            state, w = _begin(shooting, p, r, count, state, o, d)
            own, walk = -1, state
            for reflections in range(max_reflections + 1):
                hit, back, w, walk = _to_diffuse(surfaces, o, d, own, w, walk, found)
                if reflections == 0:
                    state = walk  # resume where `_cast` does, so that both trace the same rays
                if hit < 0:
                    light[p, r] = w if reflections > 0 else 0.0
                    break
                # Russian roulette by the side's reflectance and transmittance.
                stays, goes = reflected[back, hit], through[back, hit]
                walk, u = next_random(walk)
                if u >= stays + goes:
                    break
                w *= max(stays + goes, 1.0)
                sign = 1.0 if (back == 0) == (u < stays) else -1.0
                walk, u = next_random(walk)
                walk, v = next_random(walk)
                z = 1 - 2 * u
                level = np.sqrt(max(0.0, 1 - z * z))
                d[0], d[1], d[2] = level * np.cos(2 * np.pi * v), level * np.sin(2 * np.pi * v), z
                nx, ny, nz = surfaces.normals[hit, 0], surfaces.normals[hit, 1], surfaces.normals[hit, 2]
                _to_cosine(d, sign * nx, sign * ny, sign * nz)
                own = hit
