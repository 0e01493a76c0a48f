"""One render by 1, 2 and 4 worker processes of this machine, beside the same in this process.

Each worker has one thread (LP_NUM_THREADS=0 for llvmpipe), so that twice the workers could be twice as fast while
there are cores. Clusters take turns and the median counts; workers have started before, which is timed apart. A
render begins with an engine of its own on every worker, as that of a new scene does.

What it shows: what handing out, carrying and merging cost. What it cannot: networks, other machines, more workers
than cores.

measured:
    process_s, workers_N_s     : seconds of a render: in this process with all its threads; by N workers
    speedup_N                  : of N workers over one
    start_s                    : to start two workers
    merge_s, gather_s          : of the render by two workers: adding films up; bringing them here, beside all else
    part_mb                    : of a chunk's film, as it travels
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

#: Of two workers on two cores; merging is what the one process that all films come to cannot share out.
RULE = (Condition("speedup_2", ">=", 1.7), Condition("merge_s", "<=", 0.5))
_WORKERS = (1, 2, 4)
_SETS, _SIZE = 512, 256


def bench_jobs(scale: float = 1.0, rounds: int = 3, progress: Callable[[str], None] = lambda text: None) -> Report:
    """Time the renders; `scale` shortens them. Raises GlpathError where distributed is missing."""
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
    """Workers that start meanwhile draw with one thread."""
    before = os.environ.get("LP_NUM_THREADS")
    os.environ["LP_NUM_THREADS"] = "0"
    try:
        yield
    finally:
        if before is None:
            del os.environ["LP_NUM_THREADS"]
        else:
            os.environ["LP_NUM_THREADS"] = before
