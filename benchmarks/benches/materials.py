"""Time to an error in a room with textures, glass and metal, beside Mitsuba 3 with the materials that it has.

Mitsuba's formulas of metal, plastic and thin glass are not glTF's, so that the pictures differ by a little. Each
program's noise is therefore taken beside its own mean: relMSE = mean of (variance of a picture / (mean^2 + 0.01)),
over renders of other seeds. The gather has a bias as well, its distance from the unbiased paths, which counts.

measured, of `gather`, `path` and `mitsuba`:
    NAME_ms_per_sample : milliseconds of a path set, or of a sample of all pixels
    NAME_relmse        : noise of a picture of NAME_samples
    gather_bias_relmse : the gather's mean beside the paths', the noise of both taken off
    solver_s           : of the radiosity solution, which counts for the gather and for the paths
    NAME_s             : seconds to the target
    vs_mitsuba, path_vs_mitsuba : Mitsuba's seconds over the gather's and over the paths'
    mitsuba_mean_off   : of Mitsuba's picture, beside the paths'
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.benches.equal_error import TARGET, mitsuba_scenes, render_peer_in_steps, scaled, trace_in_steps
from benchmarks.benches.gather import DEPTH, gather_engine, path_engine_of, solve
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.errors import GlpathError
from glpath.gl.context import get_context
from glpath.io import load_scene
from glpath.io.export.mitsuba import MitsubaScene, described
from glpath.scene.model import Float64
from glpath.scene.triangulate import path_traceable
from glpath.system.versions import versions

SCENE, RESOLUTION = "parlour", (128, 96)
_SETS, _SAMPLES = 64, 256
_LEAST = 1e-2
AGREEMENT = (Condition("mitsuba_mean_off", "<=", 0.05),)
RULE = (*AGREEMENT, Condition("vs_mitsuba", ">=", 5.0), Condition("path_vs_mitsuba", ">=", 2.0))
_Steps = Callable[[int, int], tuple[float, Float64]]


@dataclass
class Program:
    """A program: `draw(samples, seed)` gives milliseconds a sample, and the picture."""

    samples: int
    draw: _Steps
    ms: list[float] = field(default_factory=list)
    pictures: list[Float64] = field(default_factory=list)

    def run(self, seed: int) -> None:
        ms, picture = self.draw(self.samples, seed)
        self.ms.append(ms)
        self.pictures.append(picture)

    @property
    def mean(self) -> Float64:
        return np.asarray(np.mean(self.pictures, axis=0))

    @property
    def relmse(self) -> float:
        """Of one picture."""
        return float(np.mean(np.var(self.pictures, axis=0, ddof=1) / (self.mean**2 + _LEAST)))

    @property
    def ms_per_sample(self) -> float:
        return float(np.median(self.ms))


def bench_materials(
    seeds: int = 3, scale: float = 1.0, progress: Callable[[str], None] = lambda text: None
) -> Report:
    """Measure.

    seeds : pictures of each program beyond the first, which is two at least
    scale : below 1, fewer samples of all
    Raises GlpathError without Mitsuba.
    """
    context = get_context()
    notes: list[str] = []
    scene = path_traceable(load_scene(SCENE).with_camera(resolution=RESOLUTION))
    translated = described(scene, DEPTH, instances=False)
    if mitsuba_scenes(scene, DEPTH, notes) is None:
        raise GlpathError(f"bench materials: {notes[-1]}", "Install the extra reference.")
    notes += [f"Mitsuba's own: {difference}" for difference in translated.differences]
    peer = mitsuba_peer.in_memory(MitsubaScene(translated.plugins, ()))
    progress("radiosity")
    solve(scene)
    solver_s, solution = solve(scene)

    def gather(sets: int, seed: int) -> tuple[float, Float64]:
        (ms,), (picture,) = trace_in_steps(gather_engine(context, scene, solution, seed), (sets,))
        return ms, picture

    def path(sets: int, seed: int) -> tuple[float, Float64]:
        (ms,), (picture,) = trace_in_steps(path_engine_of(context, scene, solution, seed), (sets,))
        return ms, picture

    def mitsuba(samples: int, seed: int) -> tuple[float, Float64]:
        (ms,), (picture,) = render_peer_in_steps(lambda spp: peer, (samples,), DEPTH, seed)
        return ms, picture

    (sets,), (samples,) = scaled((_SETS,), scale), scaled((_SAMPLES,), scale)
    programs = {
        "gather": Program(sets, gather),
        "path": Program(sets, path),
        "mitsuba": Program(samples, mitsuba),
    }
    for seed in range(max(seeds, 2)):
        progress(f"render {seed + 1} of {max(seeds, 2)}")
        for program in programs.values():
            program.run(seed)
    measured = {"solver_s": solver_s}
    bias = bias_of(programs["gather"], programs["path"])
    measured["gather_bias_relmse"] = bias
    for name, program in programs.items():
        left = TARGET - (bias if name == "gather" else 0.0)
        needed = program.samples * program.relmse / left if left > 0 else float("nan")
        before = 0.0 if name == "mitsuba" else solver_s
        measured |= {
            f"{name}_ms_per_sample": program.ms_per_sample,
            f"{name}_samples": float(program.samples),
            f"{name}_relmse": program.relmse,
            f"{name}_samples_to_target": needed,
            f"{name}_s": before + 1e-3 * needed * program.ms_per_sample,
        }
    measured["vs_mitsuba"] = measured["mitsuba_s"] / measured["gather_s"]
    measured["path_vs_mitsuba"] = measured["mitsuba_s"] / measured["path_s"]
    measured["mitsuba_mean_off"] = abs(programs["mitsuba"].mean.mean() / programs["path"].mean.mean() - 1)
    claim, holds = judge(f"{SCENE} to relMSE {TARGET:g} with all bounces, beside Mitsuba", RULE, measured)
    return Report(
        name="materials",
        claim=claim,
        measured=measured,
        holds=holds,
        rows=[
            {"program": name, "samples": program.samples, "relmse": program.relmse, "s": measured[f"{name}_s"]}
            for name, program in programs.items()
        ],
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "numba", "mitsuba") | {"driver": context.info.driver},
        notes=notes,
        faults=faults(AGREEMENT, measured),
    )


def bias_of(biased: Program, unbiased: Program) -> float:
    """relMSE of the mean of one beside that of the other, without the noise of both."""
    noise = sum(np.var(each.pictures, axis=0, ddof=1) / len(each.pictures) for each in (biased, unbiased))
    squares = (biased.mean - unbiased.mean) ** 2 - noise
    return max(float(np.mean(squares / (unbiased.mean**2 + _LEAST))), 0.0)
