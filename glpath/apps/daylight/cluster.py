"""Computation of daylight coefficients on a cluster, with the sensors divided into shards.

The scene and all sensors go to each worker once. If a worker is lost, another computes its shard. The merged result
is bit-identical to that of one process if all devices are of one kind.

Cost:     start of Python and a context for each worker; each shard computes the radiosity solution again.
Poor at:  few sensors; several workers on a machine without a graphics card, because one uses all cores already.
"""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.apps.daylight.checkpoint import DaylightCheckpoint
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.kept_shards import KeptShards
from glpath.apps.daylight.merging import together
from glpath.errors import ContextError, GlpathError, collected_warnings, warn
from glpath.jobs.connection import Connection, quiet
from glpath.jobs.worker import check_version, held, this_version
from glpath.rendering.interrupts import interrupt_as_flag
from glpath.scene import Scene
from glpath.system.heartbeat import heartbeat
from glpath.system.log import log

Float64 = NDArray[np.float64]


# Number of shards per worker: few, because each shard computes the solution again, but more than one, because
# machines differ in speed.
_SHARDS_A_WORKER = 2
# Maximum number of attempts for a shard.
_TRIES = 3
# Polling interval, seconds.
_TICK_S = 0.25
# Time without workers after which a warning is given, seconds.
_SILENCE_S = 10.0


@dataclass(frozen=True, eq=False)
class DaylightWork:
    """Data that all shards of a computation need, sent to each worker once.

    points, normals : (N, 3) of all sensors
    options : options of `daylight_coefficients`
    compute : `daylight_coefficients`
    token   : identifier of the computation
    version : version of glpath, which must equal the worker's
    """

    scene: Scene
    points: Float64
    normals: Float64
    options: dict[str, Any]
    compute: Callable[..., DaylightCoefficients]
    token: str = field(default_factory=lambda: uuid.uuid4().hex)
    version: str = field(default_factory=this_version)


def computed_by(
    cluster: Connection,
    shared: DaylightWork,
    work: str,
    resume: DaylightCheckpoint | None,
    report: Callable[[int, int], None],
) -> DaylightCoefficients:
    """Return the result of `daylight_coefficients`, computed by the workers of a cluster.

    work   : digest of the computation, as in `Shard`
    resume : checkpoint whose path is the folder of finished shards; the caller locks and removes it
    report : called with the number of finished shards and their total

    Raises the errors of `daylight_coefficients`, and ContextError if a shard fails on several workers or the
    scheduler is gone.
    """
    count = max(1, min(len(shared.points), _SHARDS_A_WORKER * max(1, len(cluster.workers()))))
    kept = None if resume is None else KeptShards(resume.path, work, count, len(shared.points))
    found = {} if kept is None else kept.read()
    count = count if kept is None else kept.count
    shards = _Shards(cluster, shared, count, [k for k in range(1, count + 1) if k not in found])
    try:
        cluster.share(shared)
        report(len(found), count)
        for number, part in shards.come():
            found[number] = part
            if kept is not None:
                kept.keep(found)
            report(len(found), count)
    except BaseException:
        if kept is not None:
            kept.keep(found, last=True)
            assert resume is not None, "shards are kept"
            resume.take_failure(kept)
        raise
    finally:
        shards.cancel()
    return together([found[number] for number in sorted(found)])


class _Shards:
    """Shards of one computation on the workers of a cluster. A shard is a range of the sensors."""

    def __init__(self, cluster: Connection, shared: DaylightWork, count: int, wanted: list[int]) -> None:
        self._cluster, self._shared, self._count, self._wanted = cluster, shared, count, wanted
        self._running: dict[Any, int] = {}
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._tries: Counter[int] = Counter()
        self._warned: set[str] = set()  # texts of workers' warnings that were given already

    def come(self) -> Iterator[tuple[int, DaylightCoefficients]]:
        """Yield the index (from 1) and the coefficients of each missing shard, in order of arrival."""
        for number in self._wanted:
            self._submit(number)
        alone_since: float | None = time.monotonic()
        with interrupt_as_flag() as interrupted:
            while self._running:
                if interrupted:
                    raise KeyboardInterrupt
                self._cluster.check()
                with contextlib.suppress(queue.Empty):
                    future = self._done.get(timeout=_TICK_S)
                    alone_since = None
                    number = self._running.pop(future)
                    part = self._result(future, number)
                    if part is None:
                        self._submit(number)
                    else:
                        yield number, part
                heartbeat.beat()
                if alone_since is not None and time.monotonic() - alone_since > _SILENCE_S:
                    alone_since = None
                    if not self._cluster.workers():
                        log.warning("cluster %s: no worker is there; waiting for one", self._cluster.address)
        if interrupted:  # the signal came during the last shard
            raise KeyboardInterrupt

    def cancel(self) -> None:
        """Cancel all shards that workers still have."""
        with quiet(), contextlib.suppress(Exception):
            self._cluster.client.cancel(list(self._running), force=True)
        with contextlib.suppress(Exception):
            self._cluster.forget(self._shared)

    def _submit(self, number: int) -> None:
        future = self._cluster.client.submit(
            compute_shard,
            self._shared.token,
            (number, self._count),
            key=f"glpath-{self._shared.token[:8]}-{number}-{self._tries[number]}",
            pure=False,
        )
        self._running[future] = number
        future.add_done_callback(self._done.put)

    def _result(self, future: Any, number: int) -> DaylightCoefficients | None:
        """Return a shard's coefficients, or None if it must be tried again. Raises the worker's error."""
        try:
            found, texts = future.result(timeout=_SILENCE_S * 6)
            assert isinstance(found, DaylightCoefficients), "what compute_shard returns"
        except Exception as error:
            if isinstance(error, GlpathError) and not isinstance(error, ContextError):
                raise  # each worker would fail with the same error
            self._tries[number] += 1
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            if type(error).__name__ == "KilledWorker":  # the error's text would describe Dask's internals
                reason = "its worker was lost"
            log.warning("shard %d of %d: %s", number, self._count, reason)
            if self._tries[number] >= _TRIES:
                raise ContextError(
                    f"cluster: shard {number} of {self._count} failed {_TRIES} times: {reason}",
                    "The workers' own logs say more; `shard` computes one alone.",
                ) from error
            return None
        for text in texts:
            if text not in self._warned:
                self._warned.add(text)
                warn(text, late=True)
        return found


def compute_shard(token: str, shard: tuple[int, int]) -> tuple[DaylightCoefficients, list[str]]:
    """Compute a shard, the k-th of n, of the work with this token in a worker.

    Returns the coefficients, and the texts of warnings.
    """
    with held(token) as shared, collected_warnings() as texts:
        assert isinstance(shared, DaylightWork), "what computed_by shares"
        check_version(shared.version)
        found = shared.compute(shared.scene, shared.points, shared.normals, **shared.options, shard=shard)
    return found, list(texts)
