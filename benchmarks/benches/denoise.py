"""Time until pictures reach an error with a denoiser: the gather and path tracing compared with Mitsuba.

All bounces of light are rendered, and all programs use Open Image Denoise with albedo and normals. glpath renders
these with its samples; Mitsuba renders them separately, which is faster for it. A program's time to N samples
includes its solver, its AOVs and the denoiser. Times and errors come from the same renders, and the programs take
turns. Numbers of samples double until a pilot render is well below the target. `measured`:

    denoise_s                       : seconds of the denoiser for one picture
    solver_s, guide_s               : seconds of the radiosity solution, and of the gather's path guides
    gather_ms_per_set               : milliseconds of a path set with AOVs
    gather_relmse_N                 : error at N path sets after denoising, mean over seeds
    gather_sets_to_target, gather_s : path sets to the target; seconds, including solver and denoiser
    path_..., mitsuba_...           : the same for path tracing guided by the solution, and for Mitsuba
    vs_mitsuba, path_vs_mitsuba     : Mitsuba's time divided by the gather's, and by path tracing's
    ..._mean_off                    : relative difference between the means of the largest and the converged picture
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.benches.equal_error import (
    PILOT,
    Contestant,
    Ground,
    Say,
    Steps,
    error_of,
    mean_off,
    render_peer_in_steps,
    trace_in_steps,
)
from benchmarks.benches.gather import DEPTH, SCENE, gather_engine, guiding_seconds, path_engine_of, solve, summary
from benchmarks.peers.mitsuba import time_aovs
from benchmarks.references.kept import Reference
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.film.aovs import DENOISER_AOVS
from glpath.film.denoise import Guides, denoised, require_denoiser
from glpath.gl.context import get_context
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.io import load_scene
from glpath.scene.model import Float64, Scene
from glpath.system.versions import versions

#: Target relMSE of a picture after denoising.
TARGET = 5e-4
# Samples of Mitsuba's albedo and normals, which it renders separately; more do not reduce the error.
_AOV_SAMPLES = 16
# Mitsuba's strata are squares, so its numbers of samples are squares.
_SETS, _SAMPLES = (4, 8, 16, 32, 64, 128, 256, 512, 1024), (4, 9, 16, 36, 64, 121, 256, 529, 1024)
# The denoiser loses energy at the edges of lamps.
AGREEMENT = tuple(Condition(f"{name}_mean_off", "<=", 0.03) for name in ("gather", "path", "mitsuba"))
RULE = (*AGREEMENT, Condition("vs_mitsuba", ">", 1.0))


def bench_denoise(
    seeds: int = 3,
    reference: str | Path | None = None,
    scene: Scene | None = None,
    say: Say = lambda text: None,
    most: int = 1024,
    target: float = TARGET,
) -> Report:
    """Measure; takes about two minutes on two cores of llvmpipe with Mitsuba. Raises GlpathError without pyoidn.

    seeds, reference, scene, say : see `bench_gather`
    most                         : number of samples at which a program ends that has not reached the target
    target                       : relMSE of the denoised picture
    """
    require_denoiser()
    context = get_context()
    ground = Ground.of(scene or load_scene(SCENE), DEPTH, reference, target, say)
    scene, peer, truth, notes = ground.scene, ground.peer, ground.truth, ground.notes
    say("radiosity")
    solve(scene)  # compiles what is left to compile
    solver_s, solution = solve(scene)
    measured = {"solver_s": solver_s, "guide_s": guiding_seconds(context, scene, solution)}
    denoiser_s: list[float] = []
    aov_s: list[float] = []

    def clean(radiance: Float64, albedo: Float64, normal: Float64) -> Float64:
        start = time.perf_counter()
        picture = denoised(np.maximum(radiance, 0.0), Guides.of(np.clip(albedo, 0.0, 1.0), normal))
        denoiser_s.append(time.perf_counter() - start)
        return picture.astype(np.float64)

    def ours(make: Callable[[int], PathSetEngine]) -> Callable[[tuple[int, ...], int], Steps]:
        return lambda counts, seed: _denoised_steps(make(seed), counts, clean)

    contestants = {
        "gather": Contestant(
            # With so few sets, edges need more path sets rather than branches.
            _SETS,
            ours(lambda seed: gather_engine(context, scene, solution, seed, aovs=DENOISER_AOVS, branches=1)),
            "set",
        ),
        "path": Contestant(
            _SETS, ours(lambda seed: path_engine_of(context, scene, solution, seed, aovs=DENOISER_AOVS)), "set"
        ),
    }
    if peer is not None:

        def theirs(counts: tuple[int, ...], seed: int) -> Steps:
            ms, images = render_peer_in_steps(peer, counts, DEPTH, seed)
            seconds, albedo, normal = time_aovs(peer(_AOV_SAMPLES), _AOV_SAMPLES, seed)
            aov_s.append(seconds)
            return ms, [clean(image, albedo, normal) for image in images]

        contestants["mitsuba"] = Contestant(_SAMPLES, theirs)
    claim = (
        f"the gather, solver and denoiser included, is before Mitsuba with the same denoiser at relMSE {target:g}"
    )
    holds: bool | None = None
    rows: list[dict[str, object]] = []
    if truth is not None:
        for name, contestant in contestants.items():
            say(f"how many samples of {name}")
            contestant.counts = _enough(contestant, truth, most, target)
        for seed in range(seeds):
            say(f"render {seed + 1} of {seeds}")
            for contestant in contestants.values():
                contestant.run(seed, truth)
        measured["denoise_s"] = float(np.median(denoiser_s))
        for name, contestant in contestants.items():
            ours_s, theirs_s = measured["solver_s"] + measured["guide_s"], float(np.median(aov_s or [0.0]))
            contestant.before_s = measured["denoise_s"] + (theirs_s if name == "mitsuba" else ours_s)
            measured |= summary(name, contestant, target)
            measured[f"{name}_mean_off"] = mean_off(contestant.means, truth.image)
            rows += contestant.rows(name)
        if peer is not None:
            measured["vs_mitsuba"] = measured["mitsuba_s"] / measured["gather_s"]
            measured["path_vs_mitsuba"] = measured["mitsuba_s"] / measured["path_s"]
    if all(condition.left in measured for condition in RULE):
        claim, holds = judge(claim, RULE, measured)
    return Report(
        name="denoise",
        claim=claim,
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "pyoidn", "numpy", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
        faults=faults(AGREEMENT, measured),
    )


def _denoised_steps(
    engine: PathSetEngine, counts: Sequence[int], clean: Callable[[Float64, Float64, Float64], Float64]
) -> Steps:
    """Return the result of `trace_in_steps`, with each picture denoised."""
    sums: dict[str, Float64 | float] = dict.fromkeys(DENOISER_AOVS, 0.0)

    def finish(picture: Float64, sets: int) -> Float64:
        for name, found in engine.take_aovs().items():
            sums[name] = sums[name] + found
        albedo, normal = (np.asarray(sums[name]) / sets for name in DENOISER_AOVS)
        return clean(picture, albedo, normal)

    return trace_in_steps(engine, counts, finish)


def _enough(contestant: Contestant, truth: Reference, most: int, target: float) -> tuple[int, ...]:
    """Return the first numbers of samples, up to one whose error is well below the target."""
    for last, count in enumerate(contestant.counts, 1):
        _, images = contestant.draw((count,), PILOT)
        if error_of(images[0], truth) <= 0.8 * target or contestant.counts[last : last + 1] > (most,):
            break
    return contestant.counts[:last]
