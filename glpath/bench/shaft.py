"""Shaft culling measured: table 1 of the paper, what each option saves, and the way beside Embree.

On the offices of `glpath.scene.office`: one step of progressive radiosity for each of the ten lights, over all
polygons as receivers. Rows are plain dictionaries, for tables and JSON.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", 1991.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glpath.errors import GlpathError
from glpath.radiosity import PAPER, Blockers, Emitter, Options, Receivers, Statistics, Visibility, facing
from glpath.scene import Scene, load_scene

Row = dict[str, Any]
Say = Callable[[str], None]
OFFICES = ("office", "office-premesh")

#: The quickest for the offices: shafts within shafts, lists of polygons only, whole clumps at a time.
BEST = Options(solids=True)
#: A ray caster with shadow coherency and emitter lists, which the paper compares with.
BASELINE = Options(strategy="no shaft", together=False, clump=0, group=0, nested=False)

#: [SC, table 1], Hewlett-Packard 9000/433: tests per ray, and microseconds per ray at low and high sampling.
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
    """A scene with its emitters, which are its lights, and its receivers, which are all its polygons."""

    scene: Scene
    blockers: Blockers
    emitters: tuple[Emitter, ...]
    receivers: Receivers


def office(name: str, spacing: float = 0.25, side: int = 4, whole: bool = False) -> Office:
    """A shipped scene with receiver points at most `spacing` apart and side x side samples on each light."""
    scene = load_scene(name)
    blockers = Blockers.of_scene(scene)
    lights = [i for i in range(len(blockers)) if scene.shapes[blockers.shape[i]].emits]
    emitters = tuple(Emitter.on(blockers, i, side, whole) for i in lights)
    return Office(scene, blockers, emitters, Receivers.on(blockers, spacing))


def shoot(visibility: Visibility, where: Office) -> Callable[[], Statistics]:
    """One step of every emitter, as a function; the hierarchy and the clumps of receivers are made before."""
    prepared = visibility.prepare(where.receivers)
    assert len(visibility.tree)

    def steps() -> Statistics:
        total = Statistics()
        for emitter in where.emitters:
            total += visibility.step(emitter, prepared)[1]
        return total

    return steps


def in_turns(contestants: Sequence[Callable[[], Any]], rounds: int) -> tuple[list[float], list[Any]]:
    """The median of the seconds that each takes, in turns, after a first one that does not count; and results."""
    results = [run() for run in contestants]
    seconds = np.empty((rounds, len(contestants)))
    for turn in range(rounds):
        for i, run in enumerate(contestants):
            start = time.perf_counter()
            run()
            seconds[turn, i] = time.perf_counter() - start
    return [float(s) for s in np.median(seconds, axis=0)], results


def strategies() -> dict[str, Options]:
    """The rows of the paper's table 1."""
    ratios = {f"ratio open {r}": replace(PAPER, strategy="ratio open", ratio=r) for r in (0.2, 0.4, 0.6, 0.8)}
    return {
        "baseline": replace(PAPER, strategy="no shaft"),
        "keep closed": replace(PAPER, strategy="keep closed"),
        "always open": replace(PAPER, strategy="always open"),
        "overlap open": replace(PAPER, strategy="overlap open"),
        **ratios,
    }


def table_1_rows(
    hierarchy: Literal["areas", "clusters"] = "clusters", spacing: float = 0.25, rounds: int = 3, say: Say = print
) -> list[Row]:
    """The paper's table 1: each strategy, low (1 sample of each light) and high (4), both offices, on one thread.

    Of rays that the last blocker did not stop: tests of boxes and polygons, and microseconds, shafts included.
    """
    rows: list[Row] = []
    for name in OFFICES:
        timed: dict[str, dict[int, tuple[float, Statistics]]] = {}
        for side in (1, 2):
            where = office(name, spacing, side, whole=True)
            runs = [shoot(Visibility(where.blockers, o, hierarchy, 1), where) for o in strategies().values()]
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
                }
            )
    return rows


def _uncached(counts: Statistics) -> int:
    return counts.rays - counts.cached


def _tests(counts: Statistics) -> float:
    """Of uncached rays; a cached one had a single test."""
    return (counts.tests - counts.cached) / _uncached(counts)


def savings_rows(hierarchy: Literal["areas", "clusters"] = "clusters", spacing: float = 0.25) -> list[Row]:
    """What shadow coherency (paper: 31 %) and the emitter list (17 %, 12 %) save of the tests of rays."""
    plain = replace(PAPER, strategy="no shaft", coherency=False, emitter_list=False, behind_emitter=False)
    rows = []
    for name, paper in zip(OFFICES, (0.17, 0.12), strict=True):
        where = office(name, spacing, 1, whole=True)

        def tests(options: Options, where: Office = where) -> Statistics:
            return shoot(Visibility(where.blockers, options, hierarchy, 1), where)()

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


def option_rows(spacing: float = 0.25, side: int = 4, rounds: int = 3, names: Sequence[str] = OFFICES) -> list[Row]:
    """What each option is worth: `BEST` with one option changed, and the paper's with one of the future."""
    paper = replace(PAPER, strategy="ratio open", ratio=0.4)
    changed = {
        "best": BEST,
        "best, one ray after the other": replace(BEST, together=False),
        "best, without solids": replace(BEST, solids=False),
        "best, without coplanar": replace(BEST, coplanar=False),
        "best, without tolerance": replace(BEST, tolerance=False),
        "best, without coherency": replace(BEST, coherency=False),
        "best, without emitter list": replace(BEST, emitter_list=False, behind_emitter=False),
        "best, without groups": replace(BEST, group=0),
        "best, without nesting": replace(BEST, group=0, nested=False),
        "best, whole receivers": replace(BEST, clump=0, group=0, nested=False),
        "best, clumps of 8": replace(BEST, clump=8),
        "best, clumps of 128": replace(BEST, clump=128),
        "best, largest first": replace(BEST, order="largest first"),
        "best, planes from 2 % on": replace(BEST, least_cut=0.02),
        "best, few rays without shafts": replace(BEST, no_shaft_below=8 * side**2),
        "best, few rays keep closed": replace(BEST, keep_closed_below=100 * side**2),
        "best, overlap open": replace(BEST, strategy="overlap open"),
        "best, lists of any length": replace(BEST, longest=0),
        "best, ratio open": replace(BEST, strategy="ratio open"),
        "paper": paper,
        "paper, without mailbox": replace(paper, mailbox=False),
        "paper, without opening what encloses": replace(paper, open_enclosing=False),
        "paper, without boxes of objects": replace(paper, object_boxes=False),
        "paper, tolerance": replace(paper, tolerance=True),
        "paper, coplanar": replace(paper, coplanar=True),
        "paper, solids": replace(paper, solids=True),
        "paper, clumps of 32": replace(paper, clump=32),
        "paper, nested clumps of 32": replace(paper, clump=32, nested=True),
        "paper, groups": replace(paper, clump=32, group=512, nested=True),
        "paper, largest first": replace(paper, order="largest first"),
        "paper, last blocker first": replace(paper, order="last blocker first"),
        "paper, planes sorted": replace(paper, least_cut=0.0),
        "paper, planes from 5 % on": replace(paper, least_cut=0.05),
        "paper, few rays without shafts": replace(paper, no_shaft_below=5 * side**2),
        "paper, few rays keep closed": replace(paper, keep_closed_below=10 * side**2),
    }
    rows: list[Row] = []
    for name in names:
        where = office(name, spacing, side)
        seconds, counts = in_turns(
            [
                shoot(Visibility(where.blockers, o, "areas" if label.startswith("best") else "clusters", 1), where)
                for label, o in changed.items()
            ],
            rounds,
        )
        for label, second, count in zip(changed, seconds, counts, strict=True):
            reference = seconds[0] if label.startswith("best") else seconds[list(changed).index("paper")]
            rows.append(
                {
                    "scene": name,
                    "options": label,
                    "ns/ray": second / count.rays * 1e9,
                    "time": second / reference,
                    "tests/ray": count.tests / count.rays,
                    "shafts": count.shafts,
                    "empty": count.empty_shafts / max(count.shafts, 1),
                    "tests/shaft": count.shaft_tests / max(count.shafts, 1),
                    "candidates/list": count.candidates / max(count.lists, 1),
                    "free": count.free / count.rays,
                    "cached": count.cached / count.rays,
                }
            )
    return rows


def peer_rows(spacing: float = 0.25, side: int = 4, rounds: int = 5, say: Say = print) -> list[Row]:
    """One step of every light: ours on one thread and on all, our baseline, and Embree's occlusion rays.

    Embree, through embreex, gets the same rays, those between ends that face each other, made beforehand; on all
    cores it runs in processes, as embreex keeps Python's lock. Its rows are left out where embreex is not
    installed.
    """
    cores = len(os.sched_getaffinity(0))
    rows: list[Row] = []
    for name in OFFICES:
        where = office(name, spacing, side)
        caster = Visibility(where.blockers, BASELINE, threads=1)
        contestants: dict[str, Callable[[], Any]] = {
            "shafts, 1 thread": shoot(Visibility(where.blockers, BEST, threads=1), where),
            f"shafts, {cores} threads": shoot(Visibility(where.blockers, BEST, threads=cores), where),
            "baseline, 1 thread": shoot(caster, where),
        }
        pool = None
        try:
            contestants["Embree, 1 thread"] = _EmbreeRays(where)
        except GlpathError as error:
            say(str(error))
        else:
            pool = ProcessPoolExecutor(cores, get_context("spawn"), _in_process, (name, spacing, side))
            contestants[f"Embree, {cores} processes"] = partial(_occluded_in_pool, pool, 8 * cores)
        try:
            seconds, results = in_turns(list(contestants.values()), rounds)
        finally:
            if pool is not None:
                pool.shutdown()
        rays = results[0].rays
        for label, second, result in zip(contestants, seconds, results, strict=True):
            blocked = result.blocked if isinstance(result, Statistics) else result
            rows.append(
                {
                    "scene": name,
                    "program": label,
                    "million/s": rays / second * 1e-6,
                    "ns/ray": second / rays * 1e9,
                    "times ours": second / seconds[1 if str(cores) in label and "1 thread" not in label else 0],
                    "blocked": blocked / rays,
                }
            )
    return rows


class _EmbreeRays:
    """Embree with an office's triangles and all rays of a step of every light; called, it traces them."""

    def __init__(self, where: Office) -> None:
        try:
            from embreex import mesh_construction, rtcore_scene
        except ImportError as error:
            raise GlpathError(
                f"embreex cannot be imported ({error}); it is needed only as a peer.",
                "pip install 'glpath[reference]'",
            ) from error
        self._scene = rtcore_scene.EmbreeScene()
        mesh_construction.TriangleMesh(self._scene, where.scene.triangles.astype(np.float32))
        origins, ways = [], []
        for emitter in where.emitters:
            point, sample = np.nonzero(facing(emitter, where.receivers))
            way = where.receivers.points[point] - emitter.points[sample]
            # 32 bit rays need a larger distance from the surfaces at their ends than ours.
            origins.append((emitter.points[sample] + 1e-4 * way).astype(np.float32))
            ways.append((way * (1 - 2e-4)).astype(np.float32))
        self._origins, self._ways = np.concatenate(origins), np.concatenate(ways)
        self._ends = np.ones(len(self._ways), np.float32)

    def __call__(self, part: slice = slice(None)) -> int:
        """How many rays are blocked."""
        hit: NDArray[np.int32] = self._scene.run(
            self._origins[part], self._ways[part], query="OCCLUDED", dists=self._ends[part].copy()
        )
        return int((hit == 0).sum())

    def __len__(self) -> int:
        return len(self._ends)


_embree: _EmbreeRays | None = None


def _in_process(name: str, spacing: float, side: int) -> None:
    global _embree
    _embree = _EmbreeRays(office(name, spacing, side))


def _occluded_in_pool(pool: ProcessPoolExecutor, parts: int) -> int:
    return sum(pool.map(_occluded_in_process, [(i, parts) for i in range(parts)]))


def _occluded_in_process(share: tuple[int, int]) -> int:
    assert _embree is not None
    index, parts = share
    edges = np.linspace(0, len(_embree), parts + 1).astype(int)
    return _embree(slice(int(edges[index]), int(edges[index + 1])))


def growth_rows(sizes: Sequence[int] = (1_000, 10_000, 100_000, 1_000_000), threads: int = 1) -> list[Row]:
    """What a step costs in ever larger scenes: small triangles scattered in a cube, one light, 20,000 points."""
    rows = []
    for size in sizes:
        rng = np.random.default_rng(size)
        centres = rng.random((size, 1, 3))
        edge = 1.2 * size ** (-1 / 2)  # as much shadow whatever their number
        blockers = Blockers.of_triangles(centres + edge * (rng.random((size, 3, 3)) - 0.5))
        middles = (np.arange(4) + 0.5) / 4
        samples = np.stack([*np.meshgrid(0.4 + 0.2 * middles, 0.4 + 0.2 * middles), np.full((4, 4), 1.1)], axis=-1)
        emitter = Emitter(samples.reshape(-1, 3), np.array([0.0, 0.0, -1.0]))
        u = np.linspace(0, 1, 141)
        floor = np.stack([*np.meshgrid(u, u), np.full((141, 141), -0.1)], axis=-1).reshape(-1, 3)
        receivers = Receivers(floor, np.zeros(len(floor), np.int32), np.tile([0.0, 0.0, 1.0], (len(floor), 1)))
        visibility = Visibility(blockers, BEST, threads=threads)
        start = time.perf_counter()
        assert len(visibility.tree)
        built = time.perf_counter() - start
        prepared = visibility.prepare(receivers)
        seconds, (result,) = in_turns([partial(visibility.step, emitter, prepared)], 3)
        counts = result[1]
        rows.append(
            {
                "polygons": size,
                "hierarchy s": built,
                "step s": seconds[0],
                "ns/ray": seconds[0] / counts.rays * 1e9,
                "blocked": counts.blocked / counts.rays,
                "tests/ray": counts.tests / counts.rays,
                "candidates/list": counts.candidates / max(counts.lists, 1),
            }
        )
    return rows


def measured(rows: Sequence[Row]) -> dict[str, float]:
    """The numbers that the marks are set on, of `peer_rows`: their time over ours, shaft building included."""
    numbers = {}
    for row in rows:
        scene = "premesh" if row["scene"] == "office-premesh" else "office"
        program = row["program"]
        if program.startswith("baseline"):
            numbers[f"vs_baseline_{scene}"] = row["times ours"]
        elif program.startswith("Embree"):
            numbers[f"vs_embree_{'1' if '1 thread' in program else 'all'}_{scene}"] = row["times ours"]
    return numbers
