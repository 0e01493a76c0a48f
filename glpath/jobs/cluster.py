"""Distributed rendering on many processes and machines, by Dask distributed (`pip install "glpath[cluster]"`).

    with Cluster("local:4") as cluster:                    # or "tls://scheduler:8786"; see `connection`
        film = glpath.render("cornell-box", spp=4096, cluster=cluster)

The film is bit-identical to that of one process if all devices are of one kind. The scene and a radiosity solution
are sent to each worker once. Path sets are sent in chunks of some seconds (`chunks`), and their films are merged as
they arrive. If a worker is lost, others render its chunks again. A chunk that fails on every worker is reported at
the end, with the film of the other chunks.

Cost:     start of Python, a context and shaders for each worker; network transfer of a film's sums for each chunk,
          24 bytes per pixel and batch of path sets.
Poor at:  short renders, because a worker takes seconds to start; several workers on one graphics card; several
          workers on a machine without a graphics card, because llvmpipe already uses all cores. They are faster
          than one worker only if llvmpipe's single-threaded vertex stage takes most of the time.
"""

from __future__ import annotations

import contextlib
import math
import queue
import time
import uuid
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from glpath.errors import ContextError, GlpathError, TimeLimitError, UsageError, warn
from glpath.film.batches import BLOCK
from glpath.film.bias import BIAS_OBSTACLE, BIAS_PROBE, REJECTED_GATHER
from glpath.film.choices import INTERRUPTED_RULE, TIME_LIMIT
from glpath.film.film import Film
from glpath.film.metadata import merged_values
from glpath.jobs.chunks import Chunk, Chunks, ChunksFailedError
from glpath.jobs.connection import Connection, quiet
from glpath.jobs.worker import Part, Shared, render_part, this_version
from glpath.rendering.bias import SIDE, BiasCheck
from glpath.rendering.factory import Plan, sensor_in
from glpath.rendering.interrupts import RenderInterrupted, interrupt_as_flag
from glpath.rendering.job import RenderJob
from glpath.rendering.loop import Clock, missing
from glpath.rendering.run_options import RunOptions
from glpath.rendering.session import begin, checked_plan, describe_plan, metadata_of, prepare, warn_about
from glpath.rendering.stopping import looked_at
from glpath.scene import Scene
from glpath.system.arguments import checked, short_repr
from glpath.system.heartbeat import heartbeat
from glpath.system.log import log
from glpath.system.time_limit import check_time, preparing, seconds_left, time_is_up

#: Target time of a chunk, seconds: long compared with the transfer of its film, but short, because the chunk of a
#: lost worker is rendered again.
CHUNK_SECONDS = 5.0
# Number of chunks at each worker: one that it renders and one in reserve, so that the worker is never idle.
_AHEAD = 2
# Polling interval of results, seconds.
_TICK_S = 0.25
# Polling interval of the list of workers, seconds.
_LOOK_AROUND_S = 2.0
# Maximum time to transfer a film, seconds.
_GATHER_S = 60.0
# Number of threads that transfer films.
_GATHERERS = 4
# Time for which a lost worker gets no chunks, seconds. The scheduler notices a dead worker late, and a chunk sent
# there would count as a failed attempt.
_SHUN_S = 10.0
# Time without any worker after which a warning is given, seconds.
_SILENCE_S = 10.0


class Cluster(Connection):
    """Cluster of workers, the argument `cluster` of `glpath.render`, `render_frames`, `irradiance` and `lightmap`.

    address, dashboard : arguments of `Connection`, which also describes the errors
    chunk_seconds      : target time of a chunk of path sets on a worker, seconds
    """

    @checked
    def __init__(self, address: str | Path, dashboard: bool = False, chunk_seconds: float = CHUNK_SECONDS) -> None:
        if not 0 < chunk_seconds < math.inf:
            raise UsageError(f"chunk_seconds: {short_repr(chunk_seconds)} where a finite number above 0 is needed")
        self.chunk_seconds = chunk_seconds
        super().__init__(address, dashboard)

    def render(self, job: RenderJob, scene: Scene, options: RunOptions) -> Film:
        """Render a job on all workers. `glpath.rendering.calls.run` calls this method if it is given a cluster.

        `on_step` is called when chunks have been merged. `film.metadata.elapsed_s` and `time_limit` are measured in
        this process; `statistics["worker_s"]` is the sum of the workers' times. With `noise` or `clean` the render
        ends at the same path set as one process.

        Raises
        ------
        ChunksFailedError : if path sets fail on several workers; its film has all other path sets
        ContextError : if the scheduler is gone; the film of the last `on_step` has all merged path sets
        TimeLimitError : if no path set is rendered within `time_limit`
        RenderInterrupted : on Ctrl-C, with the film of all merged path sets

        Other errors are those of `glpath.rendering.calls.run`.
        """
        plan = checked_plan(job, scene).resumed(options.film)
        clock = begin(job, plan, scene, options, None, prepared=False)
        try:
            if not clock.ended_before():
                with preparing():
                    traced = plan.traceable(scene)
                plan = prepare(job, plan, scene, traced, clock)
                plan = _with_small_bias(plan, job, scene, traced, options, clock)
                shared = Shared(uuid.uuid4().hex, job, scene, plan, options.for_workers(), this_version())
                _Render(self, shared, clock).run()
        except TimeLimitError:
            if not clock.film.path_sets:
                raise
            clock.end_as_begun(TIME_LIMIT)
        except (RenderInterrupted, ChunksFailedError):
            warn_about(clock.film, plan)
            raise
        warn_about(clock.film, plan)
        return clock.film


def _with_small_bias(
    plan: Plan, job: RenderJob, scene: Scene, traced: Scene, options: RunOptions, clock: Clock
) -> Plan:
    """Return the prepared plan, or a replacement if its bias is too large.

    The bias is measured in this process, once for all workers. If this process has no usable device, the result is
    a plan without bias if the job allows one.
    """
    if clock.film.metadata.statistics.keys() & {BIAS_PROBE, REJECTED_GATHER} or not plan.settings.biased:
        return plan
    sensor = sensor_in(traced, job.sensor, scene).reduced(SIDE)
    window = (0, 0, *sensor.resolution)
    try:
        context = options.context()
        with interrupt_as_flag() as interrupted, context.rendering():
            began = time.perf_counter()
            with context:
                engine = plan.engine(context, traced, sensor, window, options.timings).prepare()
            took = time.perf_counter() - began
            check = BiasCheck(context, traced, sensor, window, options.timings, clock.report, interrupted, took)
            plan, engine = check.settle(plan, engine)
            with context:
                engine.close()
    except KeyboardInterrupt:
        raise clock.interruption() from None
    except ContextError as error:
        unbiased, obstacle = plan.without_bias(), "the bias of the gather cannot be measured here"
        if unbiased is None:
            clock.statistics[BIAS_OBSTACLE] = f"{obstacle}: {error.message.rstrip('.')}"
        else:
            log.warning("%s: %s", obstacle, error.message)
            plan = unbiased
    else:
        if interrupted:  # the check does not test the flag while it replaces an engine
            raise clock.interruption(interrupted.signal)
        clock.statistics |= check.statistics or {}
    describe_plan(clock.film, metadata_of(job, plan, scene, None))
    return plan


@dataclass(frozen=True)
class _Task:
    """Chunk with the address of the worker that has it."""

    chunk: Chunk
    worker: str


@dataclass
class _Render:
    """State of one render on a cluster, from the first chunk to the last."""

    cluster: Cluster
    shared: Shared
    clock: Clock
    _counts: dict[str, Any] = field(default_factory=dict)
    _events: queue.SimpleQueue[Any] = field(default_factory=queue.SimpleQueue)
    _gatherers: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(_GATHERERS, "gather"))
    _running: dict[Any, _Task] = field(default_factory=dict)
    _warned: set[str] = field(default_factory=set)  # texts of workers' warnings already given
    _parts: dict[int, Film] = field(default_factory=dict)  # films not merged yet, by first path set
    _order: list[int] = field(default_factory=list)  # first path sets of chunks that are handed out, but not merged
    _reasons: dict[int, str] = field(default_factory=dict)  # reasons of failures by first path set
    _workers: list[str] = field(default_factory=list)
    _dead: dict[str, float] = field(default_factory=dict)  # time at which each worker was lost
    _number: int = 0
    _merging: float = 0.0  # seconds to merge the last film

    def run(self) -> None:
        """Render the missing path sets into the clock's film. Raises the errors that `Cluster.render` lists."""
        film = self.clock.film
        chunks = Chunks(
            missing(self.shared.job.path_sets, film.ranges),
            self.cluster.chunk_seconds,
            partial(looked_at, self.clock.options),
            film.path_sets,
            first=BLOCK if seconds_left() == math.inf else 1,  # a block may take longer than the time limit
        )
        rule = INTERRUPTED_RULE
        with interrupt_as_flag() as interrupted:
            # A second Ctrl-C may interrupt `_cancel`.
            with contextlib.suppress(KeyboardInterrupt):
                try:
                    self.cluster.share(self.shared)
                    rule = self._fill(chunks, interrupted)
                finally:
                    self._cancel()
            self._finish(rule)
        if not rule:
            raise self._failed(chunks)
        if interrupted or rule == INTERRUPTED_RULE:
            raise RenderInterrupted(film, interrupted.signal)

    def _fill(self, chunks: Chunks, interrupted: Any) -> str:
        """Hand out chunks and merge films; return the rule that ended the render, or "" if path sets failed."""
        last_look = -_LOOK_AROUND_S
        alone_since = time.monotonic()
        warned = False
        while True:
            if interrupted:
                raise KeyboardInterrupt
            self.cluster.check()
            now = time.monotonic()
            if now - last_look >= _LOOK_AROUND_S:
                self._look_around(chunks)
                last_look = now
            if self._workers:
                alone_since = now
            elif now - alone_since > _SILENCE_S and not warned:
                log.warning("cluster %s: no worker is there; waiting for one", self.cluster.address)
                warned = True
            if not self._workers:
                heartbeat.beat()  # waiting for workers does not count as hanging
            self._hand_out(chunks)
            if chunks.over:
                self._merge(list(self._parts))
                return self._ended() if not chunks.failed else ""
            self._take(chunks)
            merged, rule = False, ""
            while not rule and (starts := self._ready()):
                with interrupted.whole():
                    self._merge(starts)
                merged, rule = True, self._ended()
            if merged or (rule := self._ended()):
                self._tell(rule)
            if rule:
                return rule

    def _ended(self) -> str:
        """Return the rule that ends the render, or "". Raises TimeLimitError if time is over without a path set."""
        film = self.clock.film
        if not film.path_sets:
            check_time("workers render the first path sets")
            return ""
        return self.clock.ended(all(stop % BLOCK == 0 for _, stop in film.ranges))

    def _hand_out(self, chunks: Chunks) -> None:
        """Give each worker a chunk to render and one in reserve. Give a late chunk also to an idle worker."""
        load = Counter(task.worker for task in self._running.values())
        for waiting in range(_AHEAD):
            for worker in self._workers:
                if load[worker] == waiting and (chunk := chunks.next(len(self._workers))) is not None:
                    self._submit(chunk, worker)
                    load[worker] += 1
        for worker in self._workers:
            if not load[worker] and (late := chunks.straggler()) is not None:
                self._submit(late, worker)

    def _submit(self, chunk: Chunk, worker: str) -> None:
        start, stop = chunk.path_sets
        if start not in self._parts and start not in self._order:
            self._order.append(start)
        self._number += 1
        future = self.cluster.client.submit(
            render_part,
            self.shared.token,
            chunk.path_sets,
            key=f"glpath-{self.shared.token[:8]}-{start}-{stop}-{self._number}",
            pure=False,
            workers=[worker],
        )
        self._running[future] = _Task(chunk, worker)
        future.add_done_callback(self._gather_later)

    def _gather_later(self, future: Any) -> None:
        with contextlib.suppress(RuntimeError):  # after the render, `_gatherers` accepts no more work
            self._gatherers.submit(self._gather, future)

    def _gather(self, future: Any) -> None:
        """Transfer a result in a thread, so that a hanging worker blocks only that thread."""
        began, found = time.perf_counter(), None
        try:
            if future.status == "finished":
                found = future.result(timeout=_GATHER_S)
        except Exception as error:
            found = error
        self._events.put((future, found, time.perf_counter() - began))

    def _take(self, chunks: Chunks) -> None:
        """Process all results that have arrived; wait up to `_TICK_S` for the first."""
        with contextlib.suppress(queue.Empty):
            self._take_one(chunks, *self._events.get(timeout=_TICK_S))
            while True:
                self._take_one(chunks, *self._events.get_nowait())

    def _take_one(self, chunks: Chunks, future: Any, found: Part | Exception | None, took: float) -> None:
        task = self._running.pop(future, None)
        if task is None:  # another copy of the chunk came first, or its worker was given up
            return
        heartbeat.beat()
        if found is None:
            self._lost(chunks, task, future)
        elif isinstance(found, Exception):  # the transfer failed, for example because the worker was lost
            self._fail(chunks, task, found)
        elif chunks.done(task.chunk, found.seconds):
            self._count("gather_s", took)
            chunks.take_cost(took / _GATHERERS + self._merging)
            for other in [f for f, t in self._running.items() if t.chunk is task.chunk]:
                del self._running[other]
                other.cancel(force=True)
            self._parts[task.chunk.path_sets[0]] = found.film
            for text in found.warnings:
                if text not in self._warned:
                    self._warned.add(text)
                    warn(text, late=True)

    def _ready(self) -> list[int]:
        """Return the first path set of each chunk to merge now.

        If a stop rule checks the film, chunks are merged in order, one at a time. Otherwise all chunks that have
        arrived are merged.
        """
        if self.clock.options.noise is None and self.clock.options.clean is None:
            return list(self._parts)
        return [first] if self._order and (first := min(self._order)) in self._parts else []

    def _merge(self, starts: list[int]) -> None:
        began = time.perf_counter()
        for start in starts:
            part = self._parts.pop(start)
            self._order.remove(start)
            elapsed, statistics = part.metadata.elapsed_s, part.metadata.statistics
            part.metadata = replace(part.metadata, elapsed_s=0.0, statistics={})
            self.clock.film.include(part)
            self._counts = merged_values(self._counts, {**statistics, "worker_s": elapsed, "chunks": 1})
        took = time.perf_counter() - began
        self._count("merge_s", took)
        self._merging = took / max(1, len(starts))

    def _count(self, name: str, value: Any) -> None:
        self._counts = merged_values(self._counts, {name: value})

    def _lost(self, chunks: Chunks, task: _Task, future: Any) -> None:
        error = None
        with contextlib.suppress(Exception):
            error = future.exception(timeout=_GATHER_S)
        if isinstance(error, GlpathError) and not isinstance(error, ContextError):
            raise error  # the chunk would fail on all workers
        if type(error).__name__ == "KilledWorker":  # the error's long text would only describe Dask
            error = None
        if error is None:
            self._dead[task.worker] = time.monotonic()
            self._workers = [worker for worker in self._workers if worker != task.worker]
        self._fail(chunks, task, error)

    def _look_around(self, chunks: Chunks) -> None:
        """Update the list of workers, and hand out the chunks of lost workers again."""
        if not self.cluster.connected:
            return  # because a call would wait for Dask's long timeout
        try:
            recent = time.monotonic() - _SHUN_S
            self._workers = [w for w in self.cluster.workers() if self._dead.get(w, -math.inf) < recent]
        except Exception as error:
            if time_is_up():  # the limit cut the wait for the answer short; `_ended` ends the render
                return
            raise ContextError(
                f"cluster {self.cluster.address}: the scheduler is gone: {error}.",
                "Start it again; a render that has kept its film resumes from there.",
            ) from error
        for future in [f for f, task in self._running.items() if task.worker not in self._workers]:
            if future.status == "pending":
                task = self._running.pop(future)
                future.cancel(force=True)
                self._fail(chunks, task, None)
        many = f"{len(self._workers)} worker{'' if len(self._workers) == 1 else 's'}"
        self.clock.renderer = f"{many}: {self.clock.film.metadata.device}" if self.clock.film.path_sets else many

    def _fail(self, chunks: Chunks, task: _Task, error: BaseException | None) -> None:
        start, stop = task.chunk.path_sets
        lines = [f"the worker {task.worker} was lost"]
        if error is not None:  # an error without a text is described by its type
            lines = str(error).splitlines() or [type(error).__name__]
        log.warning("path sets %d to %d: %s", start, stop - 1, "\n".join(lines))
        self._reasons[start] = lines[0]
        chunks.fail(task.chunk)

    def _tell(self, rule: str) -> None:
        if self.clock.options.on_step is not None:
            self._finish("")
            self.clock.options.on_step(self.clock.film)
        self.clock.report("rendering", bool(rule))

    def _finish(self, rule: str) -> None:
        self.clock.finish(self, rule)

    def statistics(self) -> dict[str, object]:
        """Return the statistics of workers and merging; `Clock.finish` calls this method as for an engine."""
        return self._counts

    def _cancel(self) -> None:
        with quiet(), contextlib.suppress(Exception):
            self.cluster.client.cancel(list(self._running), force=True)
        self._running.clear()
        # Delete the shared data in a thread. Do not wait for the thread, because a worker may hang.
        self._gatherers.submit(self.cluster.forget, self.shared)
        self._gatherers.shutdown(wait=False)

    def _failed(self, chunks: Chunks) -> ChunksFailedError:
        ranges = ", ".join(f"{c.path_sets[0]}:{c.path_sets[1]}" for c in chunks.failed)
        reason = self._reasons[chunks.failed[0].path_sets[0]]
        return ChunksFailedError(
            f"cluster: path sets {ranges} failed on every worker that tried: {reason}",
            "All others are in the film. The workers' own logs say more; a render of such a range alone shows it.",
            self.clock.film,
        )
