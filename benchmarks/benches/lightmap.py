"""Lightmaps measured: the shipped `room` beside Cycles' bake of the same triangles, lamps and texels.

Both get the same atlas, whose making is not timed: ours from the triangles and their coordinates to the page, seams
and gutters and a radiosity solution included; Cycles its call of bake (type DIFFUSE, direct and indirect without
colour, which is irradiance over pi), after a first one. It has what `cycles_peer` gives it for pictures, with those
of its settings (`CANDIDATES`) whose error times time is the least.

Texels are compared in the interior of charts, as programs differ in what they do of a texel that is cut. Errors are
root mean squares of luminance, relative to the light there (smoothed, plus a tenth of its mean), in two parts:
noise, from two runs with other seeds, and what is systematic, from the covariance of two runs' differences to two
runs of our path tracer, which has no bias. The noise of the four is independent, so that no reference has to be
free of it. Of Cycles the noise alone counts: its texels may be filtered otherwise. Times to an error are a + b n
seconds, for the n samples of which noise^2 = c / n is as wanted; a, b and c are from runs of two lengths. The rows
have them for each of `LEVELS`: the less is asked, the more counts what a program does before its first sample.
`measured`, for each SIZE of the page, at `LEVEL`:

    cycles_off_SIZE   : relative difference of the means, of Cycles to our path tracer
    gather_off_SIZE   : the same of the gather
    cycles_s_SIZE, path_s_SIZE, gather_s_SIZE : times to it; NaN where what is systematic alone is more
    vs_cycles_SIZE    : Cycles' time over the least of ours
    atlas_s_SIZE      : xatlas's time, of both
    MiB_SIZE, cycles_MiB_SIZE : the most memory of the processes until then

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
from glpath.bake.atlas import packed
from glpath.bake.lightmap import Lightmap, Surfaces
from glpath.bake.sides import Sides
from glpath.errors import GlpathError
from glpath.film.image import luminance
from glpath.gl.context import Context, get_context
from glpath.io import load_scene
from glpath.rendering import run
from glpath.rendering.job import describe
from glpath.scene.model import Float64
from glpath.scene.triangulate import path_traceable
from glpath.system.machine import peak_resident_bytes
from glpath.system.versions import versions

Say = Callable[[str], None]
Draw = Callable[[int, int], tuple[float, Float64]]
Bools = NDArray[np.bool_]

SCENE = "room"
#: In its place on pages that are too small for its 1800 charts.
SMALL, _SMALL_BELOW = "cornell-box-36", 256
Counts = tuple[int, int]
#: Sides of pages, and of each program samples of a texel in the short and in the two long runs.
SIZES: dict[int, dict[str, Counts]] = {
    512: {"path": (4, 16), "gather": (8, 32), "cycles": (32, 256)},
    1024: {"path": (1, 4), "gather": (4, 16), "cycles": (8, 48)},
}
#: Errors that times are to. At the second a page is still visibly noisy: `LEVEL` is where it begins to be of use.
LEVELS = (0.4, 0.2, 0.1, 0.05)
LEVEL = 0.1
#: Longer paths than so carry less than a thousandth of the light of the room.
DEPTH = 16
CLAIM = f"lightmaps of the room take a fifth of the time of Cycles' bake, to an error of {LEVEL:.0%}"
AGREEMENT = tuple(Condition(f"{name}_off_{size}", "<=", 0.02) for name in ("cycles", "gather") for size in SIZES)
RULE = (*AGREEMENT, *(Condition(f"vs_cycles_{size}", ">=", 5.0) for size in SIZES))
#: Texels from the edge of a chart, from which on they are compared.
_INTERIOR = 2
_SMOOTH = 3.0


@dataclass
class Bakes:
    """Of a program: a run of few samples, and two of more.

    counts : samples of a texel, of the first and of the others
    draw   : seconds, and irradiance (h, w, 3), of so many samples with a seed
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
        """Of the long runs, relative."""
        return float(np.sum(weight * (self.pages[1] - self.pages[2]) ** 2) / 2)

    def systematic2(self, truth: Bakes, weight: Float64) -> float:
        """The relative mean square of what is not noise; at least 0."""
        one, other = (self.pages[i] - truth.pages[i] for i in (1, 2))
        return max(float(np.sum(weight * one * other)), 0.0)

    def seconds_to(self, error: float, noise2: float, systematic2: float) -> float:
        """To an error, by the mean squares of the long runs; NaN where what is systematic alone is more."""
        wanted2 = error**2 - systematic2
        if wanted2 <= 0:
            return float("nan")
        short, long = self.counts
        least = float(min(self.seconds[1:]))
        each = max(least - self.seconds[0], 0.0) / (long - short) if long > short else least / long
        return max(least - each * long, 0.0) + each * max(1.0, long * noise2 / wanted2)


def interior(surfaces: Surfaces) -> Bools:
    """(h, w), of one page: texels that are rendered, far from edges of their chart and from what is inside."""
    width, height = surfaces.atlas.size
    chart = np.full((height, width), -1, np.int64)
    texels = surfaces.texels
    chart[texels.row, texels.column] = np.where(surfaces.inside, -1, surfaces.atlas.chart[texels.face[0]])
    # Charts are some texels apart, so that none is another's neighbour.
    return np.asarray(binary_erosion(chart >= 0, np.ones((3, 3)), iterations=_INTERIOR))


def weights(page: Float64, where: Bools) -> Float64:
    """(h, w), of squared differences, so that their sum is a relative mean square; page: of luminance."""
    inside = where.astype(float)
    smooth = gaussian_filter(page * inside, _SMOOTH) / np.maximum(gaussian_filter(inside, _SMOOTH), 1e-9)
    return np.asarray(inside / (smooth + 0.1 * page[where].mean()) ** 2 / where.sum())


def bench_lightmap(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes about five minutes on two cores.

    scale : below 1, smaller pages, whose numbers keep the names of the whole ones; below a half, of a box, as the
            room does not fit them
    say   : called with a line on what goes on
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
        surfaces = Surfaces.on(still, atlas, sides)
        where = interior(surfaces)
        programs = {
            integrator: Bakes(counts[integrator], _ours(context, surfaces, sides, integrator))
            for integrator in ("path", "gather")
        }
        programs["gather"].draw(1, 0)  # compiles, as the first of the paths' runs does, which is the short one
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
    """Numbers, less the page's size in their names, and rows, of programs that have run; "cycles" may be absent.

    where : (h, w) texels that count
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


def _ours(context: Context, surfaces: Surfaces, sides: Sides, integrator: str) -> Draw:
    def draw(spp: int, seed: int) -> tuple[float, Float64]:
        start = time.perf_counter()
        made = Surfaces.on(surfaces.scene, surfaces.atlas, sides)
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
