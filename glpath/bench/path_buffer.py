"""How fast path tracing is, with own rays and with scans of the path-buffer, and beside Mitsuba 3 at equal error.

The scene is `cornell-box-36`, 256 x 256, depth 3. Ours are own rays, the default; `scans_` says the same of shared
directions ("pair"), cast by the path-buffer. All are measured in turns within one run, since shared machines drift.
Error is relMSE = mean(e^2 / (ref^2 + 0.01)); a program's number of samples to an error is read off a straight line
through log(error) over log(samples), its time is that number times its milliseconds per sample, compilation not
counted. `measured`:

    ms_per_set, ms_per_set.STAGE  : milliseconds per path set, whole and by stage (the stages are run one by one
                                    for that, so they add up to more than the whole)
    paths_per_s                   : paths per second
    lost_share                    : of the scans, the share of rays that lost the roulette of their cell
    scans_ms_per_set, scans_relmse_N, scans_sets_to_target
    vs_scans                      : the scans' time to the target error over ours
    relmse_N, last_relmse         : our error at N path sets, mean over seeds, and at the largest N
    relmse_of_one_set             : the latter times N: of a right picture, all of its error is noise
    slope                         : of log(error) over log(path sets)
    mitsuba_ms_per_sample, mitsuba_relmse_N
    sets_to_target, mitsuba_samples_to_target
    vs_mitsuba                    : Mitsuba's time to the target error over ours
    mean_off, mitsuba_mean_off    : by how much the mean of the largest picture is off that of the converged one
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from glpath.bench.equal_error import (
    line_to_target,
    mean_off,
    mitsuba_scenes,
    reference_picture,
    render_peer_in_steps,
    stage_times,
    trace_in_steps,
    warm_up,
)
from glpath.compare import relative_mse
from glpath.experiments.verdict import Condition, Report, faults, judge, machine
from glpath.gl.context import Context, get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.settings import Directions, PathTraceSettings
from glpath.scene import load_scene
from glpath.scene.model import Scene
from glpath.versions import versions

SCENE, DEPTH = "cornell-box-36", 3
TARGET = 1e-3
_SETS = (32, 64, 128, 256)
_SAMPLES = (36, 64, 144, 256)
AGREEMENT = (
    Condition("mean_off", "<=", 0.01),
    Condition("relmse_of_one_set", "<=", 0.5),
    Condition("mitsuba_mean_off", "<=", 0.01),
)
# The line to the target may be drawn on beyond what was measured, but not from pictures that do not come nearer.
RULE = (*AGREEMENT, Condition("vs_mitsuba", ">=", 0.5), Condition("last_relmse", "<=", "target"))
CLAIM = f"not slower than half of Mitsuba's speed to relMSE {TARGET:g}"


def bench_path_buffer(
    seeds: int = 3, reference: str | Path | None = None, say: Callable[[str], None] = lambda text: None
) -> Report:
    """Measure; takes about two minutes on two cores of llvmpipe with Mitsuba, a quarter of that without.

    Parameters
    ----------
    seeds     : independent renders that errors and times are taken over
    reference : a converged picture of the scene; by default the one that ships, else Mitsuba makes one
    say       : called with a line on what goes on
    """
    context = get_context()
    scene = load_scene(SCENE)
    measured: dict[str, float] = {}
    rows: list[dict[str, object]] = []
    notes: list[str] = []
    peer = mitsuba_scenes(scene, DEPTH, notes)
    truth = reference_picture(reference, SCENE, DEPTH, peer is not None, say)

    say(f"stages, on {context.info.renderer}")
    timed = stage_times(_tracer(context, scene, 0, timings=True))
    measured |= {f"ms_per_set.{stage}": ms for stage, ms in timed.items()}

    errors = np.zeros((seeds, len(_SETS)))
    peer_errors = np.zeros((seeds, len(_SAMPLES)))
    means, peer_means = np.zeros(seeds), np.zeros(seeds)
    ms: list[float] = []
    scans_errors, scans_ms = np.zeros((seeds, len(_SETS))), list[float]()
    peer_ms: list[float] = []
    for seed in range(seeds):
        say(f"render {seed + 1} of {seeds}")
        tracer = _tracer(context, scene, seed)
        set_ms, images = trace_in_steps(tracer, _SETS)
        scans = _tracer(context, scene, seed, "pair")
        set_ms_of_scans, scanned = trace_in_steps(scans, _SETS)
        scans_ms += set_ms_of_scans
        counts = scans.statistics()
        measured["lost_share"] = float(counts["paths_lost"]) / float(counts["paths_cast"])  # type: ignore[arg-type]
        ms += set_ms
        if truth is not None:
            errors[seed] = [relative_mse(image, truth) for image in images]
            scans_errors[seed] = [relative_mse(image, truth) for image in scanned]
            means[seed] = images[-1].mean()
        if peer is not None and truth is not None:
            times, peer_images = render_peer_in_steps(peer, _SAMPLES, DEPTH, seed)
            peer_errors[seed] = [relative_mse(image, truth) for image in peer_images]
            peer_means[seed] = peer_images[-1].mean()
            peer_ms += times

    measured["ms_per_set"] = float(np.median(ms))
    measured["scans_ms_per_set"] = float(np.median(scans_ms))
    width, height = scene.camera.resolution
    measured["paths_per_s"] = 1e3 * width * height / measured["ms_per_set"]
    claim, holds = CLAIM, None
    if truth is not None:
        measured["mean_off"] = mean_off(means, truth)
        measured |= {f"relmse_{n}": float(e) for n, e in zip(_SETS, errors.mean(0), strict=True)}
        measured |= {"last_relmse": float(errors.mean(0)[-1]), "target": TARGET}
        measured["relmse_of_one_set"] = measured["last_relmse"] * _SETS[-1]
        measured["slope"], measured["sets_to_target"] = line_to_target(_SETS, errors.mean(0), TARGET)
        measured |= {f"scans_relmse_{n}": float(e) for n, e in zip(_SETS, scans_errors.mean(0), strict=True)}
        _, measured["scans_sets_to_target"] = line_to_target(_SETS, scans_errors.mean(0), TARGET)
        scans_time = measured["scans_sets_to_target"] * measured["scans_ms_per_set"]
        measured["vs_scans"] = scans_time / (measured["sets_to_target"] * measured["ms_per_set"])
        rows += [
            {"program": "glpath", "samples": n, "relmse": float(e), "ms": n * measured["ms_per_set"]}
            for n, e in zip(_SETS, errors.mean(0), strict=True)
        ]
    if peer is not None and truth is not None:
        measured["mitsuba_mean_off"] = mean_off(peer_means, truth)
        measured["mitsuba_ms_per_sample"] = float(np.median(peer_ms))
        measured |= {f"mitsuba_relmse_{n}": float(e) for n, e in zip(_SAMPLES, peer_errors.mean(0), strict=True)}
        _, measured["mitsuba_samples_to_target"] = line_to_target(_SAMPLES, peer_errors.mean(0), TARGET)
        rows += [
            {"program": "mitsuba", "samples": n, "relmse": float(e), "ms": n * measured["mitsuba_ms_per_sample"]}
            for n, e in zip(_SAMPLES, peer_errors.mean(0), strict=True)
        ]
        theirs = measured["mitsuba_samples_to_target"] * measured["mitsuba_ms_per_sample"]
        measured["vs_mitsuba"] = theirs / (measured["sets_to_target"] * measured["ms_per_set"])
        claim, holds = judge(CLAIM, RULE, measured)
    broken = faults(AGREEMENT, measured)
    return Report(
        name="path-buffer",
        claim=claim,
        measured=measured,
        holds=False if broken else holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
        faults=broken,
    )


def _tracer(
    context: Context, scene: Scene, seed: int, directions: Directions = "own", timings: bool = False
) -> PathSetEngine:
    tracer = path_engine(
        context.gl,
        DeviceScene(context.gl, scene),
        PathTraceSettings(max_depth=DEPTH, seed=seed, directions=directions),
        (0, 0, *scene.camera.resolution),
        hardware=context.info.hardware,
        timings=timings,
    )
    warm_up(tracer)
    return tracer
