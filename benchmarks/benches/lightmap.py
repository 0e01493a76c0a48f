"""Lightmaps of the shipped `room`, compared with Cycles' bake of the same triangles, lamps and texels.

Both programs get the same atlas, whose making is not timed. Our time is from the triangles to the finished page,
including seams, gutters and a radiosity solution. Cycles' time is its call of bake (type DIFFUSE, direct and
indirect without colour, which is irradiance over pi), after a first call. It gets the scene of `cycles_peer`, with
the settings from `CANDIDATES` whose product of error and time is the smallest.

Texels are compared in the interior of charts, because programs treat cut texels differently. Errors are root mean
squares of luminance, relative to the local light (smoothed, plus a tenth of its mean). They have two parts: noise,
from two runs with different seeds, and a systematic error, from the covariance of two runs' differences to two runs
of our unbiased path tracer. The noise of the four runs is independent, so no reference needs to be free of noise.
For Cycles, only noise counts, because its texels may be filtered differently. The time to an error is a + b n
seconds, where n is the number of samples at which noise^2 = c / n meets the error; a, b and c are from runs of two
lengths. The rows have it for each of `LEVELS`: the larger the error, the more a program's time before its first
sample counts. `measured`, for each SIZE of the page, at `LEVEL`:

    cycles_off_SIZE   : relative difference of the mean of Cycles from that of our path tracer
    gather_off_SIZE   : the same for the gather
    cycles_s_SIZE, path_s_SIZE, gather_s_SIZE : times to the error; NaN if the systematic error alone is larger
    vs_cycles_SIZE    : Cycles' time divided by the smaller of ours
    atlas_s_SIZE      : xatlas's time for the common atlas
    MiB_SIZE, cycles_MiB_SIZE : peak memory of the processes so far

Source: Blender 5.0, https://www.cycles-renderer.org
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter

from benchmarks.peers import cycles as cycles_peer
from benchmarks.peers.mitsuba import comparable
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.apps.lightmap.atlas import packed
from glpath.apps.lightmap.lightmap import Lightmap
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.errors import GlpathError
from glpath.gl.context import Context, get_context
from glpath.io import load_scene
from glpath.rendering import run
from glpath.rendering.job import describe
from glpath.rendering.sides import Sides
from glpath.scene.model import Float64
from glpath.scene.triangulate import path_traceable
from glpath.system.colour import luminance
from glpath.system.machine import peak_resident_bytes
from glpath.system.versions import versions

Say = Callable[[str], None]
Draw = Callable[[int, int], tuple[float, Float64]]
Bools = NDArray[np.bool_]

SCENE = "room"
#: Scene on pages that are too small for the room's 1800 charts, and the page side below which it is used.
SMALL, _SMALL_BELOW = "cornell-box-36", 256
Counts = tuple[int, int]
#: Sides of pages, and for each program the samples per texel of the short and of the two long runs.
SIZES: dict[int, dict[str, Counts]] = {
    512: {"path": (4, 16), "gather": (8, 32), "cycles": (32, 256)},
    1024: {"path": (1, 4), "gather": (4, 16), "cycles": (8, 48)},
}
#: Errors to which times are measured. At the second, a page is still visibly noisy; at `LEVEL` it begins to be
#: usable.
LEVELS = (0.4, 0.2, 0.1, 0.05)
LEVEL = 0.1
#: Maximum depth. Longer paths carry less than a thousandth of the room's light.
DEPTH = 16
CLAIM = f"lightmaps of the room take a fifth of the time of Cycles' bake, to an error of {LEVEL:.0%}"
AGREEMENT = tuple(Condition(f"{name}_off_{size}", "<=", 0.02) for name in ("cycles", "gather") for size in SIZES)
RULE = (*AGREEMENT, *(Condition(f"vs_cycles_{size}", ">=", 5.0) for size in SIZES))
#: Minimum distance of compared texels from the edge of a chart, in texels.
_INTERIOR = 2
_SMOOTH = 3.0


@dataclass
class Bakes:
    """Runs of a program: one with few samples, and two with more.

    counts : samples per texel of the first run and of the others
    draw   : function of a number of samples and a seed; returns seconds and irradiance (h, w, 3)
    """

    counts: Counts
    draw: Draw
    seconds: list[float] = field(default_factory=list)
    pages: list[Float64] = field(default_factory=list)

    def run(self, turn: int) -> None:
        seconds, page = self.draw(self.counts[min(turn, 1)], turn + 1)
        self.seconds.append(seconds)
        self.pages.append(luminance(page))

    def noise2(self, weight: Float64) -> float:
        """Return the relative mean square of the noise of the long runs."""
        return float(np.sum(weight * (self.pages[1] - self.pages[2]) ** 2) / 2)

    def systematic2(self, truth: Bakes, weight: Float64) -> float:
        """Return the relative mean square of the systematic error; at least 0."""
        one, other = (self.pages[i] - truth.pages[i] for i in (1, 2))
        return max(float(np.sum(weight * one * other)), 0.0)

    def seconds_to(self, error: float, noise2: float, systematic2: float) -> float:
        """Return the seconds to an error, from the long runs' mean squares; NaN if `systematic2` is larger."""
        wanted2 = error**2 - systematic2
        if wanted2 <= 0:
            return float("nan")
        short, long = self.counts
        least = float(min(self.seconds[1:]))
        each = max(least - self.seconds[0], 0.0) / (long - short) if long > short else least / long
        return max(least - each * long, 0.0) + each * max(1.0, long * noise2 / wanted2)


def interior(surfaces: AtlasSurfaces) -> Bools:
    """Return (h, w) bool for one page: rendered texels far from edges of their chart and from other geometry."""
    width, height = surfaces.atlas.size
    chart = np.full((height, width), -1, np.int64)
    texels = surfaces.texels
    chart[texels.row, texels.column] = np.where(surfaces.inside, -1, surfaces.atlas.chart[texels.face[0]])
    # Charts are several texels apart, so no texel has a neighbour on another chart.
    return np.asarray(binary_erosion(chart >= 0, np.ones((3, 3)), iterations=_INTERIOR))


def weights(page: Float64, where: Bools) -> Float64:
    """Return (h, w) weights that turn squared differences into terms of a relative mean square. page: luminance."""
    inside = where.astype(float)
    smooth = gaussian_filter(page * inside, _SMOOTH) / np.maximum(gaussian_filter(inside, _SMOOTH), 1e-9)
    return np.asarray(inside / (smooth + 0.1 * page[where].mean()) ** 2 / where.sum())


def bench_lightmap(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes about five minutes on two cores.

    scale : below 1, smaller pages under the names of the full-size ones; below a half, pages of a box, because the
            room does not fit
    say   : function that gets messages about the progress
    """
    context = get_context()
    chosen = SMALL if min(SIZES) * scale < _SMALL_BELOW else SCENE
    scene, notes = comparable(load_scene(chosen))
    still = path_traceable(scene.at())
    sides = Sides.of(still)
    numbers: dict[str, float] = {}
    rows: list[dict[str, Any]] = []
    settings: dict[str, bool | float] | None = None
    if scale < 1:
        notes.append(f"at scale {scale:g}, {chosen}")
    for name, counts in SIZES.items():
        size = max(64, round(name * scale))
        say(f"an atlas of {size} x {size}")
        start = time.perf_counter()
        atlas = packed(still, sides.density, None, size)
        numbers[f"atlas_s_{name}"] = time.perf_counter() - start
        surfaces = AtlasSurfaces.on(still, atlas, sides)
        where = interior(surfaces)
        programs = {
            integrator: Bakes(counts[integrator], _ours(context, surfaces, sides, integrator))
            for integrator in ("path", "gather")
        }
        programs["gather"].draw(1, 0)  # compiles; the path tracer compiles in its short run, which comes first
        with ExitStack() as stack:
            peer = None
            try:
                peer = stack.enter_context(cycles_peer.cycles(surfaces, DEPTH))
            except GlpathError as missing:
                notes.append(f"without Cycles: {missing}")
            else:
                if settings is None:
                    peer.tune_bake(partial(_noise2, where))
                    settings = peer.settings
                peer.settings = settings
                notes.append(f"Cycles {peer.version}, {name}: {peer.settings}")
                programs["cycles"] = Bakes(counts["cycles"], peer.bake)
            for turn in range(3):
                for program_name, program in programs.items():
                    say(f"{size} x {size}, {program_name}, turn {turn + 1} of 3")
                    program.run(turn)
            numbers[f"MiB_{name}"] = peak_resident_bytes() / 2**20
            if peer is not None:
                numbers[f"cycles_MiB_{name}"] = peer.peak_bytes / 2**20
        found, some = compared(programs, where)
        numbers |= {f"{key}_{name}": value for key, value in found.items()}
        rows += [{"size": size, "texels": len(surfaces.texels.row), **row} for row in some]
    whole = all(condition.left in numbers for condition in RULE)
    claim, holds = judge(CLAIM, RULE, numbers) if whole else (CLAIM, None)
    return Report(
        name="lightmap",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=rows,
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "xatlas") | _peer_version(),
        notes=list(dict.fromkeys(notes)),
        faults=faults(AGREEMENT, numbers),
    )


def compared(programs: dict[str, Bakes], where: Bools) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Return numbers, without the page's size in their names, and rows of the programs that have run.

    where : (h, w) texels to compare
    """
    truth = programs["path"]
    mean = np.mean([page for program in programs.values() for page in program.pages[1:]], axis=0)
    weight = weights(mean, where)
    level = float(np.mean([page[where].mean() for page in truth.pages[1:]]))
    numbers: dict[str, float] = {}
    parts = {name: (p.noise2(weight), p.systematic2(truth, weight)) for name, p in programs.items()}
    parts["path"] = parts["path"][0], 0.0
    rows = []
    for name, program in programs.items():
        off = float(np.mean([page[where].mean() for page in program.pages[1:]]) / level - 1)
        if name != "path":
            numbers[f"{name}_off"] = abs(off)
        noise2, systematic2 = parts[name]
        if name == "cycles":
            systematic2 = 0.0
        to = {level: program.seconds_to(level, noise2, systematic2) for level in LEVELS}
        numbers[f"{name}_s"] = to[LEVEL]
        rows.append(
            {
                "program": name,
                "samples": program.counts[1],
                "seconds": min(program.seconds[1:]),
                "noise": noise2**0.5,
                "systematic": parts[name][1] ** 0.5,
                "mean off": off,
                **{f"s to {level:.0%}": seconds for level, seconds in to.items()},
            }
        )
    if "cycles" in programs:
        own = np.array([numbers["path_s"], numbers["gather_s"]])
        numbers["vs_cycles"] = numbers["cycles_s"] / float(np.nanmin(own))
    return numbers, rows


def _ours(context: Context, surfaces: AtlasSurfaces, sides: Sides, integrator: str) -> Draw:
    def draw(spp: int, seed: int) -> tuple[float, Float64]:
        start = time.perf_counter()
        made = AtlasSurfaces.on(surfaces.scene, surfaces.atlas, sides)
        job, seen = describe(made.scene, sensor=made.sensor(), spp=spp, integrator=integrator, seed=seed)
        page = Lightmap.of(made, run(job, context, scene=seen)).irradiance[0]
        return time.perf_counter() - start, page.astype(float)

    return draw


def _noise2(where: Bools, one: Float64, other: Float64) -> float:
    a, b = luminance(one), luminance(other)
    return float(np.sum(weights(0.5 * (a + b), where) * (a - b) ** 2) / 2)


def _peer_version() -> dict[str, str]:
    try:
        return {"bpy": cycles_peer.version()}
    except GlpathError:
        return {}
