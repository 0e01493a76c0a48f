"""Measures the bias of a picture with an engine that has none: a few path sets of a smaller picture.

Cost:     as much as some sets of the picture itself, and a further program: 0.2 to 0.5 s.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from glpath.film.batches import BLOCK
from glpath.film.bias import UNBIASED, block_means, summed
from glpath.film.film import Film
from glpath.gl.context import Context
from glpath.integrators.engine import Engine
from glpath.rendering.factory import Plan
from glpath.rendering.interrupts import Flag
from glpath.scene import Scene
from glpath.sensors.sensor import CameraSensor
from glpath.system.heartbeat import heartbeat

#: Path sets, and the longer side of their picture in pixels: of fewer the error is larger than the bias.
SETS, SIDE = 16, 64
_PARTS = 1 << 20
#: Path sets of a film from which on its bias is measured: of fewer, noise hides it.
MIN_FILM_SETS = 16


def measured_bias(
    film: Film,
    plan: Plan,
    engine: Engine,
    context: Context,
    scene: Scene,
    sensor: CameraSensor,
    interrupted: Flag,
) -> dict[str, Any]:
    """`statistics["unbiased"]` of a film; empty where its engine has no bias, or the film is but a part.

    scene, sensor : traceable, and relative to its origin
    interrupted   : when it is set, nothing is measured any more
    """
    width, height = sensor.resolution
    whole = film.metadata.window == (0, 0, width, height) and film.path_sets >= MIN_FILM_SETS
    if not whole or sensor.projection == "panorama":
        return {}
    scale = min(1.0, SIDE / max(width, height))
    rows = max(1, round(height * scale))
    columns = max(1, int(rows * width / height))
    small = replace(sensor, resolution=(columns, rows))
    with context:
        unbiased = plan.unbiased(engine, context, scene, small)
        if unbiased is None:
            return {}
        sets = []
        # Others for each part of a render, as their sums are added when parts merge.
        first = film.ranges[0][0] // BLOCK % _PARTS * SETS
        with unbiased.prepare():
            for index in range(first, first + SETS):
                if interrupted:
                    return {}
                unbiased.trace_path_set(index)
                heartbeat.beat()
                sets.append(block_means(unbiased.take()))
    return {UNBIASED: summed(sets, (columns / rows) / (width / height))}
