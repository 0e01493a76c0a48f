"""Seconds to an error relative to each program's own mean, for scenes whose pictures differ slightly by program.

relMSE = mean of (variance of a picture / (mean^2 + 0.01)), over renders with different seeds. For the gather, the
error includes its bias, the distance of its mean from that of unbiased paths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.benches.equal_error import TARGET, render_peer_in_steps, scaled, trace_in_steps
from benchmarks.benches.gather import DEPTH, gather_engine, path_engine_of, solve
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.gl.context import Context, get_context
from glpath.radiosity.solution import RadiositySolution
from glpath.scene.model import Float64, Scene
from glpath.system.versions import versions

_LEAST = 1e-2
# Path sets of a picture, and samples of a picture by Mitsuba.
_SETS, _SAMPLES = 64, 256


@dataclass
class Program:
    """Program whose `draw(samples, seed)` returns milliseconds per sample and the picture."""

    samples: int
    draw: Callable[[int, int], tuple[float, Float64]]
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
        """RelMSE of one picture."""
        return float(np.mean(np.var(self.pictures, axis=0, ddof=1) / (self.mean**2 + _LEAST)))

    @property
    def ms_per_sample(self) -> float:
        return float(np.median(self.ms))


def beside_mitsuba(
    context: Context, scene: Scene, solution: RadiositySolution, peer: Any, sets: int, samples: int
) -> dict[str, Program]:
    """Return the gather and the paths with `sets` path sets, and Mitsuba's scene `peer` with `samples` samples."""

    def gather(sets: int, seed: int) -> tuple[float, Float64]:
        (ms,), (picture,) = trace_in_steps(gather_engine(context, scene, solution, seed), (sets,))
        return ms, picture

    def path(sets: int, seed: int) -> tuple[float, Float64]:
        (ms,), (picture,) = trace_in_steps(path_engine_of(context, scene, solution, seed), (sets,))
        return ms, picture

    def mitsuba(samples: int, seed: int) -> tuple[float, Float64]:
        (ms,), (picture,) = render_peer_in_steps(lambda spp: peer, (samples,), DEPTH, seed)
        return ms, picture

    return {"gather": Program(sets, gather), "path": Program(sets, path), "mitsuba": Program(samples, mitsuba)}


def to_target(
    programs: dict[str, Program], seeds: int, solver_s: float, progress: Callable[[str], None]
) -> dict[str, float]:
    """Render in turns, and return the numbers of each program for `measured`.

    seeds    : number of pictures of each program, at least two
    solver_s : seconds of the solver, which count for all programs except Mitsuba
    """
    for seed in range(max(seeds, 2)):
        progress(f"render {seed + 1} of {max(seeds, 2)}")
        for program in programs.values():
            program.run(seed)
    bias = bias_of(programs["gather"], programs["path"])
    measured = {"gather_bias_relmse": bias}
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
    return measured


def compare(
    name: str,
    scene: Scene,
    peer: Any,
    rules: tuple[tuple[Condition, ...], tuple[Condition, ...]],
    seeds: int,
    scale: float,
    progress: Callable[[str], None],
    notes: Sequence[str] = (),
) -> Report:
    """Return the report of a bench that compares gather, paths and Mitsuba's scene `peer` at the target error.

    name  : name of the bench
    rules : conditions of the claim, and conditions that all programs did the same work
    seeds : pictures of each program, two at least
    scale : below 1, fewer samples for all programs
    """
    context = get_context()
    progress("radiosity")
    solve(scene)
    solver_s, solution = solve(scene)
    (sets,), (samples,) = scaled((_SETS,), scale), scaled((_SAMPLES,), scale)
    programs = beside_mitsuba(context, scene, solution, peer, sets, samples)
    measured = {"solver_s": solver_s} | to_target(programs, seeds, solver_s, progress)
    claim, holds = judge(f"{scene.name} to relMSE {TARGET:g} with all bounces, beside Mitsuba", rules[0], measured)
    rows: list[dict[str, float | str]] = [
        {"program": program, "samples": of.samples, "relmse": of.relmse, "s": measured[f"{program}_s"]}
        for program, of in programs.items()
    ]
    return Report(
        name=name,
        claim=claim,
        measured=measured,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "numba", "mitsuba") | {"driver": context.info.driver},
        notes=list(notes),
        faults=faults(rules[1], measured),
    )


def bias_of(biased: Program, unbiased: Program) -> float:
    """Return the relMSE of one program's mean against the other's, without the noise of both."""
    noise = sum(np.var(each.pictures, axis=0, ddof=1) / len(each.pictures) for each in (biased, unbiased))
    squares = (biased.mean - unbiased.mean) ** 2 - noise
    return max(float(np.mean(squares / (unbiased.mean**2 + _LEAST))), 0.0)
