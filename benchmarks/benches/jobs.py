"""Render by 1, 2 and 4 worker processes of this machine, compared with the same render in this process.

Each worker has one thread (LP_NUM_THREADS=0 for llvmpipe), so twice the workers can be twice as fast if there are
enough cores. Clusters take turns, and the median counts. The start of workers is timed separately. Each render
begins with a new engine on every worker, as for a new scene.

The bench shows the cost of distributing, transferring and merging. It does not show networks, other machines, or
more workers than cores.

measured:
    process_s, workers_N_s     : seconds of a render in this process with all its threads, and by N workers
    speedup_N                  : time of one worker divided by that of N workers
    start_s                    : seconds to start two workers
    merge_s, gather_s          : for two workers: seconds to add up films, and to transfer them beside all else
    part_mb                    : size of a chunk's film in transfer
"""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial

import numpy as np

from benchmarks.timing import in_turns, seconds_of
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.film.batches import BATCHES, BLOCK
from glpath.film.film import Film
from glpath.gl.context import get_context
from glpath.jobs.cluster import Cluster
from glpath.rendering import RenderJob, run
from glpath.system.machine import core_count
from glpath.system.versions import versions

#: Limits for two workers on two cores. One process merges all films, and this work cannot be distributed.
RULE = (Condition("speedup_2", ">=", 1.7), Condition("merge_s", "<=", 0.5))
_WORKERS = (1, 2, 4)
_SETS, _SIZE = 512, 256


def bench_jobs(scale: float = 1.0, rounds: int = 3, progress: Callable[[str], None] = lambda text: None) -> Report:
    """Time the renders; `scale` shortens them. Raises GlpathError if distributed is missing."""
    spp = max(2 * BLOCK * BATCHES, round(_SETS * scale))
    side = max(32, round(_SIZE * scale**0.5))
    job = RenderJob.of("cornell-box-36", spp=spp, resolution=(side, side))
    films: dict[str, list[Film]] = {}

    def render(name: str, cluster: Cluster | None) -> float:
        begun: list[Film] = []
        took = seconds_of(lambda: begun.append(run(job, cluster=cluster)))
        films.setdefault(name, []).extend(begun)
        return took

    with ExitStack() as until_done:
        started = {}
        contestants = {"process": partial(render, "process", None)}
        until_done.enter_context(_one_thread_each())
        for count in _WORKERS:
            progress(f"{count} workers start")
            before = time.perf_counter()
            cluster = until_done.enter_context(Cluster(f"local:{count}"))
            started[count] = time.perf_counter() - before
            contestants[f"workers_{count}"] = partial(render, f"workers_{count}", cluster)
        progress("each once, for shaders and kernels")
        in_turns(contestants, 1)
        progress(f"{rounds} turns of {spp} path sets of {side} x {side}")
        seconds = in_turns(contestants, rounds)
    one = seconds["workers_1"]
    two = [film.metadata.statistics for film in films["workers_2"]]
    part = run(RenderJob.of("cornell-box-36", spp=BLOCK * BATCHES, resolution=(side, side)))
    measured = {f"{name}_s": took for name, took in seconds.items()}
    measured |= {f"speedup_{count}": one / seconds[f"workers_{count}"] for count in _WORKERS[1:]}
    measured |= {"start_s": started[2]}
    measured |= {name: float(np.median([each[name] for each in two])) for name in ("merge_s", "gather_s")}
    measured |= {"part_mb": len(pickle.dumps(part)) / 1e6}
    claim, holds = judge("two workers render nearly twice as much as one, and merging is cheap", RULE, measured)
    cores = core_count()
    first = films["process"][0]
    return Report(
        "jobs",
        claim,
        measured,
        holds if cores > 1 else None,
        rows=[
            {
                "workers": count,
                "seconds": seconds[f"workers_{count}"],
                "speedup": one / seconds[f"workers_{count}"],
                "start_s": started[count],
                "chunks": films[f"workers_{count}"][-1].metadata.statistics["chunks"],
                "worker_s": films[f"workers_{count}"][-1].metadata.statistics["worker_s"],
            }
            for count in _WORKERS
        ],
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "distributed", "moderngl", "numpy"),
        notes=[f"{cores} cores here: more workers than that show what sharing out costs, not what it gains"],
        faults=[
            f"{name}: its film has other bits than the first of one process"
            for name, each in films.items()
            if not all(np.array_equal(film.radiance_sums, first.radiance_sums) for film in each)
        ],
    )


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Context in which new workers render with one thread."""
    before = os.environ.get("LP_NUM_THREADS")
    os.environ["LP_NUM_THREADS"] = "0"
    try:
        yield
    finally:
        if before is None:
            del os.environ["LP_NUM_THREADS"]
        else:
            os.environ["LP_NUM_THREADS"] = before
