"""The loop of a render: path sets into a film, in steps short enough for Ctrl-C and for progress."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from glpath.film import BLOCK, Film, blocks
from glpath.gl.context import Context
from glpath.progress import Progress
from glpath.rendering.factory import Engine
from glpath.rendering.interrupts import Flag, RenderInterrupted, interrupt_as_flag
from glpath.rendering.tiles import Tile

# How long one step may take: Ctrl-C and the progress wait for its end.
_STEP_SECONDS = 0.5


def trace(engine: Engine, context: Context, tiles: list[Tile], clock: Clock, first: int) -> None:
    """Fill the clock's film with its path sets, in steps between which the context is free.

    Raises RenderInterrupted.
    """
    film = clock.film
    with interrupt_as_flag() as interrupted:
        try:
            for start, stop in blocks(first, first + clock.total):
                while start < stop and not interrupted:
                    with context:
                        clock.begin_step()
                        count = _step(engine, tiles, film, start, min(stop - start, clock.step), interrupted)
                    start += count
                    clock.stepped(count)
                if interrupted:
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            # The flag's, or a second Ctrl-C that broke into a step: the film holds the steps before it.
            raise RenderInterrupted(clock.finish(engine)) from None
        clock.finish(engine)
    if interrupted:  # after the last step, too late for the loop to see
        raise RenderInterrupted(film)


@dataclass
class Clock:
    """The clock of one render: how long a step may be, and when to report."""

    film: Film
    total: int
    renderer: str
    on_progress: Callable[[Progress], None] | None
    step: int = 1
    statistics: dict[str, object] = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)
    _last_step: float = field(default_factory=time.perf_counter)
    _last_report: float = -math.inf
    _error: float | None = None

    def report(self, stage: str) -> None:
        if self.on_progress is None:
            return
        done, now = self.film.path_sets, time.perf_counter()
        last = done == self.total
        if not last and now - self._last_report < _STEP_SECONDS:
            return
        if done:
            self._error = self.film.relative_error()
        self.on_progress(
            Progress(done, self.total, now - self.started, self._error, self.film, stage, self.renderer)
        )
        # The estimate reads the whole film, an image has to be encoded; that must not be what the time goes into.
        self._last_report = now + 5 * (time.perf_counter() - now)

    def begin_step(self) -> None:
        """A step begins: what went by since the last one was spent waiting, or in who is told of the progress."""
        self._last_step = time.perf_counter()

    def stepped(self, count: int) -> None:
        """A step of so many path sets is done; the next is as long as fits into the time for one."""
        each = (time.perf_counter() - self._last_step) / count
        self.step = max(1, min(BLOCK, int(_STEP_SECONDS / max(each, 1e-9))))
        self.report("rendering")

    def finish(self, engine: Engine) -> Film:
        """The film with its statistics, which are known only now."""
        elapsed = time.perf_counter() - self.started
        self.film.metadata = replace(
            self.film.metadata, elapsed_s=elapsed, statistics=self.statistics | engine.statistics()
        )
        return self.film


def _step(engine: Engine, tiles: list[Tile], film: Film, start: int, count: int, interrupted: Flag) -> int:
    """Trace path sets start..start + count in every tile and add them to the film. Returns how many it were.

    When interrupted in the first tile, the others follow as far as that one came.
    """
    total = np.zeros(film.radiance_sums.shape[1:])
    aovs = {name: np.zeros_like(total) for name in film.aov_sums}
    for tile in tiles:
        engine.look_at(tile.window)
        traced = 0
        while traced < count:
            engine.trace_path_set(start + traced)
            traced += 1
            if interrupted and tile is tiles[0]:
                break
        count = traced
        total[tile.target] = engine.take()[tile.keep]
        for name, found in engine.take_aovs().items():
            aovs[name][tile.target] = found[tile.keep]
    with interrupted.whole():
        film.add(start, start + count, total, aovs)
    return count
