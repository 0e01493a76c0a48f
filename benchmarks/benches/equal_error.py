"""Compare programs at equal error, from their pictures at a few numbers of samples and one converged picture.

The error is relMSE = mean(e^2 / (ref^2 + 0.01)) minus the reference's own relMSE, which adds to it because the two
are independent. Times and errors come from the same renders, and the programs take turns, because the speed of
shared machines drifts.

Mitsuba is the program that a verdict is about. Cycles and Radiance join if they are installed. A program whose
picture differs, in its mean or because its error does not reach the target, is reported but not compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.peers import radiance as radiance_peer
from benchmarks.peers.cycles import Cycles, cycles
from benchmarks.references.kept import Reference, reference_picture
from glpath.compare import relative_mse
from glpath.errors import GlpathError
from glpath.integrators.engine import Engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.scene.model import Float64, Scene

Say = Callable[[str], None]
Steps = tuple[Sequence[float], Sequence[Float64]]

TARGET = 1e-3
#: Maximum relMSE of the reference itself, as a fraction of the target.
REFERENCE_SHARE = 0.25
#: Maximum relative difference of another program's mean; above it, the program renders a different picture.
SAME_MEAN = 0.01
#: Seed of pilot renders, which are not measured.
PILOT = 999
# First seed of the peer; shipped references use lower ones.
_PEER_SEED = 10_000
# Maximum factor by which the numbers of samples grow.
_MOST_GROWTH = 64.0
CYCLES_SAMPLES = (64, 128, 256)


@dataclass
class Contestant:
    """Program whose `draw(counts, seed)` returns milliseconds per sample and the picture at each number of samples.

    unit     : name of its samples in the report
    before_s : seconds before its first sample
    """

    counts: tuple[int, ...]
    draw: Callable[[tuple[int, ...], int], Steps]
    unit: str = "sample"
    before_s: float = 0.0
    ms: list[float] = field(default_factory=list)
    errors: list[list[float]] = field(default_factory=list)
    means: list[float] = field(default_factory=list)

    def grow(self, truth: Reference, target: float) -> None:
        """Increase the numbers of samples if the first one's error predicts that the last misses the target."""
        _, images = self.draw(self.counts[:1], PILOT)
        needed = self.counts[0] * error_of(images[0], truth) / target
        if needed > self.counts[-1]:
            factor = min(1.25 * needed / self.counts[-1], _MOST_GROWTH)
            self.counts = tuple(round(factor * n) for n in self.counts)

    def run(self, seed: int, truth: Reference) -> None:
        ms, images = self.draw(self.counts, seed)
        self.ms += ms
        self.errors.append([error_of(image, truth) for image in images])
        self.means.append(float(images[-1].mean()))

    @property
    def ms_per_sample(self) -> float:
        return float(np.median(self.ms))

    @property
    def error(self) -> Float64:
        return np.asarray(np.mean(self.errors, axis=0))

    def rows(self, name: str) -> list[dict[str, object]]:
        """Return the rows of the report's table."""
        return [
            {"program": name, "samples": n, "relmse": float(e), "s": self.before_s + 1e-3 * n * self.ms_per_sample}
            for n, e in zip(self.counts, self.error, strict=True)
        ]


def error_of(image: Float64, truth: Reference) -> float:
    """Return the relMSE to the reference, minus the reference's own relMSE if it is known."""
    return max(relative_mse(image, truth.image) - float(np.nan_to_num(truth.relmse)), 1e-12)


@contextmanager
def other_peers(
    scene: Scene, depth: int, truth: Reference, notes: list[str], scale: float = 1.0
) -> Iterator[dict[str, Contestant]]:
    """Yield Cycles, which runs for the duration of the block, if it is installed; otherwise add a note."""
    with ExitStack() as stack:
        try:
            program = stack.enter_context(cycles(scene, depth))
        except GlpathError as error:
            notes.append(f"without Cycles: {error}")
            yield {}
            return
        program.tune(lambda image: error_of(image, truth))
        counts = scaled(CYCLES_SAMPLES, scale)
        yield {"cycles": Contestant(counts, lambda counts, seed: _draw(program, counts, seed))}
        notes.append(f"Cycles {program.version}: {program.settings}")


def _draw(program: Cycles, counts: Sequence[int], seed: int) -> Steps:
    ms, images = [], []
    for spp in counts:
        seconds, image = program.render(spp, seed)
        ms.append(1e3 * seconds / spp)
        images.append(image)
    return ms, images


def compared_with(name: str, measured: Mapping[str, float], seconds: float) -> dict[str, float]:
    """Return `vs_NAME`, the time of another program divided by ours; empty if its picture is a different one."""
    off, needed = measured.get(f"{name}_mean_off", np.nan), measured.get(f"{name}_s", np.nan)
    return {f"vs_{name}": needed / seconds} if off <= SAME_MEAN and np.isfinite(needed) else {}


def radiance_row(
    scene: Scene, truth: Reference, notes: list[str]
) -> tuple[dict[str, float], list[dict[str, object]]]:
    """Return numbers and a row for Radiance's picture with its ambient cache; a note if it is missing."""
    try:
        seconds, image = radiance_peer.render(scene)
    except GlpathError as error:
        notes.append(f"without Radiance: {error}")
        return {}, []
    relmse = error_of(image, truth)
    off = mean_off([float(image.mean())], truth.image)
    program = f"pyradiance {radiance_peer.version()}"
    notes.append(f"Radiance ({program}): rpict {radiance_peer.SETTINGS}; biased, by its cache of ambient light")
    return (
        {"radiance_s": seconds, "radiance_relmse": relmse, "radiance_mean_off": off},
        [{"program": "radiance", "samples": "cache", "relmse": relmse, "s": seconds}],
    )


@dataclass(frozen=True)
class Ground:
    """Basis of a comparison: a scene that all programs support, Mitsuba's version of it, and the converged picture.

    peer  : function that makes Mitsuba's scene, see `mitsuba_scenes`; None without Mitsuba
    truth : converged picture; None if there is no reference
    notes : notes for the report
    """

    scene: Scene
    peer: Callable[[int], Any] | None
    truth: Reference | None
    notes: list[str]

    @classmethod
    def of(cls, scene: Scene, depth: int, reference: str | Path | None, target: float, say: Say) -> Ground:
        """Return the basis for a scene. The reference is `reference`, else the shipped one, else Mitsuba's."""
        scene, notes = mitsuba_peer.comparable(scene)
        peer = mitsuba_scenes(scene, depth, notes)
        truth = reference_picture(reference, scene, depth, peer is not None, REFERENCE_SHARE * target, say)
        if truth is None:
            notes.append("without a reference: no errors. Give one (--reference), or install the reference extra.")
        else:
            notes.append(f"reference: {_without_machine(truth.source)}")
        return cls(scene, peer, truth, notes)


def scaled(counts: tuple[int, ...], scale: float) -> tuple[int, ...]:
    """Return smaller numbers of samples for a scale below 1; equal numbers are merged."""
    return tuple(sorted({max(1, round(scale * n)) for n in counts}))


def mitsuba_scenes(scene: Scene, depth: int, notes: list[str]) -> Callable[[int], Any] | None:
    """Return a function from a number of samples to Mitsuba's scene; None, with a note, if the extra is missing."""
    try:
        mitsuba_peer.load_mitsuba()
    except GlpathError as error:
        notes.append(f"without Mitsuba: {error}")
        return None
    note = mitsuba_peer.best_variant()[1]
    if note:
        notes.append(note)
    return lambda spp: mitsuba_peer.to_mitsuba(scene, depth, spp=spp)


def warm_up(tracer: Engine) -> None:
    """Compile the remaining kernels and shaders."""
    tracer.trace_path_set(0)
    tracer.take()


def _without_machine(source: str) -> str:
    """Return the file of a reference without the part of its path that depends on the machine."""
    path, ours = Path(source), Path(__file__).parents[2]
    return str(path.relative_to(ours)) if path.is_relative_to(ours) else path.name


def stage_times(tracer: PathSetEngine, sets: int = 24) -> dict[str, float]:
    """Return the milliseconds of each stage: medians over path sets of a tracer with timings."""
    each: dict[str, list[float]] = {}
    for index in range(sets):
        tracer.stopwatch.milliseconds.clear()
        tracer.trace_path_set(index)
        for stage, ms in tracer.stopwatch.milliseconds.items():
            each.setdefault(stage, []).append(ms)
    return {stage: float(np.median(ms)) for stage, ms in each.items()}


def trace_in_steps(
    tracer: Engine, counts: Sequence[int], finish: Callable[[Float64, int], Float64] | None = None
) -> Steps:
    """Return milliseconds per path set between successive `counts`, and the picture at each of them.

    finish : function applied to a picture and its number of sets, not timed
    """
    total: Float64 | float = 0.0
    done, ms, images = 0, [], []
    for sets in counts:
        start = time.perf_counter()
        for index in range(done, sets):
            tracer.trace_path_set(index)
        total = total + tracer.take()
        ms.append(1e3 * (time.perf_counter() - start) / (sets - done))
        done = sets
        images.append(total / sets if finish is None else finish(total / sets, sets))
    return ms, images


def render_peer_in_steps(
    peer: Callable[[int], Any], samples: Sequence[int], depth: int, seed: int
) -> tuple[list[float], list[Float64]]:
    """Return Mitsuba's milliseconds per sample of all pixels, and its picture, at each number of samples.

    For the first seed, each number's kernel is compiled beforehand.
    """
    ms, images = [], []
    for spp in samples:
        timing = mitsuba_peer.time_to_render(
            peer(spp), spp, depth, repeats=1, seed=_PEER_SEED + seed, warm=0 < seed < PILOT
        )
        ms.append(1e3 * float(timing.seconds[0]) / timing.spp)
        images.append(timing.images[0])
    return ms, images


def mean_off(means: Sequence[float] | Float64, truth: Float64) -> float:
    """Return |ratio - 1|, where the ratio is that of the mean of pictures to the mean of the converged one."""
    return abs(float(np.mean(means)) / float(truth.mean()) - 1)


def line_to_target(samples: Sequence[int], errors: Float64, target: float) -> tuple[float, float]:
    """Return the slope of the straight line through log(error) over log(samples), and the samples at the target."""
    slope, offset = np.polyfit(np.log(samples), np.log(errors), 1)
    with np.errstate(over="ignore"):  # infinite if the error does not fall
        return float(slope), float(np.exp((np.log(target) - offset) / slope))


def samples_to_target(samples: Sequence[int], errors: Float64, target: float) -> float:
    """Interpolate the samples at the target, linear in log(error) and log(samples); NaN if not reached.

    Use this for errors with a floor, below which a straight line would promise too much.
    """
    below = np.flatnonzero(errors <= target)
    if not len(below):
        return float("nan")
    i = int(below[0])
    if i == 0:
        # Do not extrapolate; the first number of samples is enough.
        return float(samples[0])
    (x0, x1), (y0, y1) = np.log(samples[i - 1 : i + 1]), np.log(errors[i - 1 : i + 1])
    return float(np.exp(x0 + (np.log(target) - y0) * (x1 - x0) / (y1 - y0)))
