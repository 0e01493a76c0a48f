"""The loop of a render: path sets into a film, in steps short enough for Ctrl-C and for progress."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glpath.errors import ContextError
from glpath.film.batches import BLOCK, blocks
from glpath.film.choices import INTERRUPTED_RULE, SPP, TIME_LIMIT
from glpath.film.film import Film
from glpath.film.metadata import merged_values
from glpath.gl.context import Context
from glpath.gl.memory import OUT_OF_MEMORY
from glpath.integrators.engine import Engine
from glpath.rendering.factory import Counts
from glpath.rendering.interrupts import Flag, RenderInterrupted, interrupt_as_flag
from glpath.rendering.progress import Progress
from glpath.rendering.run_options import RunOptions
from glpath.rendering.stopping import ended_by, first_look
from glpath.rendering.tiles import Tile
from glpath.system.heartbeat import heartbeat
from glpath.system.time_limit import seconds_left, time_is_up

# How long one step may take: Ctrl-C and the progress wait for its end.
_STEP_SECONDS = 0.5


def trace(engine: Engine, context: Context, tiles: list[Tile], clock: Clock, path_sets: tuple[int, int]) -> None:
    """Fill the clock's film with what it lacks of the path sets, in steps between which the context is free.

    Raises RenderInterrupted; ContextError where the device fails, and what was added by then is sound.
    """
    with interrupt_as_flag() as interrupted:
        try:
            rule = _trace(engine, context, tiles, clock, path_sets, interrupted)
        except KeyboardInterrupt:
            # The flag's, or a second Ctrl-C that broke into a step: the film holds the steps before it.
            clock.finish(engine, INTERRUPTED_RULE)
            raise RenderInterrupted(clock.film, interrupted.signal) from None
        clock.finish(engine, rule)
    if interrupted:  # after the last step, too late for the loop to see
        raise RenderInterrupted(clock.film, interrupted.signal)


def _trace(
    engine: Engine,
    context: Context,
    tiles: list[Tile],
    clock: Clock,
    path_sets: tuple[int, int],
    interrupted: Flag,
) -> str:
    """The rule that ended it. Raises KeyboardInterrupt where the flag is set."""
    film, rule = clock.film, ""
    for start, stop in missing(path_sets, film.ranges):
        while start < stop and not rule and not interrupted:
            with context:
                clock.begin_step()
                count = _step(engine, context, tiles, film, start, min(stop - start, clock.step), interrupted)
            start += count
            clock.count_step(count)
            # Before anything is reported, as the last report is the one that says it is done.
            rule = clock.ended(start == stop)
            clock.stepped(engine, bool(rule))
        if rule:  # the last step: after an interrupt the film is complete, too
            break
        if interrupted:
            raise KeyboardInterrupt
    return rule


def missing(path_sets: tuple[int, int], ranges: tuple[tuple[int, int], ...]) -> Iterator[tuple[int, int]]:
    """What of the path sets is in none of the ranges, which are in order; cut where the batch changes."""
    start, end = path_sets
    for done_start, done_stop in (*ranges, (end, end)):
        yield from blocks(start, min(done_start, end))
        start = max(start, done_stop)


def _check_device(context: Context) -> None:
    """Raise ContextError where the device has lost what it was doing."""
    error = context.gl.error
    if error == "GL_NO_ERROR":
        return
    remedy = "Start it again; what the driver says (dmesg, nvidia-smi) may tell why."
    if error == "GL_OUT_OF_MEMORY":
        remedy = OUT_OF_MEMORY
    raise ContextError(
        f"{context.info.renderer}: {error} while path sets were traced; the device has failed.", remedy
    )


@dataclass
class Clock:
    """The clock of one render: how long a step may be, when to report, and when it is enough.

    film    : that grows; what it held before the render is counted in `elapsed` and in the statistics
    total   : path sets in the film when all are done
    options : of the run; `on_step` is called when the film's metadata are up to date
    """

    film: Film
    total: int
    renderer: str
    options: RunOptions
    step: int = 1
    statistics: dict[str, object] = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)
    _last_step: float = field(default_factory=time.perf_counter)
    _last_report: float = -math.inf
    _error: float | None = None
    _bound: float | None = None
    _look_s: float = 0.0

    def __post_init__(self) -> None:
        self._before = self.film.metadata

    @property
    def elapsed(self) -> float:
        """Seconds of rendering, with those that the film has come with."""
        return self._before.elapsed_s + time.perf_counter() - self.started

    def ended(self, at_block: bool) -> str:
        """The rule that ends the render after a step; "" for none.

        at_block : the step was the last one of a block, so that batches can be compared
        """
        if self.film.path_sets >= self.total:
            return SPP
        if time_is_up():
            return TIME_LIMIT
        # A look that denoises takes seconds: none is begun that would end after the limit.
        if at_block and self._look_s < seconds_left():
            began = time.perf_counter()
            rule, bound = ended_by(self.film, self.options)
            self._look_s = time.perf_counter() - began
            self._bound = self._bound if bound is None else bound
            if rule:
                return rule
        return TIME_LIMIT if time_is_up() else ""

    def ended_before(self) -> bool:
        """Whether a film that is resumed is done already."""
        if not self.film.path_sets:
            return False
        at_block = all(stop % BLOCK == 0 for _, stop in self.film.ranges)
        rule = self.ended(at_block)
        if rule:
            self.end_as_begun(rule)
        return bool(rule)

    def end_as_begun(self, rule: str) -> None:
        """End with the path sets that the film has come with."""
        self.film.metadata = replace(self._before, stop_rule=rule, error_bound=self._bound)
        self.report("rendering", ended=True)

    def report(self, stage: str, ended: bool = False) -> None:
        heartbeat.beat()
        if self.options.on_progress is None:
            return
        done, now = self.film.path_sets, time.perf_counter()
        last = ended or done == self.total
        if not last and now - self._last_report < _STEP_SECONDS:
            return
        if done:
            self._error = self.film.relative_error()
        self.options.on_progress(
            Progress(
                done,
                done if last else self._expected(),
                now - self.started,
                self._error,
                self.film,
                stage,
                self.renderer,
            )
        )
        # The estimate reads the whole film, an image has to be encoded; that must not be what the time goes into.
        self._last_report = now + 5 * (time.perf_counter() - now)

    def begin_step(self) -> None:
        """A step begins: what went by since the last one was spent waiting, or in callbacks of progress."""
        self._last_step = time.perf_counter()

    def _expected(self) -> int:
        """Path sets in the end, as far as the rules let guess: the error falls with the root of their number."""
        done, guesses = self.film.path_sets, [float(self.total)]
        if done and math.isfinite(left := seconds_left()):
            guesses.append(done * (1.0 + max(left, 0.0) / max(self.elapsed, 1e-9)))
        limit = self.options.noise or self.options.clean
        if limit is not None:
            known = self._bound is not None and done
            guesses.append(done * ((self._bound or 0) / limit) ** 2 if known else first_look(self.options))
        return min(self.total, max(done + 1, round(min(guesses))))

    def count_step(self, count: int) -> None:
        """A step of so many path sets is done; the next is as long as fits into the time for one."""
        each = (time.perf_counter() - self._last_step) / count
        self.step = max(1, min(BLOCK, int(min(_STEP_SECONDS, seconds_left()) / max(each, 1e-9))))

    def stepped(self, engine: Engine, ended: bool) -> None:
        """Tell of a step; ended: it was the last one."""
        if self.options.on_step is not None:
            self.finish(engine, "")
            self.options.on_step(self.film)
        self.report("rendering", ended)

    def finish(self, engine: Counts, rule: str) -> None:
        """Bring the film's metadata up to date, of which the statistics are known only now."""
        counts = self.statistics | engine.statistics()
        self.film.metadata = replace(
            self.film.metadata,
            elapsed_s=self.elapsed,
            statistics=merged_values(self._before.statistics, counts),
            stop_rule=rule,
            error_bound=self._bound,
        )


def _step(
    engine: Engine,
    context: Context,
    tiles: list[Tile],
    film: Film,
    start: int,
    count: int,
    interrupted: Flag,
) -> int:
    """Trace path sets start..start + count in every tile and add them to the film. Returns how many it were.

    When interrupted in the first tile, the others follow as far as that one came.
    """
    total = np.zeros(film.radiance_sums.shape[1:])
    aovs: dict[str, NDArray[Any]] = {}
    for tile in tiles:
        engine.look_at(tile.window)
        traced = 0
        while traced < count:
            engine.trace_path_set(start + traced)
            heartbeat.beat()
            traced += 1
            if interrupted and tile is tiles[0]:
                break
        count = traced
        total[tile.target] = engine.take()[tile.keep]
        for name, found in engine.take_aovs().items():
            if name not in aovs:
                aovs[name] = np.zeros((*total.shape[:2], found.shape[2]), found.dtype)
            aovs[name][tile.target] = found[tile.keep]
    _check_device(context)  # before its sums can reach the film
    with interrupted.whole():
        film.add(start, start + count, total, aovs)
    return count
