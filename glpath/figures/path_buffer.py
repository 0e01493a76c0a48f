"""Figures 5 to 9 and 11 to 13 of the path-buffer paper [PB]: path tracing to depth 1, 2 and 3, radiosity, and the
image gathered from it.

Pictures are 256 x 256, as the paper's, down to a scale of 0.1, and smaller below; path sets are as many as the
paper's times the scale. The paper's times are those of its workstation, an HP 735. Its box and its room are
lost: `cornell-box-36` and `room` have as many triangles. Here a picture's time is that of its path sets, with the
compilation of shaders, and without the radiosity solution, which is told beside it. Means are over the pixels that
show no lamp, which would outweigh all else.

[PB] B. Walter, J. Lengyel, "The Path-Buffer", PCG-95-4, Cornell University, 1995.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from glpath.experiments.verdict import Condition
from glpath.figures.mesh_step import mesh_step
from glpath.figures.outcome import Outcome, Rows, Say, judged
from glpath.figures.style import pictures
from glpath.image import tonemap
from glpath.radiosity import RadiositySolution, solve_radiosity
from glpath.radiosity.picture import EyeHits
from glpath.rendering import render
from glpath.scene import Scene, load_scene
from glpath.scene.model import Float64
from glpath.scene.shipped.room import POSTS

BOX, ROOM = "cornell-box-36", "room"
SIDE = 256
#: Minutes on the paper's workstation, where it tells them [PB 5].
PAPER_MINUTES = {"path-buffer-7": 35.0, "path-buffer-9": 32.0, "path-buffer-12": 233.0}
#: Triangles of the paper's radiosity mesh of the box.
BOX_ELEMENTS = 210
# Particles of the Monte Carlo solver. The paper doesn't say; with these, small polygons are as wrong as it tells.
_BOX_PARTICLES, _ROOM_PARTICLES = 1_000_000, 250_000
# Of a reference by path tracing with all bounces: what is beyond adds less than a part in a thousand.
_ALL_BOUNCES, _REFERENCE_SETS = 12, 256

_outcome = partial(judged, with_gl=True)


@dataclass(frozen=True)
class _Picture:
    """radiance: (H, W, 3); mean: of `_mean`; seconds: wall time"""

    radiance: Float64
    mean: float
    path_sets: int
    seconds: float

    def row(self, what: str, name: str = "") -> dict[str, Any]:
        row = {"picture": what, "path_sets": self.path_sets, "mean_radiance": self.mean, "seconds": self.seconds}
        return row | {"paper_minutes": PAPER_MINUTES.get(name)}


def _scene(name: str, scale: float) -> Scene:
    side = max(32, round(SIDE * min(1.0, math.sqrt(10 * scale))))
    return load_scene(name).with_camera(resolution=(side, side))


def _count(full: int, scale: float) -> int:
    return max(8, round(full * scale))


def _mean(hits: EyeHits, radiance: Float64) -> float:
    """Of what is seen but the lamps."""
    return float(radiance[hits.reflecting].mean())


def _traced(say: Say, what: str, hits: EyeHits, path_sets: int, max_depth: int) -> _Picture:
    say(f"{what}: {path_sets} path sets of depth {max_depth}")
    start = time.perf_counter()
    film = render(hits.scene, spp=path_sets, max_depth=max_depth)
    return _Picture(film.mean, _mean(hits, film.mean), path_sets, time.perf_counter() - start)


def _gathered(say: Say, what: str, hits: EyeHits, path_sets: int, solution: RadiositySolution) -> _Picture:
    say(f"{what}: gather of {path_sets} path sets")
    start = time.perf_counter()
    film = render(hits.scene, integrator="gather", spp=path_sets, radiosity=solution)
    return _Picture(film.mean, _mean(hits, film.mean), path_sets, time.perf_counter() - start)


def _solved(say: Say, scene: Scene, scale: float, seed: int = 0) -> tuple[RadiositySolution, float]:
    """Monte Carlo radiosity, and the seconds it took: of the box in 210 elements, of the room one a triangle."""
    box = scene.name == BOX
    particles = max(32768, round(min(1.0, 10 * scale) * (_BOX_PARTICLES if box else _ROOM_PARTICLES)))
    say(f"Monte Carlo radiosity of {scene.name}, {particles} particles")
    start = time.perf_counter()
    solution = solve_radiosity(
        scene,
        method="monte-carlo",
        patches=BOX_ELEMENTS if box else len(scene.triangles),
        particles=particles,
        seed=seed,
    )
    return solution, time.perf_counter() - start


def _notes(scale: float) -> list[str]:
    return [] if scale >= 1 else [f"at scale {scale:g}: as much of the path sets"]


def _time(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 100 else f"{seconds / 60:.1f} min"


def _page(
    title: str, said: str, here: str, panels: Sequence[tuple[str, Float64]], table: Sequence[tuple[str, str]] = ()
) -> Any:
    shown = [(name, tonemap(radiance)) for name, radiance in panels]
    return pictures(title, f"Paper: {said}.\nHere: {here}.", shown, len(shown), table)


def _against_paper(name: str, seconds: float, path_sets: int, *more: tuple[str, str]) -> list[tuple[str, str]]:
    """Lines of a table: the time here and the paper's."""
    lines = [("", "here"), ("path sets", f"{path_sets}"), ("picture", _time(seconds)), *more]
    if name in PAPER_MINUTES:
        lines.append(("paper, HP 735", f"{PAPER_MINUTES[name]:.0f} min"))
    return lines


# Figures 5 to 7: the box by path tracing


def figure_5(scale: float, say: Say) -> Outcome:
    """Depth 1: direct light only [PB figure 5]."""
    scene = _scene(BOX, scale)
    hits = EyeHits.of(scene)
    found = _traced(say, "path-buffer-5", hits, _count(1024, scale), 1)
    places = _places(hits, found.radiance)
    measured = {
        "mean": found.mean,
        # The ceiling hangs above the light, which shines downwards.
        "ceiling_radiance": places["ceiling"],
        "unlit_share": _unlit(hits, found.radiance),
        "seconds": found.seconds,
    }
    rule = (
        Condition("ceiling_radiance", "<=", 0.0),
        Condition("unlit_share", ">", 0.1),
        Condition("mean", ">", 0.0),
    )
    said = "depth 1 is direct illumination only, 1024 paths per pixel: what the light does not see is black"
    here = f"no light on the ceiling, and {100 * measured['unlit_share']:.0f} % of the picture is black"
    table = _against_paper("path-buffer-5", found.seconds, found.path_sets)
    picture = _page("Figure 5: path-buffer, depth 1", said, here, [("depth 1", found.radiance)], table)
    rows = [found.row("depth 1"), *({"picture": place, "mean_radiance": mean} for place, mean in places.items())]
    return _outcome("path-buffer-5", said, rule, measured, rows, picture, _notes(scale))


def figure_6(scale: float, say: Say) -> Outcome:
    """Depth 2: one bounce [PB figure 6]."""
    return _deeper("path-buffer-6", 2, scale, say)


def figure_7(scale: float, say: Say) -> Outcome:
    """Depth 3: two bounces [PB figure 7]."""
    return _deeper("path-buffer-7", 3, scale, say)


#: Shapes of the box whose shading the paper points at: "in the shadows and on the front of the yellow box".
_PLACES = ("ceiling", "floor", "large-box", "small-box")


def _places(hits: EyeHits, radiance: Float64) -> dict[str, float]:
    """Mean radiance where each of the box's shapes is seen."""
    return {name: float(radiance[hits.only(name)].mean()) for name in _PLACES}


def _unlit(hits: EyeHits, radiance: Float64) -> float:
    """Share of what is seen but the lamps that is black."""
    return float((radiance[hits.reflecting].max(axis=1) <= 0).mean())


def _deeper(name: str, depth: int, scale: float, say: Say) -> Outcome:
    """Figures 6 and 7, beside all depths before."""
    scene = _scene(BOX, scale)
    hits = EyeHits.of(scene)
    count = _count(1024, scale)
    found = {d: _traced(say, name, hits, count, d) for d in range(1, depth + 1)}
    last, before = found[depth], found[depth - 1]
    places = {d: _places(hits, picture.radiance) for d, picture in found.items()}
    # The same directions and light points, so that what is deeper only adds.
    darker = last.radiance.sum(axis=2) < (1 - 1e-3) * before.radiance.sum(axis=2)
    measured = {f"mean_depth_{d}": picture.mean for d, picture in found.items()}
    measured |= {
        "darker_share": float(darker.mean()),
        "least_gain": min(places[depth][place] / max(places[depth - 1][place], 1e-12) for place in _PLACES),
        "unlit_share_before": _unlit(hits, before.radiance),
        "unlit_share": _unlit(hits, last.radiance),
        "seconds": last.seconds,
    }
    rule: tuple[Condition, ...] = (
        Condition(f"mean_depth_{depth}", ">", f"mean_depth_{depth - 1}"),
        Condition("darker_share", "<=", 0.001),
        Condition("least_gain", ">", 1.0),
    )
    if depth == 2:
        rule += (Condition("unlit_share", "<", "unlit_share_before"),)
        said = "depth 2 adds light that was reflected once: it fills the shadows and the front of the box"
    else:
        measured["gain_2"] = measured["mean_depth_2"] - measured["mean_depth_1"]
        measured["gain_3"] = measured["mean_depth_3"] - measured["mean_depth_2"]
        rule += (Condition("gain_3", "<", "gain_2"),)
        said = "depth 3 includes a better approximation to the indirect light; it took 35 minutes"
    steps = " to ".join(f"{p.mean:.4f}" for p in found.values())
    here = (
        f"the mean radiance goes from {steps}; {100 * measured['darker_share']:.2g} % of the pixels are darker "
        f"than before. {last.path_sets} path sets in {_time(last.seconds)}"
    )
    title = f"Figure {name.rsplit('-', 1)[1]}: path-buffer, depth {depth}"
    panels = [(f"depth {d}", picture.radiance) for d, picture in sorted(found.items(), reverse=True)]
    table = _against_paper(name, last.seconds, last.path_sets)
    rows: Rows = []
    for d, picture in found.items():
        row = picture.row(f"depth {d}", name if d == depth else "")
        rows.append(row | {f"{place} radiance": mean for place, mean in places[d].items()})
    return _outcome(name, said, rule, measured, rows, _page(title, said, here, panels, table), _notes(scale))


# Figures 8 and 9: the box by radiosity


def figure_8(scale: float, say: Say) -> Outcome:
    """Monte Carlo radiosity of the box on a coarse mesh, as it is [PB figure 8]."""
    scene = _scene(BOX, scale)
    hits = EyeHits.of(scene)
    solution, seconds = _solved(say, scene, scale)
    reference = _traced(say, "reference", hits, _count(_REFERENCE_SETS, scale), _ALL_BOUNCES)
    constant, smooth = (hits.radiance(solution, mode) for mode in ("constant", "interpolated"))
    measured = {
        "elements": float(solution.element_count),
        "mean": _mean(hits, constant),
        "mean_error": abs(_mean(hits, constant) / reference.mean - 1),
        "mesh_step": mesh_step(constant, hits, solution),
        "mesh_step_interpolated": mesh_step(smooth, hits, solution),
        "mesh_step_reference": mesh_step(reference.radiance, hits, solution),
        "solver_seconds": seconds,
    }
    rule = (
        Condition("elements", "<=", 1.05 * BOX_ELEMENTS),
        Condition("mean_error", "<=", 0.05),
        Condition("mesh_step", ">", "mesh_step_reference"),
    )
    said = f"a Monte Carlo radiosity solution of the box on a coarse mesh of {BOX_ELEMENTS} triangles"
    here = (
        f"{solution.element_count} elements in {_time(seconds)}; the mean is {100 * measured['mean_error']:.1f} % "
        f"off path tracing with all bounces, but an element's edge is a step of {100 * measured['mesh_step']:.1f} %"
    )
    rows: Rows = [
        {"picture": name, "mean_radiance": _mean(hits, shown), "mesh_step": step, "seconds": taken}
        for name, shown, step, taken in (
            ("constant per element", constant, measured["mesh_step"], seconds),
            ("interpolated", smooth, measured["mesh_step_interpolated"], seconds),
            ("path tracing, all bounces", reference.radiance, measured["mesh_step_reference"], reference.seconds),
        )
    ]
    panels = [("constant per element", constant), ("interpolated", smooth)]
    picture = _page("Figure 8: Monte Carlo radiosity", said, here, panels)
    return _outcome("path-buffer-8", said, rule, measured, rows, picture, _notes(scale))


def figure_9(scale: float, say: Say) -> Outcome:
    """The gather from figure 8 [PB figure 9]."""
    scene = _scene(BOX, scale)
    hits = EyeHits.of(scene)
    solution, seconds = _solved(say, scene, scale)
    found = _gathered(say, "path-buffer-9", hits, _count(1024, scale), solution)
    reference = _traced(say, "reference", hits, _count(_REFERENCE_SETS, scale), _ALL_BOUNCES)
    shown = hits.radiance(solution, "constant")
    measured = _gather_numbers(found, hits, solution, shown, seconds)
    measured["mean_error"] = abs(found.mean / reference.mean - 1)
    measured["relmse"] = _relmse(found.radiance, reference.radiance)
    measured["relmse_shown"] = _relmse(shown, reference.radiance)
    rule = (
        Condition("mean_error", "<=", 0.01),
        Condition("step_share", "<=", 0.1),
        Condition("relmse", "<", "relmse_shown"),
    )
    said = (
        "a gather from the coarse mesh of figure 8, 1024 paths per pixel, has far more detail than the mesh; it "
        "took 32 minutes"
    )
    here = (
        f"of the steps at the elements' edges {100 * max(measured['step_share'], 0):.1f} % are left; the mean is "
        f"{100 * measured['mean_error']:.2f} % off path tracing with all bounces"
    )
    more = ("radiosity", _time(seconds))
    rows = [
        found.row("gather", "path-buffer-9") | {"mesh_step": measured["mesh_step"]},
        {"picture": "figure 8", "mean_radiance": measured["mean_shown"], "seconds": seconds,
         "mesh_step": measured["mesh_step_shown"]},
        reference.row("path tracing, all bounces")
        | {"mesh_step": mesh_step(reference.radiance, hits, solution)},
    ]  # fmt: skip
    panels = [("gather", found.radiance), ("figure 8", shown)]
    table = _against_paper("path-buffer-9", found.seconds, found.path_sets, more)
    picture = _page("Figure 9: gather from figure 8", said, here, panels, table)
    return _outcome("path-buffer-9", said, rule, measured, rows, picture, _notes(scale))


def _gather_numbers(
    found: _Picture, hits: EyeHits, solution: RadiositySolution, shown: Float64, solver_seconds: float
) -> dict[str, float]:
    step, before = mesh_step(found.radiance, hits, solution), mesh_step(shown, hits, solution)
    return {
        "mean": found.mean,
        "mean_shown": _mean(hits, shown),
        "mesh_step": step,
        "mesh_step_shown": before,
        "step_share": step / before,
        "seconds": found.seconds,
        "solver_seconds": solver_seconds,
    }


def _relmse(image: Float64, reference: Float64) -> float:
    return float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))


# Figures 11 to 13: the room


def figure_11(scale: float, say: Say) -> Outcome:
    """The room with a Monte Carlo radiosity solution, as it is [PB figure 11]."""
    scene = _scene(ROOM, scale)
    hits = EyeHits.of(scene)
    (solution, seconds), (other, _) = (_solved(say, scene, scale, seed) for seed in (0, 1))
    noise = _noise(solution, other, scene)
    constant, smooth = (hits.radiance(solution, mode) for mode in ("constant", "interpolated"))
    measured = {
        "triangles": float(len(scene.triangles)),
        "elements": float(solution.element_count),
        "mean_difference": _mean_difference(solution, other, scene),
        "noise_of_small": noise[0],
        "noise_of_large": noise[-1],
        "mesh_step": mesh_step(constant, hits, solution),
        "solver_seconds": seconds,
    }
    rule = (
        Condition("mean_difference", "<=", 0.02),
        Condition("noise_of_small", ">", "noise_of_large"),
        Condition("noise_of_small", ">=", 0.1),
    )
    said = (
        "a room of 14920 triangles; Monte Carlo radiosity is right on average, but often incorrect for individual "
        "polygons, especially for small ones"
    )
    here = (
        f"two solutions of {len(scene.triangles)} triangles differ by {100 * measured['mean_difference']:.2f} % in "
        f"the mean; the error of a polygon is {100 * noise[0]:.0f} % among the smallest quarter, "
        f"{100 * noise[-1]:.1f} % among the largest. {_time(seconds)}"
    )
    rows: Rows = [
        {"quarter by area": name, "relative error": value}
        for name, value in zip(("smallest", "second", "third", "largest"), noise, strict=True)
    ]
    panels = [("constant per triangle", constant), ("interpolated", smooth)]
    picture = _page("Figure 11: Monte Carlo radiosity of the room", said, here, panels)
    return _outcome("path-buffer-11", said, rule, measured, rows, picture, _notes(scale))


def _fronts(solution: RadiositySolution, scene: Scene) -> Float64:
    """(E,) what each element's front reflects, the mean of the colours."""
    return np.asarray(solution.reflected(scene)[0].mean(axis=1))


def _areas(solution: RadiositySolution, scene: Scene) -> Float64:
    """(E,) area of each element."""
    n2 = solution.divisions.astype(float) ** 2
    return np.asarray(np.repeat(scene.areas / n2, solution.divisions.astype(int) ** 2))


def _noise(a: RadiositySolution, b: RadiositySolution, scene: Scene) -> list[float]:
    """Of two solutions, for each quarter of the elements by area: the error of one, root mean square over the mean.

    Two that are equally wrong differ by sqrt(2) times their error.
    """
    x, y = _fronts(a, scene), _fronts(b, scene)
    quarters = np.array_split(np.argsort(_areas(a, scene), kind="stable"), 4)
    return [float(np.sqrt(np.mean((x[q] - y[q]) ** 2) / 2) / np.mean((x[q] + y[q]) / 2)) for q in quarters]


def _mean_difference(a: RadiositySolution, b: RadiositySolution, scene: Scene) -> float:
    area = _areas(a, scene)
    x, y = float(_fronts(a, scene) @ area), float(_fronts(b, scene) @ area)
    return abs(x - y) / ((x + y) / 2)


def figure_12(scale: float, say: Say) -> Outcome:
    """The gather from figure 11 [PB figure 12]."""
    scene = _scene(ROOM, scale)
    hits = EyeHits.of(scene)
    solution, seconds = _solved(say, scene, scale)
    found = _gathered(say, "path-buffer-12", hits, _count(4096, scale), solution)
    # As many, from the same light points: what the two differ by has no noise of direct light.
    direct = _traced(say, "direct light", hits, found.path_sets, 1)
    shown = hits.radiance(solution, "constant")
    measured = _gather_numbers(found, hits, solution, shown, seconds)
    measured["post_shadow"] = _post_shadow(hits, found.radiance - direct.radiance)
    measured["mean_difference"] = abs(found.mean / measured["mean_shown"] - 1)
    rule = (
        Condition("step_share", "<=", 0.1),
        Condition("mean_difference", "<=", 0.05),
        # The paper gives no amount: any shadow.
        Condition("post_shadow", "<", 1.0),
    )
    said = (
        "a gather from figure 11, 4096 paths per pixel, shows subtle effects like the shadow in the indirect light "
        "behind the posts next to the fireplace, where figure 11 has polygons; it took 233 minutes"
    )
    here = (
        f"of the steps at the triangles' edges {100 * max(measured['step_share'], 0):.1f} % are left, and the mean "
        f"is that of figure 11 within {100 * measured['mean_difference']:.1f} %; behind a post there is "
        f"{100 * measured['post_shadow']:.0f} % of the indirect light beside it"
    )
    rows = [
        found.row("gather", "path-buffer-12") | {"mesh_step": measured["mesh_step"]},
        {"picture": "figure 11", "mean_radiance": measured["mean_shown"], "seconds": seconds,
         "mesh_step": measured["mesh_step_shown"]},
    ]  # fmt: skip
    table = _against_paper("path-buffer-12", found.seconds, found.path_sets, ("radiosity", _time(seconds)))
    panels = [("gather", found.radiance), ("figure 11", shown)]
    picture = _page("Figure 12: gather from figure 11", said, here, panels, table)
    return _outcome("path-buffer-12", said, rule, measured, rows, picture, _notes(scale))


def _post_shadow(hits: EyeHits, indirect: Float64) -> float:
    """Indirect light on the chimney behind the left post, over that beside it.

    Both are of one plaster, a hand's breadth apart, at the height of the post's shaft, in pixels that show nothing
    else: beyond the plaster are bricks, which are darker.
    """
    x, y, _ = np.moveaxis(hits.position, -1, 0)
    post = POSTS[0]
    plaster = hits.shape("chimney").all(axis=2, keepdims=True) & (y > 0.4) & (y < 0.9)
    behind, beside = (
        (plaster & (x > post + a) & (x < post + b)).mean(axis=2)[..., None]
        for a, b in ((-0.04, 0.04), (0.07, 0.12))
    )
    if not (behind.any() and beside.any()):
        return math.nan  # the picture is too small
    return float((indirect * behind).sum() / behind.sum() / ((indirect * beside).sum() / beside.sum()))


def figure_13(scale: float, say: Say) -> Outcome:
    """The room by direct light only [PB figure 13]."""
    scene = _scene(ROOM, scale)
    solution, _ = _solved(say, scene, scale)
    hits = EyeHits.of(scene)
    direct = _traced(say, "path-buffer-13", hits, _count(1024, scale), 1)
    whole = _gathered(say, "all light", hits, _count(512, scale), solution)
    light = [picture.radiance.sum(axis=2) for picture in (direct, whole)]
    measured = {
        "mean_direct": direct.mean,
        "mean_all": whole.mean,
        "indirect_share": 1 - direct.mean / whole.mean,
        "mostly_indirect": float((light[0] < light[1] / 2)[hits.reflecting].mean()),
        "unlit_share": _unlit(hits, direct.radiance),
        "unlit_share_all": _unlit(hits, whole.radiance),
        "seconds": direct.seconds,
    }
    rule = (
        Condition("indirect_share", ">=", 0.25),
        Condition("mostly_indirect", ">=", 0.25),
        Condition("unlit_share_all", "<=", 0.001),
    )
    said = "a picture by direct lighting only demonstrates how important the indirect illumination is in this scene"
    here = (
        f"of the picture's light {100 * measured['indirect_share']:.0f} % is indirect; "
        f"{100 * measured['mostly_indirect']:.0f} % of the pixels lose more than half of theirs without it, "
        f"{100 * measured['unlit_share']:.0f} % all"
    )
    rows = [direct.row("direct light only"), whole.row("gather, all light")]
    panels = [("direct light only", direct.radiance), (f"gather, {whole.path_sets} path sets", whole.radiance)]
    table = _against_paper("path-buffer-13", direct.seconds, direct.path_sets)
    picture = _page("Figure 13: the room by direct light only", said, here, panels, table)
    return _outcome("path-buffer-13", said, rule, measured, rows, picture, _notes(scale))


FIGURES = {
    "path-buffer-5": (figure_5, "a box by path tracing of depth 1: direct light only"),
    "path-buffer-6": (figure_6, "the same of depth 2"),
    "path-buffer-7": (figure_7, "the same of depth 3"),
    "path-buffer-8": (figure_8, "the box by Monte Carlo radiosity on a coarse mesh"),
    "path-buffer-9": (figure_9, "the gather from it, 1024 path sets"),
    "path-buffer-11": (figure_11, "a furnished room by Monte Carlo radiosity"),
    "path-buffer-12": (figure_12, "the gather from it, 4096 path sets"),
    "path-buffer-13": (figure_13, "the room by direct light only"),
}
