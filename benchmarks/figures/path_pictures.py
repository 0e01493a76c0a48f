"""The pictures of the path-buffer paper [PB]: how they are made and compared with Mitsuba's.

Pictures are 256 x 256, as in the paper; below a scale of 0.1 they are smaller. The number of path sets is the
paper's times the scale. The paper's times are those of its workstation, an HP 735. Its box and its room are lost:
`cornell-box-36` and `room` have the same numbers of triangles. Here, the time of a picture is that of its path
sets, with the compilation of shaders, and without the radiosity solution, which is reported separately. Means are
over the pixels that show no lamp, because lamps would dominate them.

[PB] B. Walter, J. Lengyel, "The Path-Buffer", PCG-95-4, Cornell University, 1995.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks.figures.eye_hits import ShownHits
from benchmarks.figures.mesh_step import mesh_step
from benchmarks.figures.outcome import Say, judged
from benchmarks.figures.style import pictures
from benchmarks.references.stored import at_one_size
from benchmarks.verdict import Condition
from glpath.compare import relative_mse
from glpath.errors import SceneWarning
from glpath.film.tonemap import tonemap
from glpath.io import load_scene
from glpath.radiosity import RadiositySolution, solve_radiosity
from glpath.rendering import render
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.system.reporting import duration

BOX, ROOM = "cornell-box-36", "room"
SIDES = (32, 64, 128, 256)
#: Minutes on the paper's workstation, for the figures for which the paper states them [PB 5].
PAPER_MINUTES = {"path-buffer-7": 35.0, "path-buffer-9": 32.0, "path-buffer-12": 233.0}
#: Triangles of the paper's radiosity mesh of the box.
BOX_ELEMENTS = 210
# Particles of the Monte Carlo solver. The paper does not state them; these give small polygons the errors it
# reports.
_BOX_PARTICLES, _ROOM_PARTICLES = 1_000_000, 250_000

outcome = partial(judged, with_gl=True)


@dataclass(frozen=True)
class Picture:
    """radiance: (H, W, 3); mean: result of `mean_of`; seconds: wall time"""

    radiance: Float64
    mean: float
    path_sets: int
    seconds: float

    def row(self, what: str, name: str = "") -> dict[str, Any]:
        row = {"picture": what, "path_sets": self.path_sets, "mean_radiance": self.mean, "seconds": self.seconds}
        return row | {"paper_minutes": PAPER_MINUTES.get(name)}


def scene_at(name: str, scale: float) -> Scene:
    """Load a scene with the paper's picture size, or a half, a quarter or an eighth of it."""
    side = min(SIDES, key=lambda s: abs(math.log(s / (SIDES[-1] * math.sqrt(10 * scale)))))
    return load_scene(name).with_camera(resolution=(side, side))


def count(full: int, scale: float) -> int:
    """Return the number of path sets at this scale."""
    return max(8, round(full * scale))


def mean_of(hits: ShownHits, radiance: Float64) -> float:
    """Return the mean over all pixels that show no lamp."""
    return float(radiance[hits.reflecting].mean())


def traced(say: Say, what: str, hits: ShownHits, path_sets: int, max_depth: int) -> Picture:
    """Render a picture by path tracing with the path-buffer."""
    say(f"{what}: {path_sets} path sets of depth {max_depth}")
    start = time.perf_counter()
    film = render(hits.scene, spp=path_sets, max_depth=max_depth, integrator="path-buffer")
    return Picture(film.mean, mean_of(hits, film.mean), path_sets, time.perf_counter() - start)


def gathered(say: Say, what: str, hits: ShownHits, path_sets: int, solution: RadiositySolution) -> Picture:
    """Render a picture by a gather from a solution."""
    say(f"{what}: gather of {path_sets} path sets")
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # the paper's gather is biased, and the figure shows that
        film = render(
            hits.scene,
            integrator="gather",
            spp=path_sets,
            radiosity=solution,
            cast="path-buffer",
            direct_light="solution",
            lookup_distance=0,
        )
    return Picture(film.mean, mean_of(hits, film.mean), path_sets, time.perf_counter() - start)


def solved(say: Say, scene: Scene, scale: float, seed: int = 0) -> tuple[RadiositySolution, float]:
    """Return a Monte Carlo radiosity solution, and its seconds. box: 210 elements; room: one per triangle."""
    box = scene.name == BOX
    particles = max(32768, round(min(1.0, 10 * scale) * (_BOX_PARTICLES if box else _ROOM_PARTICLES)))
    say(f"Monte Carlo radiosity of {scene.name}, {particles} particles")
    start = time.perf_counter()
    largest = float(np.linalg.norm(np.ptp(scene.bounds, axis=0)))
    solution = solve_radiosity(
        scene,
        method="monte-carlo",
        adaptive=0,  # the paper's mesh is not adaptive
        patches=BOX_ELEMENTS if box else None,
        size=None if box else largest,
        particles=particles,
        seed=seed,
    )
    return solution, time.perf_counter() - start


# Comparison with Mitsuba


def mean_off(hits: ShownHits, radiance: Float64, reference: Float64) -> float:
    """Return |ratio - 1| of the mean radiance, without lamps, to that of Mitsuba's picture."""
    ours, theirs, reflecting = at_one_size(radiance, reference, hits.reflecting.astype(float))
    whole = reflecting == 1
    return abs(float(ours[whole].mean() / theirs[whole].mean()) - 1)


def error(radiance: Float64, reference: Float64) -> float:
    """Return the relMSE to Mitsuba's picture."""
    ours, theirs = at_one_size(radiance, reference)
    return relative_mse(ours, theirs)


def as_mitsuba(hits: ShownHits, found: Picture, reference: Float64, noise: float = 0.3) -> dict[str, float]:
    """Return the differences from Mitsuba's picture, and their limits for this number of path sets; see `SAME`.

    noise : error of one path set, both of the mean and as relMSE
    """
    return {
        "mean_off": mean_off(hits, found.radiance, reference),
        # A per cent, and the error of this many points of a Sobol sequence that all pixels share.
        "mean_off_allowed": 0.01 + noise / found.path_sets,
        "relmse": error(found.radiance, reference),
        "relmse_allowed": noise / found.path_sets,
    }


#: The conditions that a picture equals Mitsuba's but for noise.
SAME = (Condition("mean_off", "<=", "mean_off_allowed"), Condition("relmse", "<=", "relmse_allowed"))


def gather_numbers(
    found: Picture, hits: ShownHits, solution: RadiositySolution, shown: Float64, solver_seconds: float
) -> dict[str, float]:
    """Return the numbers that all figures of a gather report; shown: the solution itself."""
    step, before = mesh_step(found.radiance, hits, solution), mesh_step(shown, hits, solution)
    return {
        "mean": found.mean,
        "mean_shown": mean_of(hits, shown),
        "mesh_step": step,
        "mesh_step_shown": before,
        "step_share": step / before,
        "seconds": found.seconds,
        "solver_seconds": solver_seconds,
    }


def unlit(hits: ShownHits, radiance: Float64) -> float:
    """Return the fraction of pixels without lamps that are black."""
    return float((radiance[hits.reflecting].max(axis=1) <= 0).mean())


# Pages


def notes(scale: float) -> list[str]:
    return [] if scale >= 1 else [f"at scale {scale:g}: as much of the path sets"]


def page(
    title: str, said: str, here: str, panels: Sequence[tuple[str, Float64]], table: Sequence[tuple[str, str]] = ()
) -> Any:
    shown = [(name, tonemap(radiance)) for name, radiance in panels]
    return pictures(title, f"Paper: {said}.\nHere: {here}.", shown, len(shown), table)


def against_paper(name: str, seconds: float, path_sets: int, *more: tuple[str, str]) -> list[tuple[str, str]]:
    """Return lines of a table: the time here and the paper's."""
    lines = [("", "here"), ("path sets", f"{path_sets}"), ("picture", duration(seconds)), *more]
    if name in PAPER_MINUTES:
        lines.append(("paper, HP 735", f"{PAPER_MINUTES[name]:.0f} min"))
    return lines
