"""Table 1 of the paper, measured: the strategies in the two offices, and savings by the cache and the emitter list.

Each strategy does one step of progressive radiosity for each of the ten lights of `glpath.io.shipped.office`, with
all polygons as receivers. Rows are plain dictionaries, for tables and JSON; `benches` and `figures` both show them.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", 1991.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from glpath.io import load_scene
from glpath.radiosity.shafts.ends import Emitter, Receivers
from glpath.radiosity.shafts.occluders import Occluders
from glpath.radiosity.shafts.options import PAPER, ShaftOptions, Statistics
from glpath.radiosity.shafts.visibility import Visibility
from glpath.scene import Scene

Row = dict[str, Any]
Say = Callable[[str], None]
OFFICES = ("office", "office-premesh")

#: [SC, table 1], for a Hewlett-Packard 9000/433: tests per ray, and microseconds per ray at low and high sampling.
PAPER_TABLE_1: dict[str, dict[str, tuple[float, float, float]]] = {
    "office": {
        "baseline": (44.6, 787, 762),
        "keep closed": (28.4, 642, 534),
        "always open": (132.9, 2268, 1785),
        "overlap open": (66.7, 1382, 1008),
        "ratio open 0.2": (22.1, 670, 482),
        "ratio open 0.4": (21.9, 681, 480),
        "ratio open 0.6": (22.1, 679, 478),
        "ratio open 0.8": (24.1, 753, 524),
    },
    "office-premesh": {
        "baseline": (79.2, 1487, 1355),
        "keep closed": (47.8, 1094, 919),
        "always open": (27.5, 1289, 694),
        "overlap open": (25.8, 1283, 680),
        "ratio open 0.2": (27.1, 1104, 685),
        "ratio open 0.4": (26.7, 1135, 682),
        "ratio open 0.6": (25.0, 1154, 654),
        "ratio open 0.8": (21.1, 1327, 631),
    },
}


@dataclass(frozen=True)
class Office:
    """A scene with its lights as emitters, and all its polygons as receivers."""

    scene: Scene
    occluders: Occluders
    emitters: tuple[Emitter, ...]
    receivers: Receivers


def office(
    name: str, spacing: float = 0.25, side: int = 4, whole: bool = False, most_lights: int | None = None
) -> Office:
    """Return a shipped scene with receiver points at most `spacing` apart and side x side samples on each light."""
    scene = load_scene(name)
    occluders = Occluders.of_scene(scene)
    lights = [i for i in range(len(occluders)) if scene.shapes[occluders.shape[i]].emits][:most_lights]
    emitters = tuple(Emitter.on(occluders, i, side, whole) for i in lights)
    return Office(scene, occluders, emitters, Receivers.on(occluders, spacing))


def shoot(visibility: Visibility, where: Office) -> Callable[[], Statistics]:
    """Return a function that does one step of every emitter; BVH and clumps of receivers are built beforehand."""
    prepared = visibility.prepare(where.receivers)
    assert len(visibility.tree)

    def steps() -> Statistics:
        total = Statistics()
        for emitter in where.emitters:
            total += visibility.step(emitter, prepared)[1]
        return total

    return steps


def in_turns(contestants: Sequence[Callable[[], Any]], rounds: int) -> tuple[list[float], list[Any]]:
    """Run the functions in turns; return their median seconds, and the results of an untimed first round."""
    results = [run() for run in contestants]
    seconds = np.empty((rounds, len(contestants)))
    for turn in range(rounds):
        for i, run in enumerate(contestants):
            start = time.perf_counter()
            run()
            seconds[turn, i] = time.perf_counter() - start
    return [float(s) for s in np.median(seconds, axis=0)], results


def strategies() -> dict[str, ShaftOptions]:
    """Return the rows of the paper's table 1."""
    ratios = {f"ratio open {r}": replace(PAPER, strategy="ratio open", ratio=r) for r in (0.2, 0.4, 0.6, 0.8)}
    return {
        "baseline": replace(PAPER, strategy="no shaft"),
        "keep closed": replace(PAPER, strategy="keep closed"),
        "always open": replace(PAPER, strategy="always open"),
        "overlap open": replace(PAPER, strategy="overlap open"),
        **ratios,
    }


def table_1_rows(
    bvh: Literal["areas", "clusters"] = "clusters",
    spacing: float = 0.25,
    rounds: int = 3,
    say: Say = print,
    most_lights: int | None = None,
) -> list[Row]:
    """Measure the paper's table 1 on one thread: each strategy, 1 and 4 samples of each light, both offices.

    For rays that the last occluder does not block, a row has the tests of boxes and polygons, and the microseconds,
    with the time for shafts. "wrong rays" is the difference of the number of blocked rays from the baseline, which
    tests the whole BVH.
    """
    rows: list[Row] = []
    for name in OFFICES:
        timed: dict[str, dict[int, tuple[float, Statistics]]] = {}
        for side in (1, 2):
            where = office(name, spacing, side, True, most_lights)
            runs = [shoot(Visibility(where.occluders, o, bvh, 1), where) for o in strategies().values()]
            seconds, counts = in_turns(runs, rounds)
            for label, second, count in zip(strategies(), seconds, counts, strict=True):
                timed.setdefault(label, {})[side] = second, count
            say(f"{name}, {side * side} samples: {counts[0].rays} rays")
        for label, by_side in timed.items():
            (low, few), (high, many) = by_side[1], by_side[2]
            paper = PAPER_TABLE_1[name][label]
            rows.append(
                {
                    "scene": name,
                    "strategy": label,
                    "tests/ray": (_tests(few) + _tests(many)) / 2,
                    "low µs": low / _uncached(few) * 1e6,
                    "high µs": high / _uncached(many) * 1e6,
                    "paper tests/ray": paper[0],
                    "paper low µs": paper[1],
                    "paper high µs": paper[2],
                    "rays/shaft low": _uncached(few) / few.shafts if few.shafts else None,
                    "rays/shaft high": _uncached(many) / many.shafts if many.shafts else None,
                    "candidates/shaft": many.candidates / many.shafts if many.shafts else None,
                    "empty shafts": many.empty_shafts / many.shafts if many.shafts else None,
                    "free rays": many.free / _uncached(many),
                    "wrong rays": sum(
                        abs(by_side[side][1].blocked - timed["baseline"][side][1].blocked) for side in by_side
                    ),
                }
            )
    return rows


def _uncached(counts: Statistics) -> int:
    return counts.rays - counts.cached


def _tests(counts: Statistics) -> float:
    """Return the tests per ray that is not cached; a cached one had a single test."""
    return (counts.tests - counts.cached) / _uncached(counts)


def savings_rows(
    bvh: Literal["areas", "clusters"] = "clusters", spacing: float = 0.25, most_lights: int | None = None
) -> list[Row]:
    """Return the fractions of tests that shadow coherency (paper: 31 %) and the emitter list (17 %, 12 %) save."""
    plain = replace(PAPER, strategy="no shaft", coherency=False, emitter_list=False, behind_emitter=False)
    rows = []
    for name, paper in zip(OFFICES, (0.17, 0.12), strict=True):
        where = office(name, spacing, 1, True, most_lights)

        def tests(options: ShaftOptions, where: Office = where) -> Statistics:
            return shoot(Visibility(where.occluders, options, bvh, 1), where)()

        none, cached = tests(plain), tests(replace(plain, coherency=True))
        listed = tests(replace(plain, coherency=True, emitter_list=True, behind_emitter=True))
        rows.append(
            {
                "scene": name,
                "blocked": none.blocked / none.rays,
                "paper blocked": 0.54,
                "cached of blocked": cached.cached / cached.blocked,
                "paper cached of blocked": 0.78,
                "cache saves": 1 - cached.tests / none.tests,
                "paper cache saves": 0.31,
                "emitter list saves": 1 - listed.tests / cached.tests,
                "paper emitter list saves": paper,
            }
        )
    return rows
