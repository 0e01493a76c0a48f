"""Seconds to an error that is taken beside each program's own mean, for scenes whose pictures differ by a little.

relMSE = mean of (variance of a picture / (mean^2 + 0.01)), over renders of other seeds. The gather has a bias as
well, its distance from the unbiased paths, which counts.
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
# Path sets of a picture, and samples of Mitsuba's.
_SETS, _SAMPLES = 64, 256


@dataclass
class Program:
    """A program: `draw(samples, seed)` gives milliseconds a sample, and the picture."""

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
        """Of one picture."""
        return float(np.mean(np.var(self.pictures, axis=0, ddof=1) / (self.mean**2 + _LEAST)))

    @property
    def ms_per_sample(self) -> float:
        return float(np.median(self.ms))


def beside_mitsuba(
    context: Context, scene: Scene, solution: RadiositySolution, peer: Any, sets: int, samples: int
) -> dict[str, Program]:
    """The gather and the paths of so many sets, and Mitsuba's scene `peer` with so many samples."""

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
    """What `measured` has of each program, after renders in turns.

    seeds    : pictures of each, two at least
    solver_s : which counts for all but Mitsuba
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
    """The report of a bench: the gather, the paths and Mitsuba's scene `peer`, in turns, to the target.

    name  : of the bench
    rules : conditions that the claim holds, and such without which the programs did not do the same work
    seeds : pictures of each program, two at least
    scale : below 1, fewer samples of all
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
    """relMSE of the mean of one beside that of the other, without the noise of both."""
    noise = sum(np.var(each.pictures, axis=0, ddof=1) / len(each.pictures) for each in (biased, unbiased))
    squares = (biased.mean - unbiased.mean) ** 2 - noise
    return max(float(np.mean(squares / (unbiased.mean**2 + _LEAST))), 0.0)
