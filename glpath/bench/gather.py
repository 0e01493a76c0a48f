"""How soon the gather has all bounces of light, its radiosity solver included, beside path tracing and Mitsuba 3.

The scene is `cornell-box-36`, 256 x 256. Three programs take turns within one run: the gather from a coarse
solution, path tracing to a depth at which next to nothing is missing (`path_buffer_`: its name from when it cast by
the path-buffer), and Mitsuba's path tracer at depth 64, with roulette from its default vertex on. Error is relMSE
against a converged picture of all bounces; the samples to the target are read off the polyline through log(error)
over log(samples), the time is theirs and, of the gather, the solver's. Compilation is not counted. `measured`:

    solver_s                        : the radiosity solution, once; elements : how many it has
    gather_ms_per_set, gather_ms_per_set.STAGE : whole, and by stage (run one by one, so that they add up to more)
    gather_relmse_N                 : error at N path sets, mean over seeds
    scans_ms_per_set                : of the gather with shared directions, cast by the path-buffer
    gather_sets_to_target, gather_s : path sets to the target; seconds, the solver's among them
    path_buffer_..., mitsuba_...    : the same of the others
    vs_path_buffer, vs_mitsuba      : their time over the gather's
    ..._mean_off                    : by how much the mean of the largest picture is off that of the converged one
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from glpath.bench.equal_error import (
    Say,
    mean_off,
    mitsuba_scenes,
    reference_picture,
    render_peer_in_steps,
    samples_to_target,
    stage_times,
    trace_in_steps,
    warm_up,
)
from glpath.compare import relative_mse
from glpath.experiments.verdict import Condition, Report, faults, judge, machine
from glpath.gl.context import Context, get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.gather import device_radiosity
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.settings import Directions, GatherSettings, PathTraceSettings
from glpath.radiosity.solution import RadiositySolution
from glpath.radiosity.solvers.solve import solve_radiosity
from glpath.scene import load_scene
from glpath.scene.model import Float64, Scene
from glpath.versions import versions

SCENE = "cornell-box-36"
TARGET = 1e-3
#: Mitsuba's, for all bounces; what is missing after so many is less than a float can hold beside the rest.
DEPTH = 64
#: The path tracer's. Longer paths add less than a tenth of the target to the error and cost a scan each.
PATH_DEPTH = 8
#: Of the solution: coarse, but its own error is well below the target.
PATCHES = 500
_GATHER_SETS = (32, 64, 128, 256)
_PATH_SETS = (64, 128, 256)
_SAMPLES = (64, 169)
# The path tracer's lacks the light of longer paths.
AGREEMENT = tuple(Condition(f"{name}_mean_off", "<=", 0.02) for name in ("gather", "path_buffer", "mitsuba"))
RULE = (*AGREEMENT, Condition("vs_path_buffer", ">", 1.0), Condition("vs_mitsuba", ">", 1.0))


@dataclass
class _Contestant:
    """A program's pictures: `draw(seed)` gives milliseconds per sample and the picture at each of `counts`."""

    counts: tuple[int, ...]
    draw: Callable[[int], tuple[Sequence[float], Sequence[Float64]]]
    ms: list[float] = field(default_factory=list)
    errors: list[list[float]] = field(default_factory=list)
    means: list[float] = field(default_factory=list)

    def run(self, seed: int, truth: Float64) -> None:
        ms, images = self.draw(seed)
        self.ms += ms
        self.errors.append([relative_mse(image, truth) for image in images])
        self.means.append(float(images[-1].mean()))

    @property
    def ms_per_sample(self) -> float:
        return float(np.median(self.ms))

    @property
    def error(self) -> Float64:
        return np.asarray(np.mean(self.errors, axis=0))


def bench_gather(
    seeds: int = 3, reference: str | Path | None = None, scale: float = 1.0, say: Say = lambda text: None
) -> Report:
    """Measure; takes about five minutes on two cores of llvmpipe with Mitsuba.

    Parameters
    ----------
    seeds     : independent renders that errors and times are taken over
    reference : a converged picture of the scene with all bounces; by default the one that ships, else Mitsuba
                makes one
    say       : called with a line on what goes on
    scale     : below 1, fewer samples of all, to see that it works
    """
    context = get_context()
    scene = load_scene(SCENE)
    notes: list[str] = []
    peer = mitsuba_scenes(scene, DEPTH, notes)
    truth = reference_picture(reference, SCENE, DEPTH, peer is not None, say)
    if truth is None:
        notes.append("without a reference: no errors. Give one (--reference), or install the reference extra.")

    say("radiosity")
    solve_radiosity(scene, patches=PATCHES)  # compiles what is left to compile
    solver_s: list[float] = []
    solutions: list[RadiositySolution] = []

    def solve() -> None:
        start = time.perf_counter()
        solutions[:] = [solve_radiosity(scene, patches=PATCHES)]
        solver_s.append(time.perf_counter() - start)

    solve()
    say(f"stages, on {context.info.renderer}")
    timed = stage_times(_gather(context, scene, solutions[0], 0, timings=True))
    measured = {f"gather_ms_per_set.{stage}": ms for stage, ms in timed.items()}
    scans_ms, _ = trace_in_steps(_gather(context, scene, solutions[0], 0, directions="pair"), (8, 16, 24))
    measured["scans_ms_per_set"] = float(np.median(scans_ms))

    def scaled(counts: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(sorted({max(1, round(scale * n)) for n in counts}))

    contestants = {
        "gather": _Contestant(
            scaled(_GATHER_SETS),
            lambda seed: trace_in_steps(_gather(context, scene, solutions[0], seed), scaled(_GATHER_SETS)),
        ),
        "path_buffer": _Contestant(
            scaled(_PATH_SETS), lambda seed: trace_in_steps(_path(context, scene, seed), scaled(_PATH_SETS))
        ),
    }
    if peer is not None:
        contestants["mitsuba"] = _Contestant(
            scaled(_SAMPLES), lambda seed: render_peer_in_steps(peer, scaled(_SAMPLES), DEPTH, seed)
        )
    if truth is not None:
        for seed in range(seeds):
            say(f"render {seed + 1} of {seeds}")
            solve()
            for contestant in contestants.values():
                contestant.run(seed, truth)

    measured |= {"solver_s": float(np.median(solver_s)), "elements": float(solutions[0].element_count)}
    rows: list[dict[str, object]] = []
    if truth is not None:
        for name, contestant in contestants.items():
            before = measured["solver_s"] if name == "gather" else 0.0
            measured |= _summary(name, contestant, before) | {f"{name}_mean_off": mean_off(contestant.means, truth)}
            rows += _rows(name, contestant, before)
    claim = f"the gather, its solver included, is the first to relMSE {TARGET:g} with all bounces"
    holds: bool | None = None
    for name in ("path_buffer", "mitsuba"):
        if truth is not None and name in contestants:
            measured[f"vs_{name}"] = measured[f"{name}_s"] / measured["gather_s"]
    if all(condition.left in measured for condition in RULE):
        claim, holds = judge(claim, RULE, measured)
    broken = faults(AGREEMENT, measured)
    return Report(
        name="gather",
        claim=claim,
        measured=measured,
        holds=False if broken else holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "numba", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
        faults=broken,
    )


def _gather(
    context: Context,
    scene: Scene,
    solution: RadiositySolution,
    seed: int,
    directions: Directions = "own",
    timings: bool = False,
) -> PathSetEngine:
    settings = GatherSettings(seed=seed, directions=directions)
    tracer = path_engine(
        context.gl,
        DeviceScene(context.gl, scene),
        settings,
        (0, 0, *scene.camera.resolution),
        radiosity=device_radiosity(context.gl, scene, solution, settings),
        hardware=context.info.hardware,
        timings=timings,
    )
    warm_up(tracer)
    return tracer


def _path(context: Context, scene: Scene, seed: int) -> PathSetEngine:
    settings = PathTraceSettings(max_depth=PATH_DEPTH, seed=seed)
    window = (0, 0, *scene.camera.resolution)
    tracer = path_engine(
        context.gl, DeviceScene(context.gl, scene), settings, window, hardware=context.info.hardware
    )
    warm_up(tracer)
    return tracer


def _summary(name: str, contestant: _Contestant, before_s: float) -> dict[str, float]:
    """The contestant's numbers; before_s: seconds before its first sample."""
    unit = "sample" if name == "mitsuba" else "set"
    needed = samples_to_target(contestant.counts, contestant.error, TARGET)
    return {
        f"{name}_ms_per_{unit}": contestant.ms_per_sample,
        **{f"{name}_relmse_{n}": float(e) for n, e in zip(contestant.counts, contestant.error, strict=True)},
        f"{name}_{unit}s_to_target": needed,
        f"{name}_s": before_s + 1e-3 * needed * contestant.ms_per_sample,
    }


def _rows(name: str, contestant: _Contestant, before_s: float) -> list[dict[str, object]]:
    return [
        {"program": name, "samples": n, "relmse": float(e), "s": before_s + 1e-3 * n * contestant.ms_per_sample}
        for n, e in zip(contestant.counts, contestant.error, strict=True)
    ]
