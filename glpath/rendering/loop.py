"""Loop of a render, which adds path sets to a film in steps short enough for Ctrl-C and progress."""

from __future__ import annotations

import math
import signal
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
from glpath.gl.memory import out_of_memory_remedy
from glpath.integrators.engine import Engine
from glpath.rendering.factory import Counts
from glpath.rendering.interrupts import Flag, RenderInterrupted, interrupt_as_flag
from glpath.rendering.progress import Progress
from glpath.rendering.run_options import RunOptions
from glpath.rendering.stopping import ended_by, first_look, looked_at
from glpath.rendering.tiles import Tile
from glpath.system.heartbeat import heartbeat
from glpath.system.machine import core_count
from glpath.system.time_limit import seconds_left, time_is_up

# Maximum time of one step, seconds; Ctrl-C and the progress wait for its end.
_STEP_SECONDS = 0.5
# Estimated time of the first look that denoises, seconds per pixel and core, see `glpath.film.denoise`.
_LOOK_S_PER_PIXEL = 0.2 / 256**2


def trace(engine: Engine, context: Context, tiles: list[Tile], clock: Clock, path_sets: tuple[int, int]) -> None:
    """Add the missing path sets to the clock's film in steps; between steps, other threads can use the context.

    Raises RenderInterrupted. Raises ContextError if the device fails; the film remains valid.
    """
    with interrupt_as_flag() as interrupted:
        try:
            rule = _trace(engine, context, tiles, clock, path_sets, interrupted)
        except KeyboardInterrupt:
            # The loop raised it because the flag is set, or a second Ctrl-C raised it within a step. The film holds
            # all complete steps.
            clock.finish(engine, INTERRUPTED_RULE)
            raise RenderInterrupted(clock.film, interrupted.signal) from None
        clock.finish(engine, rule)
    if interrupted:  # the flag was set after the loop's last check of it
        raise RenderInterrupted(clock.film, interrupted.signal)


def _trace(
    engine: Engine,
    context: Context,
    tiles: list[Tile],
    clock: Clock,
    path_sets: tuple[int, int],
    interrupted: Flag,
) -> str:
    """Run the loop and return the rule that ended it. Raises KeyboardInterrupt if the flag is set."""
    film, rule = clock.film, ""
    for start, stop in missing(path_sets, film.ranges):
        while start < stop and not rule and not interrupted:
            with context:
                clock.begin_step()
                count = _step(engine, context, tiles, film, start, min(stop - start, clock.step), interrupted)
            start += count
            clock.count_step(count)
            # Check the rules before the report, because the last report states that the render is done.
            rule = clock.ended(start == stop)
            clock.stepped(engine, bool(rule))
        if rule:  # last step; the film is complete even after an interrupt
            break
        if interrupted:
            raise KeyboardInterrupt
    return rule


def missing(path_sets: tuple[int, int], ranges: tuple[tuple[int, int], ...]) -> Iterator[tuple[int, int]]:
    """Yield the path sets that are in none of the sorted `ranges`, as ranges that each lie in one batch."""
    start, end = path_sets
    for done_start, done_stop in (*ranges, (end, end)):
        yield from blocks(start, min(done_start, end))
        start = max(start, done_stop)


def _check_device(context: Context) -> None:
    """Raise ContextError if the device has failed during the work."""
    error = context.gl.error
    if error == "GL_NO_ERROR":
        return
    remedy = "Start it again; what the driver says (dmesg, nvidia-smi) may tell why."
    if error == "GL_OUT_OF_MEMORY":
        remedy = out_of_memory_remedy()
    raise ContextError(
        f"{context.info.renderer}: {error} while path sets were traced; the device has failed.", remedy
    )


@dataclass
class Clock:
    """Clock of one render, which controls the length of steps, the reports and the end.

    film    : film being rendered; its earlier path sets count in `elapsed` and in the statistics
    total   : number of path sets in the complete film
    options : options of the run; `on_step` is called after the film's metadata are updated
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
        if self.options.clean is not None:
            _, _, width, height = self._before.window
            self._look_s = _LOOK_S_PER_PIXEL * width * height / core_count()

    @property
    def elapsed(self) -> float:
        """Time of rendering in seconds, including the time of a resumed film."""
        return self._before.elapsed_s + time.perf_counter() - self.started

    def ended(self, at_block: bool) -> str:
        """Return the rule that ends the render after a step, or "" if the render continues.

        at_block : True if the step was the last one of a block, so that batches can be compared
        """
        if self.film.path_sets >= self.total:
            return SPP
        if time_is_up():
            return TIME_LIMIT
        # A check that denoises takes seconds. Skip it if it would end after the time limit.
        if at_block and looked_at(self.options, self.film.path_sets) and self._look_s < seconds_left():
            began = time.perf_counter()
            rule, bound = ended_by(self.film, self.options)
            self._look_s = time.perf_counter() - began
            self._bound = self._bound if bound is None else bound
            if rule:
                return rule
        return TIME_LIMIT if time_is_up() else ""

    def ended_before(self) -> bool:
        """Return True if a resumed film is already complete, and end the render."""
        if not self.film.path_sets:
            return False
        at_block = all(stop % BLOCK == 0 for _, stop in self.film.ranges)
        rule = self.ended(at_block)
        if rule:
            self.end_as_begun(rule)
        return bool(rule)

    def end_as_begun(self, rule: str) -> None:
        """End the render with only the path sets of the resumed film."""
        self.film.metadata = replace(self._before, stop_rule=rule, error_bound=self._bound)
        self.report("rendering", ended=True)

    def interruption(self, number: int = signal.SIGINT) -> RenderInterrupted:
        """Mark the film as interrupted before the first step, and return the exception to raise.

        number : number of the signal
        """
        self.film.metadata = replace(self.film.metadata, stop_rule=INTERRUPTED_RULE)
        return RenderInterrupted(self.film, number)

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
        # The error estimate reads the whole film, and an image is encoded. Limit reports to a sixth of the time.
        self._last_report = now + 5 * (time.perf_counter() - now)

    def begin_step(self) -> None:
        """Start timing a step, so that waiting and callbacks since the last step do not count."""
        self._last_step = time.perf_counter()

    def _expected(self) -> int:
        """Return the expected final number of path sets; the error falls with the square root of their number."""
        done, guesses = self.film.path_sets, [float(self.total)]
        if done and math.isfinite(left := seconds_left()):
            guesses.append(done * (1.0 + max(left, 0.0) / max(self.elapsed, 1e-9)))
        limit = self.options.noise or self.options.clean
        if limit is not None:
            known = self._bound is not None and done
            guesses.append(done * ((self._bound or 0) / limit) ** 2 if known else first_look(self.options))
        return min(self.total, max(done + 1, round(min(guesses))))

    def count_step(self, count: int) -> None:
        """Measure a step of `count` path sets, and choose how many the next one has within _STEP_SECONDS."""
        each = (time.perf_counter() - self._last_step) / count
        self.step = max(1, min(BLOCK, int(min(_STEP_SECONDS, seconds_left()) / max(each, 1e-9))))

    def stepped(self, engine: Engine, ended: bool) -> None:
        """Report a step; `ended` is True for the last one."""
        if self.options.on_step is not None:
            self.finish(engine, "")
            self.options.on_step(self.film)
        self.report("rendering", ended)

    def finish(self, engine: Counts, rule: str) -> None:
        """Update the film's metadata with the time, the engine's statistics, and the rule that ended the render."""
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
    """Trace path sets start..start + count in every tile and add them to the film. Returns their number.

    If the first tile is interrupted, the other tiles get the same number of path sets.
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
    _check_device(context)  # before sums of a failed device can get into the film
    with interrupted.whole():
        film.add(start, start + count, total, aovs)
    return count
