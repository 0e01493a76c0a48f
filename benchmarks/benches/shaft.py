"""Shaft culling: gain of each option, growth of the cost with the scene, and a comparison with Embree.

The scenes are the offices of `glpath.io.shipped.office`: one step of progressive radiosity for each of the ten
lights, with all polygons as receivers. Rows are plain dictionaries, for tables and JSON.

[SC] E. Haines, J. Wallace, "Shaft culling for efficient ray-cast radiosity", 1991.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.office_table import OFFICES, Office, Row, Say, in_turns, office, shoot
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.errors import GlpathError
from glpath.radiosity import PAPER, Emitter, Occluders, Receivers, ShaftOptions, Statistics, Visibility, facing
from glpath.system.machine import core_count
from glpath.system.versions import versions

CLAIM = "visibility by shafts 2.5 times as fast as by our ray caster, and ahead of Embree, on the offices"
# Rounding decides one ray in a hundred thousand that meets an edge of a solid. Embree's rays have 32 bits, and
# their ends have other distances from the surfaces.
OPTIONS_AGREEMENT = (Condition("blocked_off_ours", "<=", 1e-4),)
AGREEMENT = (*OPTIONS_AGREEMENT, Condition("blocked_off_embree", "<=", 0.002))
RULE = (
    *AGREEMENT,
    Condition("vs_baseline_office", ">=", 2.5),
    Condition("vs_baseline_premesh", ">=", 2.5),
    Condition("vs_embree_1_office", ">", 1.0),
    Condition("vs_embree_1_premesh", ">", 1.0),
    Condition("vs_embree_all_office", ">", 1.0),
    Condition("vs_embree_all_premesh", ">", 1.0),
)
SIZES = (1_000, 10_000, 100_000, 1_000_000)

#: Fastest options for the offices: nested shafts, lists of polygons only, whole clumps at a time.
BEST = ShaftOptions(solids=True)
#: Options of a ray caster with shadow coherency and emitter lists, with which the paper compares.
BASELINE = ShaftOptions(strategy="no shaft", together=False, clump=0, group=0, nested=False)


def option_rows(spacing: float = 0.25, side: int = 4, rounds: int = 3, names: Sequence[str] = OFFICES) -> list[Row]:
    """Return rows of each option's gain: `BEST` with one option changed, and the paper's with one extension."""
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
        "best, all planes": replace(BEST, min_cut=None),
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
        "paper, last occluder first": replace(paper, order="last occluder first"),
        "paper, planes sorted": replace(paper, min_cut=0.0),
        "paper, planes from 5 % on": replace(paper, min_cut=0.05),
        "paper, few rays without shafts": replace(paper, no_shaft_below=5 * side**2),
        "paper, few rays keep closed": replace(paper, keep_closed_below=10 * side**2),
    }
    rows: list[Row] = []
    for name in names:
        where = office(name, spacing, side)
        seconds, counts = in_turns(
            [
                shoot(Visibility(where.occluders, o, "areas" if label.startswith("best") else "clusters", 1), where)
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
                    "blocked": count.blocked / count.rays,
                }
            )
    return rows


def peer_rows(spacing: float = 0.25, side: int = 4, rounds: int = 5, say: Say = print) -> list[Row]:
    """Return rows of one step of all lights: ours on one thread and on all, our baseline, Embree's occlusion.

    Embree, through embreex, gets the same rays, those between ends that face each other, prepared in advance. On
    all cores it runs in processes, because embreex keeps Python's lock. Without embreex, its rows are left out.
    """
    cores = core_count()
    rows: list[Row] = []
    for name in OFFICES:
        where = office(name, spacing, side)
        caster = Visibility(where.occluders, BASELINE, threads=1)
        contestants: dict[str, Callable[[], Any]] = {
            "shafts, 1 thread": shoot(Visibility(where.occluders, BEST, threads=1), where),
            f"shafts, {cores} threads": shoot(Visibility(where.occluders, BEST, threads=cores), where),
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
    """Embree with an office's triangles and all rays of a step of every light; a call traces the rays."""

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
            # 32-bit rays need a larger distance from the surfaces at their ends than ours.
            origins.append((emitter.points[sample] + 1e-4 * way).astype(np.float32))
            ways.append((way * (1 - 2e-4)).astype(np.float32))
        self._origins, self._ways = np.concatenate(origins), np.concatenate(ways)
        self._ends = np.ones(len(self._ways), np.float32)

    def __call__(self, part: slice = slice(None)) -> int:
        """Return the number of blocked rays."""
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


def bench_shaft_options(scale: float = 1.0, rounds: int = 3, say: Say = lambda text: None) -> Report:
    """Measure the gain of each option in the paper, and of each extension that it proposes; see `option_rows`.

    The report's numbers are the times of `BEST` and of the paper's options, divided by those of the fastest of
    their variants. The bench takes about a minute on two cores.

    scale, rounds, say : see `bench_shaft`
    """
    rows: list[Row] = []
    for name in OFFICES:
        say(f"{name}: each option in turns, on one thread")
        rows += option_rows(min(0.25 / scale, 2.0), 4, rounds, [name])
    numbers = {}
    for name in OFFICES:
        short = "premesh" if name == "office-premesh" else "office"
        for base in ("best", "paper"):
            times = [row["time"] for row in rows if row["scene"] == name and row["options"].startswith(base)]
            numbers[f"{base}_over_quickest_{short}"] = 1.0 / min(times)
    numbers["blocked_off_ours"] = _blocked_off(rows, rows)
    return Report(
        name="shaft-options",
        claim="",
        measured=numbers,
        holds=None,
        rows=rows,
        machine=machine("none; on the CPU"),
        versions=versions("glpath", "numpy", "numba"),
        notes=[f"at scale {scale:g}"] if scale < 1 else [],
        faults=faults(OPTIONS_AGREEMENT, numbers),
    )


def growth_rows(sizes: Sequence[int] = (1_000, 10_000, 100_000, 1_000_000), threads: int = 1) -> list[Row]:
    """Return a step's cost in growing scenes: small triangles scattered in a cube, one light, 20,000 points."""
    rows = []
    for size in sizes:
        rng = np.random.default_rng(size)
        centres = rng.random((size, 1, 3))
        edge = 1.2 * size ** (-1 / 2)  # the same amount of shadow for any number
        occluders = Occluders.of_triangles(centres + edge * (rng.random((size, 3, 3)) - 0.5))
        middles = (np.arange(4) + 0.5) / 4
        samples = np.stack([*np.meshgrid(0.4 + 0.2 * middles, 0.4 + 0.2 * middles), np.full((4, 4), 1.1)], axis=-1)
        emitter = Emitter(samples.reshape(-1, 3), np.array([0.0, 0.0, -1.0]))
        u = np.linspace(0, 1, 141)
        floor = np.stack([*np.meshgrid(u, u), np.full((141, 141), -0.1)], axis=-1).reshape(-1, 3)
        receivers = Receivers(floor, np.zeros(len(floor), np.int32), np.tile([0.0, 0.0, 1.0], (len(floor), 1)))
        visibility = Visibility(occluders, BEST, threads=threads)
        start = time.perf_counter()
        assert len(visibility.tree)
        built = time.perf_counter() - start
        prepared = visibility.prepare(receivers)
        caster = Visibility(occluders, BASELINE, threads=threads)
        steps = [
            partial(visibility.step, emitter, prepared),
            partial(caster.step, emitter, caster.prepare(receivers)),
        ]
        seconds, (result, _) = in_turns(steps, 3)
        counts = result[1]
        rows.append(
            {
                "polygons": size,
                "bvh s": built,
                "step s": seconds[0],
                "ns/ray": seconds[0] / counts.rays * 1e9,
                "baseline over ours": seconds[1] / seconds[0],
                "blocked": counts.blocked / counts.rays,
                "tests/ray": counts.tests / counts.rays,
                "candidates/list": counts.candidates / max(counts.lists, 1),
            }
        )
    return rows


def measured(rows: Sequence[Row]) -> dict[str, float]:
    """Return the limited numbers of `peer_rows`: others' time divided by ours, shaft building included.

    blocked_off_ours, blocked_off_embree: largest difference in the fraction of blocked rays.
    """
    embree = [row for row in rows if row["program"].startswith("Embree")]
    ours = [row for row in rows if row not in embree]
    numbers = {"blocked_off_ours": _blocked_off(ours, ours)}
    if embree:
        numbers["blocked_off_embree"] = _blocked_off(embree, ours)
    for row in rows:
        scene = "premesh" if row["scene"] == "office-premesh" else "office"
        program = row["program"]
        if program.startswith("baseline"):
            numbers[f"vs_baseline_{scene}"] = row["times ours"]
        elif program.startswith("Embree"):
            numbers[f"vs_embree_{'1' if '1 thread' in program else 'all'}_{scene}"] = row["times ours"]
    return numbers


def _blocked_off(rows: Sequence[Row], others: Sequence[Row]) -> float:
    """Return the largest difference in the fraction of blocked rays between any two rows of one scene."""
    pairs = ((row, other) for row in rows for other in others if row["scene"] == other["scene"])
    return max(abs(float(row["blocked"]) - float(other["blocked"])) for row, other in pairs)


def bench_shaft(scale: float = 1.0, rounds: int = 7, say: Say = lambda text: None) -> Report:
    """Measure; takes about a minute on two cores.

    The report's numbers are those that `measured` computes from `peer_rows`, our visibility samples per second, and
    the nanoseconds per ray for each size of a growing scene: `growth_ns_1000` to `growth_ns_1000000`.

    Parameters
    ----------
    scale  : below 1, fewer receiver points and polygons; the numbers keep their names
    rounds : turns of every program; the median counts
    say    : function that gets messages about the progress
    """
    notes: list[str] = []

    def tell(text: str) -> None:
        say(text)
        if text.startswith("embreex"):
            notes.append(f"without Embree: {text}")

    say("one step of every light, all programs in turns")
    rows = peer_rows(spacing=min(0.25 / scale, 2.0), rounds=rounds, say=tell)
    numbers = measured(rows)
    for row in rows:
        if row["program"].startswith("shafts"):
            scene = "premesh" if row["scene"] == "office-premesh" else "office"
            threads = "1" if row["program"] == "shafts, 1 thread" else "all"
            numbers[f"million_samples_s_{threads}_{scene}"] = row["million/s"]
    growth = []
    for size in SIZES:
        say(f"growth: {size:,} polygons")
        growth += growth_rows([max(100, round(size * scale))])
        numbers[f"growth_ns_{size}"] = growth[-1]["ns/ray"]
    if scale < 1:
        notes.append(f"at scale {scale:g} the numbers do not mean what they are named after")
    peer = "vs_embree_1_office" in numbers
    claim, holds = judge(CLAIM, RULE, numbers) if peer else (CLAIM, None)
    if peer:
        notes.append(f"all: Embree in {core_count()} processes against shafts on {core_count()} threads")
    return Report(
        name="shaft",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=rows + growth,
        machine=machine("none; on the CPU"),
        versions=versions("glpath", "numpy", "numba", "embreex"),
        notes=list(dict.fromkeys(notes)),
        faults=faults(AGREEMENT, numbers),
    )
