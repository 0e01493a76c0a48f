"""Two programs at equal error: their pictures at a few numbers of samples, against one converged picture.

Error is relMSE = mean(e^2 / (ref^2 + 0.01)). The times of a program and its errors come from the same renders, and
the programs take turns, as shared machines drift.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from glpath.bench import mitsuba_peer
from glpath.errors import GlpathError
from glpath.experiments.references import find_reference
from glpath.film import read_image
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.rendering.factory import Engine
from glpath.scene import load_scene
from glpath.scene.model import Float64, Scene

Say = Callable[[str], None]

_REFERENCE_SPP = 4096


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


def reference_picture(given: str | Path | None, name: str, depth: int, mitsuba: bool, say: Say) -> Float64 | None:
    """The image of a file; by default the one that ships, else Mitsuba makes one; None without both."""
    if given is not None:
        return read_image(given)
    stored = find_reference(name, depth)
    if stored is not None or not mitsuba:
        return stored
    say(f"no stored reference: Mitsuba renders one of {_REFERENCE_SPP} samples")
    scene = load_scene(name)
    parts = [mitsuba_peer.render_mitsuba(scene, _REFERENCE_SPP // 4, depth, seed=1000 + i) for i in range(4)]
    reference: Float64 = np.mean(parts, axis=0)
    return reference


def warm_up(tracer: Engine) -> None:
    """Compile what is left to compile."""
    tracer.trace_path_set(0)
    tracer.take()


def stage_times(tracer: PathSetEngine, sets: int = 24) -> dict[str, float]:
    """Milliseconds of each stage, the median over path sets of a tracer that times them."""
    each: dict[str, list[float]] = {}
    for index in range(sets):
        tracer.stopwatch.milliseconds.clear()
        tracer.trace_path_set(index)
        for stage, ms in tracer.stopwatch.milliseconds.items():
            each.setdefault(stage, []).append(ms)
    return {stage: float(np.median(ms)) for stage, ms in each.items()}


def trace_in_steps(tracer: Engine, counts: Sequence[int]) -> tuple[list[float], list[Float64]]:
    """Milliseconds per path set between any two of `counts`, and the picture at each of them."""
    total: Float64 | float = 0.0
    done, ms, images = 0, [], []
    for sets in counts:
        start = time.perf_counter()
        for index in range(done, sets):
            tracer.trace_path_set(index)
        total = total + tracer.take()
        ms.append(1e3 * (time.perf_counter() - start) / (sets - done))
        done = sets
        images.append(total / sets)
    return ms, images


def render_peer_in_steps(
    peer: Callable[[int], Any], samples: Sequence[int], depth: int, seed: int
) -> tuple[list[float], list[Float64]]:
    """Mitsuba's milliseconds per sample of all pixels, and its picture, at each number of samples."""
    ms, images = [], []
    for spp in samples:
        timing = mitsuba_peer.time_to_render(peer(spp), spp, depth, repeats=1, seed=seed)
        ms.append(1e3 * float(timing.seconds[0]) / spp)
        images.append(timing.images[0])
    return ms, images


def mean_off(means: Sequence[float] | Float64, truth: Float64) -> float:
    """By how much the mean of pictures with such means is off that of the converged one: |ratio - 1|."""
    return abs(float(np.mean(means)) / float(truth.mean()) - 1)


def line_to_target(samples: Sequence[int], errors: Float64, target: float) -> tuple[float, float]:
    """Of the straight line through log(error) over log(samples): its slope, and the samples to the target."""
    slope, offset = np.polyfit(np.log(samples), np.log(errors), 1)
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
