"""Speed of "path" and "path-buffer", compared with Mitsuba 3 at equal error.

The scene is `cornell-box-36`, 256 x 256, or any that is comparable (`mitsuba_peer`), at depth 3. Numbers without a
prefix are those of the integrator "path"; `scans_` is "path-buffer" with directions "pair". All take turns within
one run, because the speed of shared machines drifts. The error is relMSE = mean(e^2 / (ref^2 + 0.01)) minus the
reference's own. A program's samples to an error are read off a straight line through log(error) over log(samples).
Its time is this number times its milliseconds per sample, without compilation. `measured`:

    reference_relmse              : error of the converged picture itself; absent if it is unknown
    ms_per_set, ms_per_set.STAGE  : milliseconds per path set, whole and by stage (the stages are run one by one
                                    for that, so they add up to more than the whole)
    paths_per_s                   : paths per second
    lost_share                    : fraction of the scans' rays that lost the roulette of their cell
    scans_ms_per_set, scans_relmse_N, scans_sets_to_target
    vs_scans                      : the scans' time to the target error divided by ours
    guided_..., guided_before_s   : "path" guided by a radiosity solution (`--guide solution`); seconds before
    relmse_N, last_relmse         : our error at N path sets, mean over seeds, and at the largest N
    relmse_of_one_set             : the latter times N; for a correct picture, all of its error is noise
    relmse_of_one_set_allowed     : its limit: the larger of 0.5 and twice Mitsuba's value for one sample
    slope                         : slope of log(error) over log(path sets)
    mitsuba_ms_per_sample, mitsuba_relmse_N
    sets_to_target, mitsuba_samples_to_target
    vs_mitsuba                    : Mitsuba's time to the target error divided by ours
    cycles_..., vs_cycles         : the same for Cycles, if it is installed
    guided_vs_mitsuba, guided_vs_cycles
    mean_off, mitsuba_mean_off    : relative difference between the means of the largest and the converged picture
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.benches.equal_error import (
    TARGET,
    Contestant,
    Ground,
    Say,
    Steps,
    compared_with,
    line_to_target,
    mean_off,
    other_peers,
    render_peer_in_steps,
    stage_times,
    trace_in_steps,
)
from benchmarks.benches.gather import compiled_engine, guiding_seconds, solve
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.gl.context import Context, get_context
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.settings import PathSetSettings
from glpath.io import load_scene
from glpath.scene.model import Scene
from glpath.system.versions import versions

SCENE, DEPTH = "cornell-box-36", 3
_SETS = (32, 64, 128, 256)
_SAMPLES = (36, 64, 144, 256)
AGREEMENT = (
    Condition("mean_off", "<=", 0.01),
    Condition("relmse_of_one_set", "<=", "relmse_of_one_set_allowed"),
    Condition("mitsuba_mean_off", "<=", 0.01),
)
# The line to the target may be extrapolated, but not from pictures that do not approach the target.
RULE = (*AGREEMENT, Condition("vs_mitsuba", ">=", 0.5), Condition("last_relmse", "<=", "target"))
CLAIM = f"not slower than half of Mitsuba's speed to relMSE {TARGET:g}"


def bench_path_buffer(
    seeds: int = 3,
    reference: str | Path | None = None,
    scene: Scene | None = None,
    say: Say = lambda text: None,
) -> Report:
    """Measure; takes about two minutes on two cores of llvmpipe with Mitsuba, a quarter of that without.

    Parameters
    ----------
    seeds     : number of independent renders, over which errors and times are averaged
    reference : converged picture of the scene; default: the shipped one, or one that Mitsuba makes once
                (`benchmarks.references.kept`)
    scene     : scene instead of the box; diffuse, lit by shapes that emit. Raises SceneError for others
    say       : function that gets messages about the progress
    """
    context = get_context()
    ground = Ground.of(scene or load_scene(SCENE), DEPTH, reference, TARGET, say)
    scene, peer, truth, notes = ground.scene, ground.peer, ground.truth, ground.notes
    measured: dict[str, float] = {}

    say(f"stages, on {context.info.renderer}")
    timed = stage_times(_tracer(context, scene, PathSettings(max_depth=DEPTH), timings=True))
    measured |= {f"ms_per_set.{stage}": ms for stage, ms in timed.items()}
    lost: list[float] = []

    def trace(counts: tuple[int, ...], seed: int) -> Steps:
        return trace_in_steps(_tracer(context, scene, PathSettings(max_depth=DEPTH, seed=seed)), counts)

    def scan(counts: tuple[int, ...], seed: int) -> Steps:
        tracer = _tracer(context, scene, PathBufferSettings(max_depth=DEPTH, seed=seed))
        steps = trace_in_steps(tracer, counts)
        statistics = tracer.statistics()
        lost.append(float(statistics["paths_lost"]) / float(statistics["paths_cast"]))  # type: ignore[arg-type]
        return steps

    solve(scene)  # compiles what is left to compile
    solver_s, solution = solve(scene)
    before_s = solver_s + guiding_seconds(context, scene, solution)

    def trace_guided(counts: tuple[int, ...], seed: int) -> Steps:
        settings = PathSettings(max_depth=DEPTH, seed=seed, guide="solution")
        return trace_in_steps(compiled_engine(context, scene, solution, settings), counts)

    contestants = {
        "": Contestant(_SETS, trace, unit="set"),
        "guided": Contestant(_SETS, trace_guided, unit="set", before_s=before_s),
        "scans": Contestant(_SETS, scan, unit="set"),
    }
    if truth is None:
        for name, contestant in contestants.items():
            ms, _ = contestant.draw(contestant.counts, 0)
            measured[f"{_prefix(name)}ms_per_set"] = float(np.median(ms))
    else:
        if not np.isnan(truth.relmse):
            measured["reference_relmse"] = truth.relmse
        if peer is not None:
            contestants["mitsuba"] = Contestant(
                _SAMPLES, lambda counts, seed: render_peer_in_steps(peer, counts, DEPTH, seed)
            )
        with other_peers(scene, DEPTH, truth, notes) as others:
            contestants |= others
            for name, contestant in contestants.items():
                say(f"how many samples of {name or 'glpath'}")
                contestant.grow(truth, TARGET)
            for seed in range(seeds):
                say(f"render {seed + 1} of {seeds}")
                for contestant in contestants.values():
                    contestant.run(seed, truth)
    width, height = scene.camera.resolution
    rows: list[dict[str, object]] = []
    claim, holds = CLAIM, None
    if truth is not None:
        for name, contestant in contestants.items():
            measured |= _summary(_prefix(name), contestant)
            measured[f"{_prefix(name)}mean_off"] = mean_off(contestant.means, truth.image)
            rows += contestant.rows(name or "glpath")
        ours = contestants[""]
        last = float(ours.error[-1])
        measured |= {"last_relmse": last, "target": TARGET, "relmse_of_one_set": last * ours.counts[-1]}
        measured["relmse_of_one_set_allowed"] = 0.5
        for name in ("scans", "mitsuba"):
            if name in contestants:
                measured[f"vs_{name}"] = measured[f"{name}_s"] / measured["s"]
        measured |= compared_with("cycles", measured, measured["s"])
        measured["guided_before_s"] = before_s
        guided = measured["guided_s"]
        if "mitsuba" in contestants:
            measured["guided_vs_mitsuba"] = measured["mitsuba_s"] / guided
        measured |= {f"guided_{k}": v for k, v in compared_with("cycles", measured, guided).items()}
    measured["lost_share"] = float(np.median(lost))
    measured["paths_per_s"] = 1e3 * width * height / measured["ms_per_set"]
    if "mitsuba" in contestants:
        theirs = contestants["mitsuba"]
        measured["relmse_of_one_set_allowed"] = max(0.5, 2.0 * float(theirs.error[-1]) * theirs.counts[-1])
        claim, holds = judge(CLAIM, RULE, measured)
    return Report(
        name="path-buffer",
        claim=claim,
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
        faults=faults(AGREEMENT, measured),
    )


def _prefix(name: str) -> str:
    """Return the prefix of a program's numbers; empty for ours."""
    return f"{name}_" if name else ""


def _summary(prefix: str, contestant: Contestant) -> dict[str, float]:
    """Return the numbers of a contestant."""
    unit = contestant.unit
    slope, needed = line_to_target(contestant.counts, contestant.error, TARGET)
    return {
        f"{prefix}ms_per_{unit}": contestant.ms_per_sample,
        **{f"{prefix}relmse_{n}": float(e) for n, e in zip(contestant.counts, contestant.error, strict=True)},
        f"{prefix}slope": slope,
        f"{prefix}{unit}s_to_target": needed,
        f"{prefix}s": contestant.before_s + 1e-3 * needed * contestant.ms_per_sample,
    }


def _tracer(context: Context, scene: Scene, settings: PathSetSettings, timings: bool = False) -> PathSetEngine:
    return compiled_engine(context, scene, None, settings, timings)
