"""Compute view factors between faces, row by row on all cores; the computation can be resumed.

A facet is a convex part of a face. Each pair of facets is evaluated once, because by reciprocity its exchange area
is the same in both directions. A facet's row has only the facets that follow in the order of the BVH. The other
half of the matrix is the transpose.
"""

from __future__ import annotations

import json
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from glpath.accel import bvh
from glpath.apps.view_factors.backs import back_rays, back_shares, is_closed
from glpath.apps.view_factors.faces import Faces, Geometry, faces_of
from glpath.apps.view_factors.records import Work
from glpath.apps.view_factors.result import ViewFactors
from glpath.apps.view_factors.rows import COUNT_NAMES, Rows, exchange_rows
from glpath.errors import ImageError, UsageError, warn, warning_scope
from glpath.radiosity.memory import require_memory
from glpath.system.arguments import checked, short_repr
from glpath.system.checkpoint import CheckpointFile
from glpath.system.files import check_writable, whole_file
from glpath.system.kernels import announced, waiting
from glpath.system.machine import core_count
from glpath.system.npz import open_npz

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]
Property = Literal["reciprocity", "closure"]

#: Maximum number of rows of a task; small, so that all cores end together and an interruption waits only briefly.
_TASK = 32
#: Time between two reports, seconds.
_REPORT_INTERVAL = 0.1
#: Minimum time between two saves, seconds.
_SAVE_INTERVAL = 20.0
#: Maximum fraction of time spent on saving.
_SAVE_SHARE = 0.05
#: Peak memory per factor in bytes: a value and a column index in both halves of the matrix and in their sum.
_BYTES_PER_FACTOR = 40
#: Excess of a row's sum over 1 that is allowed without a warning.
_OVERLAP = 0.01
#: Size of the matrix in bytes up to which available memory is not checked.
_ASKED = 8 << 20
#: Factor on a row's standard error, as estimated from its visibility points. The estimate is too large, so even
#: multiplied by this factor it is about one and a half true standard errors.
_CAUTION = 0.9
#: Factor on the estimated standard error of a row's back fraction, because rays underestimate this error.
_OF_BACKS = 2.5
#: Width of a strip along a row's perimeter, in units of the rounding length `eps`. Rounding may lose the strip, so
#: its area is added to the row's error. Random rooms, rotated and in 32 bits, never lost more.
_STRIPS = 2e-3
#: Format number of the file that `resume` names; it changes with the file's layout or the method.
_FORMAT = 4


@dataclass(frozen=True)
class ViewFactorProgress:
    """Progress of the matrix, passed to `on_progress`.

    stage       : current stage: "compiling kernels: ...", "preparing", "rows" or "backs"
    done, total : number of facets whose row is finished, and number of all facets
    factors     : number of factors found so far
    bytes       : estimated memory of all factors; 0 until there is an estimate
    """

    stage: str
    done: int
    total: int
    factors: int
    bytes: int
    elapsed_s: float


Report = Callable[[ViewFactorProgress], None]


@dataclass
class _Part:
    """Exchange areas found by some tasks, as entries of one half of the matrix.

    tasks    : (T,) indices of the tasks
    i, j     : row and column of each entry
    exchange : exchange area A F of each entry, in scene units squared
    error    : standard error of each exchange area
    counts   : sums over the tasks of the counts that `COUNT_NAMES` names
    """

    tasks: Int64
    i: NDArray[np.int32]
    j: NDArray[np.int32]
    exchange: NDArray[np.float64]
    error: NDArray[np.float32]
    counts: Int64


class ViewFactorCheckpoint(CheckpointFile):
    """Checkpoint file of the finished rows, which its owner keeps until the matrix is saved.

    `view_factors` sets the interval between two checkpoints.

    with ViewFactorCheckpoint(Path("F.npz.part")) as checkpoint:
        view_factors(faces, resume=checkpoint).save("F.npz")
        checkpoint.remove()
    """

    holder = "a matrix of view factors that resumes from it"
    work = "the matrix"


@checked
def view_factors(
    faces: Any,
    *,
    groups: str | ArrayLike = "faces",
    error: float = 1e-3,
    enforce: Sequence[Property] = (),
    flip: bool = False,
    threads: int | None = None,
    resume: str | Path | ViewFactorCheckpoint | None = None,
    on_progress: Report | None = None,
) -> ViewFactors:
    """Compute the matrix of view factors between the fronts of faces, with all occlusion.

    If shafts prove that two faces are unoccluded, their factor is integrated without rays. Distant faces use Gauss
    points on both faces, as many as `error` requires. Close faces use the double contour integral. If occluders may
    exist, visibility is computed exactly from scrambled Sobol points on the smaller face. The number of points is
    doubled until the spread of their results is below the tolerance. Both sides of a face occlude, but only the
    front sends and receives. Light that arrives at backs is reported as `ViewFactors.backs`, and does not count as
    sky.

    Parameters
    ----------
    faces       : a scene, a mesh file or the name of a shipped scene; a `trimesh.Trimesh`; corners (N, k, 3); or
                  (vertices, faces), with vertices (V, 3) and at least three vertex indices for each face. Faces are
                  flat, with corners counter-clockwise seen from the front. Row i is face i, also of a mesh file;
                  faces of an OBJ are ordered by material. Faces without an area give rows of zeros and a warning
    groups      : meaning of a row: "faces", a face; "planar", coplanar faces that are connected by edges; "shapes",
                  a shape of the scene; or a label for each face, where faces of one label form a row
    error       : target error of each row's sum, 0.1 to 1e-7. In closed rooms 99 of 100 rows meet it, most by a
                  large margin; see `ViewFactors.error` and `statistics["rows_beyond_error"]`. The target of a
                  single factor F, from the smaller of two faces, is error sqrt(F). 99 of 100 partly occluded
                  factors meet it; the error of the worst of thousands is 3 times the target. Factors below the
                  square of `error` may be reported as 0
    enforce     : properties that the result is corrected to have: "reciprocity", "closure", or both, see
                  `ViewFactors.enforced`
    flip        : True if corners are clockwise seen from the front, as for the inside of a model
    threads     : maximum number of threads; None for one per core, which is also the limit
    resume      : checkpoint file for finished rows, written every 20 seconds and on interruption. Another call with
                  the same faces and error resumes from it. It is removed at the end; a `ViewFactorCheckpoint` is
                  removed by the caller. Only one process can use it at a time
    on_progress : function that is called with a `ViewFactorProgress`

    Raises SceneError for faces that are not flat or not finite, if no face has an area, and for infinite planes.
    Raises UsageError for options out of range, and, after some rows, if the matrix would not fit into memory.
    Raises GlpathError if another process uses the file of `resume`. Warns SceneWarning if coinciding faces are both
    visible, or if backs are visible.

    Cost:     about 1 microsecond for an unoccluded pair, some 20 for a partly occluded pair, and 40 bytes of memory
              per factor that is not 0.
    Poor at:  faces that intersect other faces, as the parts inside cause quadrature errors; faces with hundreds of
              small occluders between them, such as leaves of trees.

    Sources: Mitalas & Stephenson 1966; Nishita & Nakamae 1983; Haines & Wallace 1991.

    >>> import numpy as np
    >>> floor, lamp = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]]
    >>> view_factors(np.array([floor, lamp], float)).matrix.toarray().round(4).tolist()
    [[0.0, 0.1998], [0.1998, 0.0]]
    """
    corrections: tuple[str, ...] = (enforce,) if isinstance(enforce, str) else tuple(enforce)
    for word in corrections:
        if not isinstance(word, str) or word not in ("reciprocity", "closure"):
            raise UsageError(
                f"view_factors: enforce {short_repr(word)}; allowed is a list of reciprocity and closure."
            )
    if not (isinstance(error, int | float | np.number) and 1e-7 <= error <= 0.1):
        raise UsageError(f"view_factors: error is {short_repr(error)}; allowed are numbers from 1e-7 to 0.1.")
    if threads is not None and not (isinstance(threads, int | np.integer) and threads >= 1):
        raise UsageError(f"view_factors: threads is {short_repr(threads)}; allowed are whole numbers from 1.")
    if isinstance(resume, str | Path):
        check_writable(resume)
    kept = ViewFactorCheckpoint(Path(resume)) if isinstance(resume, str | Path) else resume
    run = _Run(error, min(threads or core_count(), core_count()), kept, on_progress)
    with warning_scope(strict=False) as scope, ExitStack() as held:
        if kept is not None:
            held.enter_context(kept)
        held.enter_context(announced(waiting(kernels_of()), run.compiling if on_progress is not None else None))
        given = faces_of(faces, groups, flip)
        found = run.solve(given)
        _warn_of_overlaps(found, given.source)
        _warn_of_backs(found, given.source)
        if corrections:
            found = found.enforced(reciprocity="reciprocity" in corrections, closure="closure" in corrections)
        if kept is not None and kept is not resume:
            kept.remove()
    scope.raise_late(found)
    return found


def _warn_of_overlaps(found: ViewFactors, source: str) -> None:
    """Warn if rows add up to more than 1, which coinciding faces cause: none hides the other, so both count."""
    over = found.row_sums - 1
    allowed = np.maximum(max(_OVERLAP, 3 * found.statistics["error"]), 5 * found.error)
    if (too_much := np.flatnonzero(over > allowed)).size:
        i = int(too_much[np.argmax(over[too_much])])
        name = f" ({found.names[i]})" if found.names else ""
        text = (
            f"{source}: {len(too_much):,} of {len(found):,} rows add up to more than 1, row {i}{name} to "
            f"{found.row_sums[i]:.4g}: it sees faces that lie on each other, twice. Leave one of each two out."
        )
        warn(text, late=True)


def _warn_of_backs(found: ViewFactors, source: str) -> None:
    """Warn if backs of faces are visible, because light that arrives there is in no factor and not in `sky`."""
    if (seen := np.flatnonzero(found.backs > np.maximum(found.statistics["error"], found.backs_error))).size:
        i = int(seen[np.argmax(found.backs[seen])])
        name = f" ({found.names[i]})" if found.names else ""
        text = (
            f"{source}: {len(seen):,} of {len(found):,} rows see backs of faces: "
            f"{100 * found.statistics['backs']:.2g} % of what leaves all faces arrives there, of row {i}{name} "
            f"{100 * found.backs[i]:.3g} %. "
            "It is in `backs`, in no factor, and not in the sky. Cut the ground out below solids, close them, give "
            "sheets two sides, or flip what is inside out."
        )
        warn(text, late=True)


def kernels_of() -> tuple[Any, ...]:
    """Return the kernels that `view_factors` calls, so that their compilation can be announced."""
    return (bvh._build, exchange_rows, back_rays)


class _Run:
    """State of one call of `view_factors`."""

    def __init__(
        self, error: float, threads: int, kept: ViewFactorCheckpoint | None, on_progress: Report | None
    ) -> None:
        self.error, self.threads, self.kept, self.on_progress = error, threads, kept, on_progress
        self.started = time.perf_counter()
        self.reported = -math.inf
        self.parts: list[_Part] = []
        self.task = _TASK
        self.bytes = self.granted = 0
        if kept is not None:
            kept.seconds = _SAVE_INTERVAL

    def compiling(self, text: str) -> None:
        self._report(text, 0, 0, True)

    def solve(self, faces: Faces) -> ViewFactors:
        self._report("preparing", 0, 0, True)
        where = Geometry.of(faces)
        total = len(where.facets.sides)
        key = json.dumps([_FORMAT, faces.digest, self.error])
        self.task = max(4, min(_TASK, total // 16))
        tasks = np.arange(-(-total // self.task))
        # Every 16th task comes first, so that the memory of all rows can be estimated early.
        order = np.concatenate([tasks[k::16] for k in (0, *range(1, 16))])
        if self.kept is not None and self.kept.found():
            self.parts = [_read_part(self.kept.path, key, len(tasks), faces.row_count)]
        done = np.isin(order, np.concatenate([np.zeros(0, np.int64), *(part.tasks for part in self.parts)]))
        self.rows_done = min(int(done.sum()) * self.task, total)
        pending = deque(order[~done].tolist())
        self._report("rows", self.rows_done, total, True)
        # Results are passed by a queue instead of futures, whose overhead is as long as some tasks.
        ended: SimpleQueue[_Part | BaseException] = SimpleQueue()
        stop = np.zeros(1, np.int64)

        within = [np.zeros(1, np.int64) for _ in range(min(self.threads, len(pending)))]

        def work(done: Int64) -> None:
            try:
                while (task := _next(pending)) is not None:
                    done[0] = 0
                    if (part := _task(where, faces, task, self.task, self.error, stop, done)) is not None:
                        ended.put(part)
            except BaseException as error:
                ended.put(error)

        running = [Thread(target=work, args=(done,), daemon=True) for done in within]
        left = len(pending)
        try:
            for thread in running:
                thread.start()
            while left:
                try:
                    parts = [_whole(ended.get(timeout=_REPORT_INTERVAL))]
                except Empty:  # no task has ended within the interval; hard tasks take minutes
                    self._report("rows", self.rows_done + sum(int(done[0]) for done in within), total, False)
                    continue
                while not ended.empty():
                    parts.append(_whole(ended.get()))
                left -= len(parts)
                self._take(parts, total)
                self._report("rows", self.rows_done, total, not left)
                if self.kept is not None and self.kept.due(self.rows_done):
                    self._save(self.kept, key)
            if self.kept is not None and running:  # a killed process would lose all rows since the last save
                self._save(self.kept, key)
            backs = back_shares(
                where, is_closed(faces.outlines), self.error, self.threads, stop,
                lambda: self._report("backs", total, total, False),
            )  # fmt: skip
        except BaseException:
            pending.clear()
            stop[0] = 1  # ends rows before they are finished, because hard rows take minutes
            if self.kept is not None:
                _end(running)
                found = [ended.get() for _ in range(ended.qsize())]
                self._count([part for part in found if isinstance(part, _Part)], total)
                self._save(self.kept, key, last=True)
            raise
        finally:
            _end(running)
        return self._result(faces, where, *backs)

    def _count(self, parts: list[_Part], total: int) -> None:
        """Add finished parts to the result."""
        self.parts += parts
        self.rows_done = min(self.rows_done + self.task * len(parts), total)

    def _take(self, parts: list[_Part], total: int) -> None:
        """Add finished parts to the result, and raise GlpathError if the matrix will not fit in memory."""
        self._count(parts, total)
        if len(self.parts) > 256:
            self.parts = [_joined(self.parts)]
        share = self.rows_done / max(total, 1)
        if share > 0.05:
            self.bytes = round(2 * self._factors() / share * _BYTES_PER_FACTOR)
            # The check takes longer than computing some rows, so it is made seldom.
            if self.bytes > max(1.1 * self.granted, _ASKED):
                present = self._factors() * 20
                require_memory(
                    self.bytes - present,
                    f"view_factors: a matrix of about {2 * self._factors() / share:,.0f} factors",
                    "Put faces together (groups), compute parts of the scene apart, or take a larger machine.",
                )
                self.granted = self.bytes

    def _factors(self) -> int:
        return sum(len(part.i) for part in self.parts)

    def _report(self, stage: str, done: int, total: int, now: bool) -> None:
        elapsed = time.perf_counter() - self.started
        if self.on_progress is None or (elapsed < self.reported + _REPORT_INTERVAL and not now):
            return
        self.reported = elapsed
        self.on_progress(ViewFactorProgress(stage, done, total, 2 * self._factors(), self.bytes, elapsed))

    def _save(self, kept: ViewFactorCheckpoint, key: str, last: bool = False) -> None:
        if not self.parts:
            return
        part = _joined(self.parts)
        self.parts = [part]

        def save(path: Path) -> None:
            with whole_file(path) as temporary, open(temporary, "wb") as file:
                np.savez(
                    file, key=np.array(key), tasks=part.tasks, i=part.i, j=part.j, exchange=part.exchange,
                    error=part.error, counts=part.counts,
                )  # fmt: skip

        kept.written_by(save, self.rows_done, last)
        kept.seconds = max(_SAVE_INTERVAL, kept.took / _SAVE_SHARE)

    def _result(self, faces: Faces, where: Geometry, backs: Float64, backs_error: Float64) -> ViewFactors:
        part = _joined(self.parts)
        self.parts.clear()
        n = faces.row_count
        areas = where.areas
        variance = np.zeros(n)
        for at in (part.i, part.j):
            variance += np.bincount(at, part.error.astype(np.float64) ** 2, n)
        error = _CAUTION * np.sqrt(variance) + _STRIPS * where.eps * where.perimeters
        half = sparse.coo_array((part.exchange, (part.i, part.j)), shape=(n, n)).tocsr()
        counts, factors = part.counts, len(part.i)
        del part
        matrix = half + half.T
        del half
        matrix = sparse.csr_array(matrix)
        matrix.data /= np.repeat(areas, np.diff(matrix.indptr))
        matrix.sort_indices()
        statistics: dict[str, Any] = {
            "error": self.error,
            "facets": len(where.facets.sides),
            "occluders": len(where.occluders.sides),
            **dict(zip(COUNT_NAMES, counts.tolist(), strict=True)),
            "factors": 2 * factors,
            "rows_beyond_error": int((error > self.error * areas).sum()),
            "rows_that_see_backs": int((backs > 0).sum()),
            "backs": float(backs @ areas / areas.sum()),
            "backs_max": float(backs.max()),
            "elapsed_s": round(time.perf_counter() - self.started, 4),
        }
        relative = error / np.where(areas > 0, areas, 1.0)
        return ViewFactors(
            matrix, areas, relative, faces.names, statistics, backs, _OF_BACKS * backs_error, *faces.row_geometry()
        )


def _whole(ended: _Part | BaseException) -> _Part:
    if isinstance(ended, BaseException):
        raise ended
    return ended


def _next(pending: deque[int]) -> int | None:
    """Remove and return the next task; None if none is left. A test of the length would race with other threads."""
    try:
        return pending.popleft()
    except IndexError:
        return None


def _end(running: list[Thread]) -> None:
    for thread in running:
        if thread.ident is not None:
            thread.join()


def _task(
    where: Geometry, faces: Faces, task: int, rows: int, error: float, stop: Int64, done: Int64
) -> _Part | None:
    """Compute the rows of one task; return None if `stop` ended it.

    The working memory of a core is allocated for each task, which takes no time compared with the rows.
    """
    total = len(where.facets.sides)
    first, last = task * rows, min((task + 1) * rows, total)
    counts = np.zeros(len(COUNT_NAMES), np.int64)
    work = Work.of(where.eps, len(where.occluders.sides), where.depth, stop, done, counts)
    room = max(2 * total, 4096)
    found = Rows(np.empty(room, np.int32), np.empty(room), np.empty(room, np.float32), np.empty(rows, np.int64))
    i, j, exchange, off = [], [], [], []
    while first < last:
        reached = int(
            exchange_rows(first, last, where.facets, where.tree, where.occluders, float(error), found, work)
        )
        if reached < 0:
            return None
        ends = found.ends[: reached - first]
        size = int(ends[-1])
        i.append(where.row[np.repeat(np.arange(first, reached), np.diff(ends, prepend=0))].astype(np.int32))
        j.append(where.row[found.columns[:size]].astype(np.int32))
        exchange.append(found.values[:size].copy())
        off.append(found.errors[:size].copy())
        first = reached
    part = _Part(
        np.array([task]),
        np.concatenate(i),
        np.concatenate(j),
        np.concatenate(exchange),
        np.concatenate(off),
        counts,
    )
    return _summed(part, faces.row_count) if faces.names else part


def _summed(part: _Part, rows: int) -> _Part:
    """Add up all exchange areas with the same row and column; if rows are groups, few entries remain."""
    keys, which = np.unique(part.i.astype(np.int64) * rows + part.j, return_inverse=True)
    i, j = (keys // rows).astype(np.int32), (keys % rows).astype(np.int32)
    exchange = np.bincount(which, part.exchange, len(keys)).astype(np.float64)
    error = np.sqrt(np.bincount(which, part.error.astype(np.float64) ** 2, len(keys))).astype(np.float32)
    return _Part(part.tasks, i, j, exchange, error, part.counts)


def _joined(parts: list[_Part]) -> _Part:
    def all_of(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    counts = np.sum([part.counts for part in parts], axis=0)
    return _Part(all_of("tasks"), all_of("i"), all_of("j"), all_of("exchange"), all_of("error"), counts)


def _read_part(path: Path, key: str, task_count: int, row_count: int) -> _Part:
    """Read the rows of an earlier call. Raises ImageError for other work, and for values that no call writes."""
    with open_npz(path, "view factors to resume", "Remove it to begin anew.") as arrays:
        if str(arrays.read("key", "U", ())) != key:
            raise ImageError(
                f"{path}: holds rows of other faces, of another error or of another version of glpath.",
                "Remove it to begin anew.",
            )
        tasks, i = arrays.read("tasks", "i", (None,)), arrays.read("i", "i", (None,))
        n = len(i)
        part = _Part(
            tasks, i, arrays.read("j", "i", (n,)), arrays.read("exchange", "f", (n,)),
            arrays.read("error", "f", (n,)), arrays.read("counts", "i", (len(COUNT_NAMES),)),
        )  # fmt: skip
        for name, count in (("tasks", task_count), ("i", row_count), ("j", row_count)):
            values = getattr(part, name)
            if len(values) and not 0 <= values.min() <= values.max() < count:
                raise ValueError(f"`{name}` has {values.min()} to {values.max()}, expected 0 to {count - 1}")
        if len(np.unique(tasks)) != len(tasks):
            raise ValueError("`tasks` has a number twice")
        if not (np.isfinite(part.exchange) & (part.exchange >= 0)).all():
            raise ValueError("`exchange` has values that are negative or not finite")
        return part
