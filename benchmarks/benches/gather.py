"""Time until the gather reaches an error with all bounces, solver included, beside path tracing and Mitsuba 3.

The scene is `cornell-box-36`, 256 x 256, or any that is comparable (`mitsuba_peer`). Programs take turns within one
run: the gather from a coarse solution; "path" with its defaults, unbiased, with the solution as its guide and
control variate (`path_`); Mitsuba's path tracer at depth 64, with roulette from its default vertex on; and Cycles
with as many bounces if it is installed. The error is relMSE against a converged picture of all bounces, minus that
picture's own. Samples to the target are interpolated on the polyline through log(error) over log(samples). Our time
includes the solver, and no time includes compilation. `measured`:

    reference_relmse                : error of the converged picture itself; absent if it is unknown
    solver_s                        : seconds of the radiosity solution; elements : number of its elements
    guide_s                         : seconds to make path guides from the solution
    gather_ms_per_set, gather_ms_per_set.STAGE : whole, and by stage (run one by one, so they add up to more)
    gather_relmse_N                 : error at N path sets, mean over seeds
    scans_ms_per_set                : the gather with cast "path-buffer"
    gather_sets_to_target, gather_s : path sets to the target; seconds, including the solver
    path_..., mitsuba_..., cycles_... : the same for the others
    vs_path, vs_mitsuba, vs_cycles : their time divided by the gather's; path_vs_mitsuba : Mitsuba's by the paths'
    ..._mean_off                    : relative difference between the means of the largest and the converged picture
    radiance_s, radiance_relmse     : Radiance's picture, if it is installed
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.benches.equal_error import (
    TARGET,
    Contestant,
    Ground,
    Say,
    compared_with,
    mean_off,
    other_peers,
    radiance_row,
    render_peer_in_steps,
    samples_to_target,
    scaled,
    stage_times,
    trace_in_steps,
    warm_up,
)
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.film.aovs import Aov
from glpath.gl.context import Context, get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.gather_settings import Cast, GatherSettings
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathSettings
from glpath.integrators.ray_paths import RayPathEngine
from glpath.integrators.settings import PathSetSettings
from glpath.integrators.solution_lookup import device_radiosity
from glpath.io import load_scene
from glpath.radiosity.solution import RadiositySolution
from glpath.rendering.factory import solve_for_gather
from glpath.scene.model import Scene
from glpath.sensors.sensor import CameraSensor
from glpath.system.versions import versions

SCENE = "cornell-box-36"
#: Maximum depth of Mitsuba's paths for all bounces; the light beyond it is below float precision.
DEPTH = 64
_GATHER_SETS = (16, 32, 64, 128)
_PATH_SETS = (16, 32, 64, 128)
_SAMPLES = (64, 169)
AGREEMENT = tuple(Condition(f"{name}_mean_off", "<=", 0.02) for name in ("gather", "path", "mitsuba"))
RULE = (*AGREEMENT, Condition("vs_path", ">", 1.0), Condition("vs_mitsuba", ">", 1.0))


def bench_gather(
    seeds: int = 3,
    reference: str | Path | None = None,
    scale: float = 1.0,
    scene: Scene | None = None,
    say: Say = lambda text: None,
) -> Report:
    """Measure; takes about five minutes on two cores of llvmpipe with Mitsuba.

    Parameters
    ----------
    seeds     : number of independent renders, over which errors and times are averaged
    reference : converged picture of the scene with all bounces; default: the shipped one, or one that Mitsuba makes
                once (`benchmarks.references.kept`)
    scale     : below 1, fewer samples for all programs, for a quick test
    scene     : scene instead of the box; diffuse, lit by shapes that emit. Raises SceneError for others
    say       : function that gets messages about the progress
    """
    context = get_context()
    ground = Ground.of(scene or load_scene(SCENE), DEPTH, reference, TARGET, say)
    scene, peer, truth, notes = ground.scene, ground.peer, ground.truth, ground.notes

    say("radiosity")
    solve(scene)  # compiles what is left to compile
    seconds, solution = solve(scene)
    solver_s = [seconds]
    say(f"stages, on {context.info.renderer}")
    timed = stage_times(gather_engine(context, scene, solution, 0, timings=True))
    guide_s = guiding_seconds(context, scene, solution)
    measured = {f"gather_ms_per_set.{stage}": ms for stage, ms in timed.items()}
    scans_ms, _ = trace_in_steps(gather_engine(context, scene, solution, 0, cast="path-buffer"), (8, 16, 24))
    measured["scans_ms_per_set"] = float(np.median(scans_ms))

    contestants = {
        "gather": Contestant(
            scaled(_GATHER_SETS, scale),
            lambda counts, seed: trace_in_steps(gather_engine(context, scene, solution, seed), counts),
            unit="set",
        ),
        "path": Contestant(
            scaled(_PATH_SETS, scale),
            lambda counts, seed: trace_in_steps(path_engine_of(context, scene, solution, seed), counts),
            unit="set",
        ),
    }
    if peer is not None:
        contestants["mitsuba"] = Contestant(
            scaled(_SAMPLES, scale), lambda counts, seed: render_peer_in_steps(peer, counts, DEPTH, seed)
        )
    rows: list[dict[str, object]] = []
    if truth is not None:
        if not np.isnan(truth.relmse):
            measured["reference_relmse"] = truth.relmse
        with other_peers(scene, DEPTH, truth, notes, scale) as others:
            contestants |= others
            for name, contestant in contestants.items():
                if scale >= 1:
                    say(f"how many samples of {name}")
                    contestant.grow(truth, TARGET)
            for seed in range(seeds):
                say(f"render {seed + 1} of {seeds}")
                solver_s.append(solve(scene)[0])
                for contestant in contestants.values():
                    contestant.run(seed, truth)

    measured |= {
        "solver_s": float(np.median(solver_s)),
        "guide_s": guide_s,
        "elements": float(solution.element_count),
    }
    claim = f"the gather, its solver included, is the first to relMSE {TARGET:g} with all bounces"
    holds: bool | None = None
    if truth is not None:
        for name in ("gather", "path"):
            contestants[name].before_s = measured["solver_s"] + guide_s
        for name, contestant in contestants.items():
            measured |= summary(name, contestant, TARGET) | {
                f"{name}_mean_off": mean_off(contestant.means, truth.image)
            }
            rows += contestant.rows(name)
        for name in ("path", "mitsuba"):
            if name in contestants:
                measured[f"vs_{name}"] = measured[f"{name}_s"] / measured["gather_s"]
        if "mitsuba" in contestants:
            measured["path_vs_mitsuba"] = measured["mitsuba_s"] / measured["path_s"]
        measured |= compared_with("cycles", measured, measured["gather_s"])
        by_radiance, its_rows = radiance_row(scene, truth, notes)
        measured, rows = measured | by_radiance, rows + its_rows
    if all(condition.left in measured for condition in RULE):
        claim, holds = judge(claim, RULE, measured)
    return Report(
        name="gather",
        claim=claim,
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "numba", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
        faults=faults(AGREEMENT, measured),
    )


def solve(scene: Scene) -> tuple[float, RadiositySolution]:
    """Return the seconds of the radiosity solver, and the solution that a render makes by default."""
    start = time.perf_counter()
    solution = solve_for_gather(scene)
    return time.perf_counter() - start, solution


def guiding_seconds(context: Context, scene: Scene, solution: RadiositySolution) -> float:
    """Return the seconds to make a gather's path guides before its first set, without compilation."""
    found = []
    for seed in range(4):
        engine = gather_engine(context, scene, solution, seed)
        assert isinstance(engine, RayPathEngine), "the default's engine"
        found.append(engine.guide.seconds if engine.guide else 0.0)
    return float(np.median(found[1:]))


def gather_engine(
    context: Context,
    scene: Scene,
    solution: RadiositySolution,
    seed: int,
    cast: Cast = "bvh",
    timings: bool = False,
    aovs: tuple[Aov, ...] = (),
    branches: int = GatherSettings.branches,
) -> PathSetEngine:
    """Return the engine of the gather, compiled."""
    settings = GatherSettings(seed=seed, cast=cast, aovs=aovs, branches=branches)
    return compiled_engine(context, scene, solution, settings, timings)


def path_engine_of(
    context: Context, scene: Scene, solution: RadiositySolution, seed: int, aovs: tuple[Aov, ...] = ()
) -> PathSetEngine:
    """Return the default path tracer with the solution, compiled."""
    settings = PathSettings(seed=seed, aovs=aovs).completed(lambda: True)
    return compiled_engine(context, scene, solution, settings)


def compiled_engine(
    context: Context,
    scene: Scene,
    solution: RadiositySolution | None,
    settings: PathSetSettings,
    timings: bool = False,
) -> PathSetEngine:
    """Return a compiled engine with the given settings, and with the solution if there is one."""
    radiosity = None
    if solution is not None:
        assert isinstance(settings, GatherSettings | PathSettings), "no other engine has a use for it"
        radiosity = device_radiosity(context.gl, scene, solution, settings, CameraSensor.of(scene.camera))
    tracer = path_engine(
        context.gl,
        DeviceScene(context.gl, scene),
        settings,
        (0, 0, *scene.camera.resolution),
        radiosity=radiosity,
        timings=timings,
    ).prepare()
    warm_up(tracer)
    return tracer


def summary(name: str, contestant: Contestant, target: float) -> dict[str, float]:
    """Return the numbers of a contestant for the report."""
    unit = contestant.unit
    needed = samples_to_target(contestant.counts, contestant.error, target)
    return {
        f"{name}_ms_per_{unit}": contestant.ms_per_sample,
        **{f"{name}_relmse_{n}": float(e) for n, e in zip(contestant.counts, contestant.error, strict=True)},
        f"{name}_{unit}s_to_target": needed,
        f"{name}_s": contestant.before_s + 1e-3 * needed * contestant.ms_per_sample,
    }
