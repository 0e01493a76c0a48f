"""Programs at equal error: their pictures at a few numbers of samples, against one converged picture.

Error is relMSE = mean(e^2 / (ref^2 + 0.01)), less the reference's own, which adds to it, as the two share no
sample. The times of a program and its errors come from the same renders, and the programs take turns, as shared
machines drift.

Mitsuba is the peer that a verdict is about. Cycles and Radiance join where they are installed; one that finds
another picture, by its mean or as its error does not get to the target, is reported and compared with nothing.
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
#: A reference's own relMSE may be this share of the target.
REFERENCE_SHARE = 0.25
#: By how much the mean of another program's picture may be off, or it is another picture.
SAME_MEAN = 0.01
#: A seed that is not measured.
PILOT = 999
# Shipped references have the first ones.
_PEER_SEED = 10_000
# Numbers of samples grow by no more.
_MOST_GROWTH = 64.0
CYCLES_SAMPLES = (64, 128, 256)


@dataclass
class Contestant:
    """A program: `draw(counts, seed)` gives milliseconds per sample and the picture at each number of samples.

    unit     : what its samples are called in the report
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
        """More samples where the first number's error says that the last does not come to the target."""
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
        """Of the report's table."""
        return [
            {"program": name, "samples": n, "relmse": float(e), "s": self.before_s + 1e-3 * n * self.ms_per_sample}
            for n, e in zip(self.counts, self.error, strict=True)
        ]


def error_of(image: Float64, truth: Reference) -> float:
    """relMSE to the reference, less what the reference's own adds, where that is known."""
    return max(relative_mse(image, truth.image) - float(np.nan_to_num(truth.relmse)), 1e-12)


@contextmanager
def other_peers(
    scene: Scene, depth: int, truth: Reference, notes: list[str], scale: float = 1.0
) -> Iterator[dict[str, Contestant]]:
    """Cycles, running as long as the block, where it is installed; what is left out is noted."""
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
    """`vs_NAME`, the time of another program over ours; nothing where its picture is another one."""
    off, needed = measured.get(f"{name}_mean_off", np.nan), measured.get(f"{name}_s", np.nan)
    return {f"vs_{name}": needed / seconds} if off <= SAME_MEAN and np.isfinite(needed) else {}


def radiance_row(
    scene: Scene, truth: Reference, notes: list[str]
) -> tuple[dict[str, float], list[dict[str, object]]]:
    """Radiance's picture with its ambient cache, biased: numbers and a row; none where it is absent, noted."""
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
    """What programs are compared on: a scene that all can have, Mitsuba's of it, and the converged picture.

    peer  : makes Mitsuba's scene, see `mitsuba_scenes`; None without it
    truth : None where there is no reference
    notes : on these, for the report
    """

    scene: Scene
    peer: Callable[[int], Any] | None
    truth: Reference | None
    notes: list[str]

    @classmethod
    def of(cls, scene: Scene, depth: int, reference: str | Path | None, target: float, say: Say) -> Ground:
        """reference: a picture that is given; else the shipped one, else Mitsuba's, good enough for the target."""
        scene, notes = mitsuba_peer.comparable(scene)
        peer = mitsuba_scenes(scene, depth, notes)
        truth = reference_picture(reference, scene, depth, peer is not None, REFERENCE_SHARE * target, say)
        if truth is None:
            notes.append("without a reference: no errors. Give one (--reference), or install the reference extra.")
        else:
            notes.append(f"reference: {_without_machine(truth.source)}")
        return cls(scene, peer, truth, notes)


def scaled(counts: tuple[int, ...], scale: float) -> tuple[int, ...]:
    """Fewer samples, below a scale of 1; numbers that become equal are one."""
    return tuple(sorted({max(1, round(scale * n)) for n in counts}))


def mitsuba_scenes(scene: Scene, depth: int, notes: list[str]) -> Callable[[int], Any] | None:
    """Makes Mitsuba's scene for a number of samples (its strata depend on it); None without the extra, noted."""
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
    """Compile what is left to compile."""
    tracer.trace_path_set(0)
    tracer.take()


def _without_machine(source: str) -> str:
    """The file of a reference, by what is the same on every machine."""
    path, ours = Path(source), Path(__file__).parents[2]
    return str(path.relative_to(ours)) if path.is_relative_to(ours) else path.name


def stage_times(tracer: PathSetEngine, sets: int = 24) -> dict[str, float]:
    """Milliseconds of each stage, the median over path sets of a tracer that times them."""
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
    """Milliseconds per path set between any two of `counts`, and the picture at each of them.

    finish : what is done with a picture of so many sets, not timed
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
    """Mitsuba's milliseconds per sample of all pixels, and its picture, at each number of samples.

    Of the first seed, each number's kernel is compiled before.
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
    """By how much the mean of pictures with such means is off that of the converged one: |ratio - 1|."""
    return abs(float(np.mean(means)) / float(truth.mean()) - 1)


def line_to_target(samples: Sequence[int], errors: Float64, target: float) -> tuple[float, float]:
    """Of the straight line through log(error) over log(samples): its slope, and the samples to the target."""
    slope, offset = np.polyfit(np.log(samples), np.log(errors), 1)
    with np.errstate(over="ignore"):  # endless where the error does not fall
        return float(slope), float(np.exp((np.log(target) - offset) / slope))


def samples_to_target(samples: Sequence[int], errors: Float64, target: float) -> float:
    """The samples to the target on the polyline through log(error) over log(samples); NaN where that ends above it.

    For errors that have a floor, below which a straight line would promise too much.
    """
    below = np.flatnonzero(errors <= target)
    if not len(below):
        return float("nan")
    i = int(below[0])
    if i == 0:
        # Not extrapolated: the first number of samples is enough.
        return float(samples[0])
    (x0, x1), (y0, y1) = np.log(samples[i - 1 : i + 1]), np.log(errors[i - 1 : i + 1])
    return float(np.exp(x0 + (np.log(target) - y0) * (x1 - x0) / (y1 - y0)))
