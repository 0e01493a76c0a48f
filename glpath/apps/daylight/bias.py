"""Measurement of the bias of a daylight solution whose elements are too large for the variation of light.

Rays from some sensors hit elements, whose radiosity under a uniform sky and ground is looked up. The same rays are
also followed from surface to surface until they leave the scene. That estimate has no bias, and the difference of
both has little noise. In both, all surfaces are diffuse.

Cost:     up to eight rounds of 0.3 s, for 256 sensors of 1,024 rays.
Poor at:  bias at sensors that are not in the sample.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight.bounces import ReflectingSides, Reflections
from glpath.apps.daylight.hits import BATCHES, Shooting, cast_hits, follow, ray_count
from glpath.apps.daylight.receivers import RECEIVERS, Receiver
from glpath.film.bias import BLOCKS, SURE, Bias, bias_of, summed
from glpath.system.machine import core_count
from glpath.system.threads import worker_threads

Float64 = NDArray[np.float64]

#: Maximum number of sensors to compare.
_SENSORS = 256
#: Total number of rays from all these sensors in a round.
_RAYS = 1 << 18
#: Maximum number of rounds of rays.
_ROUNDS = 8


def bias_of_solution(
    sides: ReflectingSides,
    reflections: Reflections,
    receivers: tuple[Float64, Float64, Receiver],
    seed: int,
) -> Bias:
    """Return the bias of the light at sensors under a sky and a ground of radiance 1.

    receivers : points (N, 3) and axes (N, 3) of all sensors, and their kind
    seed      : seed of the rays of the first round

    Rounds of rays are added until the bias is known to be small or large. A block contains a 64th of the sensors,
    in their order.
    """
    points, axes, receiver = receivers
    numbers = np.unique(np.arange(_SENSORS) * len(points) // _SENSORS)
    at = points[numbers] + sides.lift * axes[numbers] if receiver == "plane" else points[numbers]
    chosen = at, axes[numbers], receiver
    rays = _RAYS // max(1, len(numbers))
    biased: list[Float64] = []
    unbiased: list[Float64] = []
    while True:
        of_round = seed + len(biased) // BATCHES
        straight, reflected = [], []
        for hits in cast_hits(sides.surfaces, *chosen, rays, of_round, numbers):
            straight.append(np.where(hits.side < 0, np.float32(np.pi) * hits.weight, np.float32(0)))
            reflected.append(sides.looked_up(hits, reflections.of_sky))
        direct = np.concatenate(straight)
        followed = walk_to_sky(sides, chosen, rays, of_round, numbers, reflections.max_reflections)
        biased += _block_means(direct + np.concatenate(reflected))
        unbiased += _block_means(direct + followed)
        bias = bias_of(summed(biased, unbiased))
        assert bias is not None, "several batches"
        if len(biased) == _ROUNDS * BATCHES or bias.is_small(SURE) or bias.is_large(SURE):
            return bias


def _block_means(light: NDArray[np.float32]) -> list[Float64]:
    """Return the mean light (BLOCKS, BLOCKS) of BLOCKS^2 blocks of sensors, for each batch of rays.

    light : (n, R) light along the rays of the sensors
    """
    n, number = len(light), np.arange(BLOCKS**2)
    first = number * n // BLOCKS**2
    last = np.maximum((number + 1) * n // BLOCKS**2, first + 1)
    batches = light.reshape(n, BATCHES, -1).mean(axis=2, dtype=np.float64)
    sums = np.concatenate([np.zeros((1, BATCHES)), batches.cumsum(axis=0)])
    means = (sums[last] - sums[first]) / (last - first)[:, None]
    return [batch.reshape(BLOCKS, BLOCKS) for batch in means.T]


def walk_to_sky(
    sides: ReflectingSides,
    receivers: tuple[Float64, Float64, Receiver],
    rays: int,
    seed: int,
    numbers: NDArray[np.int64],
    max_reflections: int,
) -> NDArray[np.float32]:
    """Follow the rays of `cast_hits` from surface to surface until they leave the scene or are absorbed.

    receivers : points (n, 3), axes (n, 3) and the kind of receiver
    numbers   : (n,) indices of the points, as in `cast_hits`
    max_reflections : maximum number of reflections; a ray that needs more contributes nothing

    Returns (n, R) float32: light of rays that end in the sky after one reflection or more, else 0. The mean is the
    irradiance by reflected light under a sky and a ground of radiance 1.
    """
    points, axes, receiver = receivers
    light = np.zeros((len(points), ray_count(rays)), np.float32)
    threads = core_count()

    def work(part: slice) -> None:
        shooting = Shooting(points[part], axes[part], numbers[part], RECEIVERS.index(receiver), seed)
        room = np.empty((3, 3))
        follow(shooting, sides.surfaces, sides.reflected, sides.transmitted, max_reflections, light[part], room)

    with worker_threads(sides.surfaces.rays.stop) as pool:
        ends = np.linspace(0, len(points), 4 * threads + 1).astype(int).tolist()
        list(pool.map(work, [slice(a, b) for a, b in pairwise(ends) if b > a]))
    return np.float32(np.pi) * light
