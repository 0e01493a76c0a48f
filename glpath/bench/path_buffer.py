"""How fast the path-buffer path traces, and beside Mitsuba 3 at equal error.

The scene is `cornell-box-36`, 256 x 256, depth 3. Both programs are measured in turns within one run, since shared
machines drift. Error is relMSE = mean(e^2 / (ref^2 + 0.01)); a program's number of samples to an error is read off
a straight line through log(error) over log(samples), its time is that number times its milliseconds per sample,
compilation not counted. `measured`:

    ms_per_set, ms_per_set.STAGE  : milliseconds per path set, whole and by stage (the stages are run one by one
                                    for that, so they add up to more than the whole)
    paths_per_s, lost_share       : paths per second; share of rays that lost the roulette of their cell
    relmse_N                      : our error at N path sets, mean over seeds
    slope                         : of log(error) over log(path sets)
    mitsuba_ms_per_sample, mitsuba_relmse_N
    sets_to_target, mitsuba_samples_to_target
    vs_mitsuba                    : Mitsuba's time to the target error over ours
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glpath.bench import mitsuba_peer
from glpath.compare import relative_mse
from glpath.errors import GlpathError
from glpath.gl.context import Context, get_context
from glpath.gl.gpu_scene import GpuScene
from glpath.image import read_image
from glpath.integrators.path_trace import PathTracer, PathTraceSettings
from glpath.measure import Report, machine
from glpath.scene import load_scene
from glpath.scene.model import Scene
from glpath.versions import versions

SCENE, DEPTH = "cornell-box-36", 3
TARGET = 1e-3
_SETS = (32, 64, 128, 256)
_SAMPLES = (36, 64, 144, 256)
_REFERENCE_SPP = 4096

Float64 = NDArray[np.float64]


def bench_path_buffer(
    seeds: int = 3, reference: str | Path | None = None, say: Callable[[str], None] = lambda text: None
) -> Report:
    """Measure; takes about two minutes on two cores of llvmpipe with Mitsuba, a quarter of that without.

    Parameters
    ----------
    seeds     : independent renders that errors and times are taken over
    reference : a converged picture of the scene; by default the one of the checkout, else Mitsuba makes one
    say       : called with a line on what goes on
    """
    context = get_context()
    scene = load_scene(SCENE)
    measured: dict[str, float] = {}
    rows: list[dict[str, object]] = []
    notes: list[str] = []
    peer = _peer(scene, notes)
    truth = _reference(reference, scene, peer is not None, say)

    say(f"stages, on {context.info.renderer}")
    measured |= _stages(context, scene)

    errors = np.zeros((seeds, len(_SETS)))
    peer_errors = np.zeros((seeds, len(_SAMPLES)))
    ms: list[float] = []
    peer_ms: list[float] = []
    for seed in range(seeds):
        say(f"render {seed + 1} of {seeds}")
        set_ms, images = _trace(context, scene, seed, measured)
        ms += set_ms
        if truth is not None:
            errors[seed] = [relative_mse(image, truth) for image in images]
        if peer is not None and truth is not None:
            for i, spp in enumerate(_SAMPLES):
                timing = mitsuba_peer.time_to_render(peer(spp), spp, DEPTH, repeats=1, seed=seed)
                peer_errors[seed, i] = relative_mse(timing.images[0], truth)
                peer_ms.append(1e3 * float(timing.seconds[0]) / spp)

    measured["ms_per_set"] = float(np.median(ms))
    width, height = scene.camera.resolution
    measured["paths_per_s"] = 1e3 * width * height / measured["ms_per_set"]
    holds = None
    if truth is not None:
        measured |= {f"relmse_{n}": float(e) for n, e in zip(_SETS, errors.mean(0), strict=True)}
        measured["slope"], measured["sets_to_target"] = _fit(_SETS, errors.mean(0))
        rows += [
            {"program": "glpath", "samples": n, "relmse": float(e), "ms": n * measured["ms_per_set"]}
            for n, e in zip(_SETS, errors.mean(0), strict=True)
        ]
    if peer is not None:
        measured["mitsuba_ms_per_sample"] = float(np.median(peer_ms))
        measured |= {f"mitsuba_relmse_{n}": float(e) for n, e in zip(_SAMPLES, peer_errors.mean(0), strict=True)}
        _, measured["mitsuba_samples_to_target"] = _fit(_SAMPLES, peer_errors.mean(0))
        rows += [
            {"program": "mitsuba", "samples": n, "relmse": float(e), "ms": n * measured["mitsuba_ms_per_sample"]}
            for n, e in zip(_SAMPLES, peer_errors.mean(0), strict=True)
        ]
        theirs = measured["mitsuba_samples_to_target"] * measured["mitsuba_ms_per_sample"]
        measured["vs_mitsuba"] = theirs / (measured["sets_to_target"] * measured["ms_per_set"])
        holds = measured["vs_mitsuba"] >= 0.5
    return Report(
        name="path-buffer",
        claim=f"not slower than half of Mitsuba's speed to relMSE {TARGET:g}: vs_mitsuba >= 0.5",
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
    )


def _peer(scene: Scene, notes: list[str]) -> Callable[[int], object] | None:
    """Makes Mitsuba's scene for a number of samples (its strata depend on it); None without the extra."""
    try:
        mitsuba_peer.load_mitsuba()
    except GlpathError as error:
        notes.append(f"without Mitsuba: {error}")
        return None
    note = mitsuba_peer.best_variant()[1]
    if note:
        notes.append(note)
    return lambda spp: mitsuba_peer.to_mitsuba(scene, DEPTH, spp=spp)


def _reference(given: str | Path | None, scene: Scene, mitsuba: bool, say: Callable[[str], None]) -> Float64 | None:
    stored = Path(__file__).resolve().parents[2] / "tests" / "data" / f"{SCENE}-depth{DEPTH}.npz"
    if given is not None or stored.is_file():
        return read_image(given or stored)
    if not mitsuba:
        return None
    say(f"no stored reference: Mitsuba renders one of {_REFERENCE_SPP} samples")
    parts = [mitsuba_peer.render_mitsuba(scene, _REFERENCE_SPP // 4, DEPTH, seed=1000 + i) for i in range(4)]
    reference: Float64 = np.mean(parts, axis=0)
    return reference


def _tracer(context: Context, scene: Scene, seed: int, timings: bool = False) -> PathTracer:
    tracer = PathTracer(
        context.gl,
        GpuScene(context.gl, scene),
        PathTraceSettings(max_depth=DEPTH, seed=seed),
        (0, 0, *scene.camera.resolution),
        hardware=context.info.hardware,
        timings=timings,
    )
    tracer.trace_path_set(0)  # compiles what is left to compile
    tracer.take()
    return tracer


def _stages(context: Context, scene: Scene, sets: int = 24) -> dict[str, float]:
    tracer = _tracer(context, scene, 0, timings=True)
    each: dict[str, list[float]] = {}
    for index in range(sets):
        tracer.stopwatch.milliseconds.clear()
        tracer.trace_path_set(index)
        for stage, ms in tracer.stopwatch.milliseconds.items():
            each.setdefault(stage, []).append(ms)
    return {f"ms_per_set.{stage}": float(np.median(ms)) for stage, ms in each.items()}


def _trace(
    context: Context, scene: Scene, seed: int, measured: dict[str, float]
) -> tuple[list[float], list[Float64]]:
    """Milliseconds per set between any two of _SETS, and the picture at each of them."""
    tracer = _tracer(context, scene, seed)
    total: Float64 = np.zeros((*scene.camera.resolution[::-1], 3))
    done, ms, images = 0, [], []
    for sets in _SETS:
        start = time.perf_counter()
        for index in range(done, sets):
            tracer.trace_path_set(index)
        total = total + tracer.take()
        ms.append(1e3 * (time.perf_counter() - start) / (sets - done))
        done = sets
        images.append(total / sets)
    counts = tracer.statistics()
    measured["lost_share"] = float(counts["paths_lost"]) / float(counts["paths_cast"])  # type: ignore[arg-type]
    return ms, images


def _fit(samples: tuple[int, ...], errors: Float64) -> tuple[float, float]:
    """Slope of log(error) over log(samples), and the samples to TARGET on that line."""
    slope, offset = np.polyfit(np.log(samples), np.log(errors), 1)
    return float(slope), float(np.exp((np.log(TARGET) - offset) / slope))
