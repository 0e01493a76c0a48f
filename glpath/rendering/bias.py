"""Measure the bias of a gather before it is rendered, and replace the gather if its bias is too large.

A gather looks up a coarse radiosity solution. If the solution is too coarse for the light, the image is too bright
or too dark with any number of path sets. Therefore a reduced image is traced by the gather and by unbiased paths,
set by set (`glpath.film.bias`). If the difference is above the limit, the solution is refined. If that does not
help, "auto" takes "path", and an explicit "gather" gives a warning at the end (`Plan.remarks`).

Cost:     two further engines, and at least six path sets of an image with 128 pixels along the longer side: 0.2 to
          2 s.
Poor at:  bias in areas smaller than a block of the image, and light that few paths find.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from glpath.errors import ContextError, SceneError, TimeLimitError
from glpath.film.bias import BIAS_OBSTACLE, BIAS_PROBE, REJECTED_GATHER, SURE, Bias, bias_of, block_means, summed
from glpath.gl.context import Context
from glpath.integrators.engine import Engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.rendering.factory import Plan, Say, Window
from glpath.rendering.interrupts import Flag
from glpath.scene import Scene
from glpath.sensors.sensor import Sensor
from glpath.system.heartbeat import heartbeat
from glpath.system.time_limit import check_time, part_of_time, seconds_left

#: Longer side of the reduced image, in pixels; fixed, so that the choice of integrator does not depend on
#: resolution.
SIDE = 128
#: Counts of path sets at which the bias is compared with its limit. Measuring stops at the first count where the
#: bias is surely small or surely large. At the last count, it stops in any case.
LOOKS = (6, 12, 24, 48, 64)
# Correction for standard errors estimated from few sets (Student's t). Divided by the degrees of freedom, it is
# added to the required number of standard errors.
_STUDENT = 1.85
_NO_TIME = "the time limit left no time"
_STAGE = "measuring the bias of the gather"


class BiasProbe:
    """Two prepared engines that trace the same paths: a gather, and an engine without bias.

    Raises ContextError or MemoryError if their memory cannot be allocated.
    """

    def __init__(self, engines: tuple[PathSetEngine, PathSetEngine], shared: Engine) -> None:
        self._engines: list[PathSetEngine] = []
        for engine in engines:
            if isinstance(shared, PathSetEngine):
                engine.share(shared)
            self._engines.append(engine.prepare())
            shared = engine

    def measure(self, sensor: Sensor, interrupted: Flag) -> dict[str, Any]:
        """Return sums from which `bias_of` computes the bias, measured at a sensor of reduced resolution.

        Raises KeyboardInterrupt if the flag is set.
        """
        sets: tuple[list[Any], list[Any]] = ([], [])
        sums: dict[str, Any] = {}
        for engine in self._engines:
            engine.look_from(sensor)
        for look in LOOKS:
            for engine, found in zip(self._engines, sets, strict=True):
                for index in range(len(found), look):
                    if interrupted:
                        raise KeyboardInterrupt
                    check_time(_STAGE)
                    engine.trace_path_set(index)
                    heartbeat.beat()
                    found.append(block_means(engine.take()))
            sums = summed(*sets)
            bias = bias_of(sums)
            sure = SURE + _STUDENT / (look - 1)
            if bias is None or bias.is_small(sure) or bias.is_large(sure):
                break
        return sums

    def close(self) -> None:
        """Free the engines' memory on the device."""
        while self._engines:
            self._engines.pop().close()


@dataclass
class BiasCheck:
    """Measurement of the bias of a gather, by a probe that further engines render, before its first path set.

    context, scene : context and traceable scene of the engines
    sensor         : sensor of the render, relative to the scene's origin
    window         : window of the engine that renders
    say            : function called with the name of each stage
    interrupted    : flag; if it is set, the check raises KeyboardInterrupt
    engine_s       : approximate time to make an engine, seconds
    probe          : probe from an earlier check of the same plan, or None
    statistics     : results of the check for the film's metadata
    """

    context: Context
    scene: Scene
    sensor: Sensor
    window: Window
    timings: bool
    say: Say
    interrupted: Flag
    engine_s: float
    probe: BiasProbe | None = None
    statistics: dict[str, Any] | None = None
    _obstacle: str = ""  # reason why the bias was not measured; "" if no attempt failed

    def settle(self, plan: Plan, engine: Engine) -> tuple[Plan, Engine]:
        """Return a plan with small enough bias, and its engine; an explicitly chosen integrator is always kept."""
        bias = self._measured(plan, engine)
        if bias is None:
            # The bias is unknown and may be large, so unbiased paths replace the gather if the job allows it.
            unbiased = plan.without_bias()
            replacement = self._in_time(unbiased)
            if replacement is not None:
                return replacement, self._replaced(engine, replacement)
            self._record_obstacle(_NO_TIME if unbiased is not None else self._obstacle)
            return plan, engine
        if bias.is_small():
            return plan, engine
        refined = self._in_time(plan) and self._in_time(plan.refined(self.scene, self._say_unless_interrupted))
        if refined is not None:
            plan, engine = refined, self._replaced(engine, refined, same_solution=False)
            bias = self._measured(plan, engine)
            if bias is not None and bias.is_small():
                return plan, engine
        unbiased = self._in_time(plan.without_bias())
        assert self.statistics is not None, "measured"
        if unbiased is not None:
            self.statistics = {REJECTED_GATHER: self.statistics[BIAS_PROBE]}
            return unbiased, self._replaced(engine, unbiased)
        if bias is None:
            self._record_obstacle(self._obstacle)
        return plan, engine

    def _record_obstacle(self, obstacle: str) -> None:
        """Replace the statistics, which may be of a plan that was refined since, by a reason why there are none."""
        self.statistics = {BIAS_OBSTACLE: f"{obstacle} to measure the bias of the gather"} if obstacle else None

    def _say_unless_interrupted(self, stage: str) -> None:
        """Report a stage. Raises KeyboardInterrupt if the flag is set, because a refined solution takes long."""
        if self.interrupted:
            raise KeyboardInterrupt
        self.say(stage)

    def _in_time(self, plan: Plan | None) -> Plan | None:
        """Return the plan; None if the time limit leaves no time to make its engine."""
        return plan if seconds_left() > self.engine_s else None

    def _measured(self, plan: Plan, engine: Engine) -> Bias | None:
        """Return the bias of a plan; None if it has no bias, or if memory or time do not suffice to measure it."""
        self.say(_STAGE)
        reduced = self.sensor.reduced(SIDE)
        try:
            with part_of_time(), self.context:
                if self.probe is None:
                    engines = plan.bias_probe(engine, self.context, self.scene, reduced)
                    if engines is None:
                        return None
                    check_time(_STAGE)
                    self.probe = BiasProbe(engines, engine)
                sums = self.probe.measure(reduced, self.interrupted)
                self.statistics = {BIAS_PROBE: sums}
                return bias_of(sums)
        except TimeLimitError:
            self._obstacle = _NO_TIME
        except (ContextError, SceneError, MemoryError):  # of two further engines
            self._obstacle = "there was not enough memory"
        return None

    def _replaced(self, engine: Engine, plan: Plan, *, same_solution: bool = True) -> Engine:
        """Prepare and return the engine of `plan`, which takes over the scene on the device from `engine`."""
        with self.context:
            if self.probe is not None:
                self.probe.close()
                self.probe = None
            other = plan.engine(
                self.context, self.scene, self.sensor, self.window, self.timings, device=engine.scene
            )
            if isinstance(other, PathSetEngine) and isinstance(engine, PathSetEngine):
                other.share(engine, solution=same_solution)
            return other.prepare()
