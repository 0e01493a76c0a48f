"""Figures 11 to 13 of the path-buffer paper [PB]: its room by radiosity, by a gather, and by direct light.

Mitsuba's picture of the same depth is the reference; `path_pictures` has the parts that all figures share.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.figures.eye_hits import ShownHits
from benchmarks.figures.mesh_step import mesh_step
from benchmarks.figures.outcome import Outcome, Rows, Say
from benchmarks.figures.path_pictures import (
    ROOM,
    SAME,
    against_paper,
    as_mitsuba,
    count,
    error,
    gather_numbers,
    gathered,
    mean_off,
    notes,
    outcome,
    page,
    scene_at,
    solved,
    traced,
    unlit,
)
from benchmarks.references.stored import ALL_BOUNCES, stored_reference
from benchmarks.scenes.room import POSTS
from benchmarks.verdict import Condition
from glpath.radiosity import RadiositySolution
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.system.reporting import duration

# Noise of one path set, whose only light point is on one of many lamps.
_NOISE = 3.0


def figure_11(scale: float, say: Say) -> Outcome:
    """Make figure 11: the room with a Monte Carlo radiosity solution, shown directly."""
    scene = scene_at(ROOM, scale)
    hits = ShownHits.of(scene)
    (solution, seconds), (other, _) = (solved(say, scene, scale, seed) for seed in (0, 1))
    noise = _noise(solution, other, scene)
    constant, smooth = (hits.radiance(solution, mode) for mode in ("constant", "smooth"))
    measured = {
        "triangles": float(len(scene.triangles)),
        "elements": float(solution.element_count),
        "mean_off": mean_off(hits, constant, stored_reference(ROOM, ALL_BOUNCES)),
        "mean_difference": _mean_difference(solution, other, scene),
        "noise_of_small": noise[0],
        "noise_of_large": noise[-1],
        "mesh_step": mesh_step(constant, hits, solution),
        "solver_seconds": seconds,
    }
    rule = (
        Condition("mean_off", "<=", 0.05),
        Condition("mean_difference", "<=", 0.02),
        Condition("noise_of_small", ">", "noise_of_large"),
        Condition("noise_of_small", ">=", 0.1),
    )
    said = (
        "a room of 14920 triangles; Monte Carlo radiosity is right on average, but often incorrect for individual "
        "polygons, especially for small ones"
    )
    here = (
        f"the mean of the picture is {100 * measured['mean_off']:.1f} % off Mitsuba's with all bounces; two "
        f"solutions differ by {100 * measured['mean_difference']:.2f} % in the mean, and the error of a polygon is "
        f"{100 * noise[0]:.0f} % among the smallest quarter, {100 * noise[-1]:.1f} % among the largest. "
        f"{duration(seconds)}"
    )
    rows: Rows = [
        {"quarter by area": name, "relative error": value}
        for name, value in zip(("smallest", "second", "third", "largest"), noise, strict=True)
    ]
    panels = [("constant per triangle", constant), ("interpolated", smooth)]
    picture = page("Figure 11: Monte Carlo radiosity of the room", said, here, panels)
    return outcome("path-buffer-11", said, rule, measured, rows, picture, notes(scale))


def _fronts(solution: RadiositySolution, scene: Scene) -> Float64:
    """Return (E,) radiance that each element's front reflects, as the mean of the colours."""
    return np.asarray(solution.reflected(scene)[0].mean(axis=1))


def _areas(solution: RadiositySolution, scene: Scene) -> Float64:
    """Return (E,) area of each element."""
    n2 = solution.divisions.astype(float) ** 2
    return np.asarray(np.repeat(scene.areas / n2, solution.divisions.astype(int) ** 2))


def _noise(a: RadiositySolution, b: RadiositySolution, scene: Scene) -> list[float]:
    """Return the relative RMS error of one solution for each quarter of the elements by area.

    The error follows from the difference of the two solutions, which is sqrt(2) times as large if they are equally
    wrong.
    """
    x, y = _fronts(a, scene), _fronts(b, scene)
    quarters = np.array_split(np.argsort(_areas(a, scene), kind="stable"), 4)
    return [float(np.sqrt(np.mean((x[q] - y[q]) ** 2) / 2) / np.mean((x[q] + y[q]) / 2)) for q in quarters]


def _mean_difference(a: RadiositySolution, b: RadiositySolution, scene: Scene) -> float:
    area = _areas(a, scene)
    x, y = float(_fronts(a, scene) @ area), float(_fronts(b, scene) @ area)
    return abs(x - y) / ((x + y) / 2)


def figure_12(scale: float, say: Say) -> Outcome:
    """Make figure 12: the gather from figure 11."""
    scene = scene_at(ROOM, scale)
    hits = ShownHits.of(scene)
    solution, seconds = solved(say, scene, scale)
    found = gathered(say, "path-buffer-12", hits, count(4096, scale), solution)
    # Trace as many path sets with the same light points, so that the difference has no noise of direct light.
    direct = traced(say, "direct light", hits, found.path_sets, 1)
    shown = hits.radiance(solution, "constant")
    reference = stored_reference(ROOM, ALL_BOUNCES)
    measured = gather_numbers(found, hits, solution, shown, seconds) | as_mitsuba(hits, found, reference, _NOISE)
    measured["post_shadow"] = post_shadow(hits, found.radiance - direct.radiance)
    measured["relmse_shown"] = error(shown, reference)
    measured["relmse_share"] = measured["relmse"] / measured["relmse_shown"]
    rule = (
        SAME[0],
        Condition("step_share", "<=", 0.1),
        Condition("relmse_share", "<=", 0.5),
        # The paper gives no amount, so any shadow counts.
        Condition("post_shadow", "<", 1.0),
    )
    said = (
        "a gather from figure 11, 4096 paths per pixel, shows subtle effects like the shadow in the indirect light "
        "behind the posts next to the fireplace, where figure 11 has polygons; it took 233 minutes"
    )
    here = (
        f"of the steps at the triangles' edges {100 * max(measured['step_share'], 0):.1f} % are left, of the "
        f"relMSE to Mitsuba's picture {100 * measured['relmse_share']:.1f} %; the mean is "
        f"{100 * measured['mean_off']:.1f} % off; behind a post there is "
        f"{100 * measured['post_shadow']:.0f} % of the indirect light beside it"
    )
    rows = [
        found.row("gather", "path-buffer-12") | {"mesh_step": measured["mesh_step"]},
        {"picture": "figure 11", "mean_radiance": measured["mean_shown"], "seconds": seconds,
         "mesh_step": measured["mesh_step_shown"]},
    ]  # fmt: skip
    table = against_paper("path-buffer-12", found.seconds, found.path_sets, ("radiosity", duration(seconds)))
    panels = [("gather", found.radiance), ("figure 11", shown)]
    picture = page("Figure 12: gather from figure 11", said, here, panels, table)
    return outcome("path-buffer-12", said, rule, measured, rows, picture, notes(scale))


def post_shadow(hits: ShownHits, indirect: Float64) -> float:
    """Return the indirect light on the chimney behind the left post, divided by that beside the post.

    Both places are on the same plaster, a hand's breadth apart, at the height of the post's shaft, in pixels that
    show only plaster, because the bricks beyond it are darker.
    """
    x, y, _ = np.moveaxis(hits.position, -1, 0)
    post = POSTS[0]
    plaster = hits.shape("room/chimney").all(axis=2, keepdims=True) & (y > 0.4) & (y < 0.9)
    behind, beside = (
        (plaster & (x > post + a) & (x < post + b)).mean(axis=2)[..., None]
        for a, b in ((-0.04, 0.04), (0.07, 0.12))
    )
    if not (behind.any() and beside.any()):
        return math.nan  # the picture is too small
    return float((indirect * behind).sum() / behind.sum() / ((indirect * beside).sum() / beside.sum()))


def figure_13(scale: float, say: Say) -> Outcome:
    """Make figure 13: the room by direct light only."""
    scene = scene_at(ROOM, scale)
    hits = ShownHits.of(scene)
    direct = traced(say, "path-buffer-13", hits, count(1024, scale), 1)
    solution, _ = solved(say, scene, scale)
    whole = gathered(say, "all light", hits, count(512, scale), solution)
    light = [picture.radiance.sum(axis=2) for picture in (direct, whole)]
    measured = as_mitsuba(hits, direct, stored_reference(ROOM, 1), _NOISE) | {
        "mean_direct": direct.mean,
        "mean_all": whole.mean,
        "mean_all_off": mean_off(hits, whole.radiance, stored_reference(ROOM, ALL_BOUNCES)),
        "indirect_share": 1 - direct.mean / whole.mean,
        "mostly_indirect": float((light[0] < light[1] / 2)[hits.reflecting].mean()),
        "unlit_share": unlit(hits, direct.radiance),
        "unlit_share_all": unlit(hits, whole.radiance),
        "seconds": direct.seconds,
    }
    rule = (
        SAME[0],
        Condition("mean_all_off", "<=", 0.05),
        # The paper says only "just how important".
        Condition("indirect_share", ">=", 0.25),
        Condition("mostly_indirect", ">=", 0.25),
        Condition("unlit_share_all", "<=", 0.001),
    )
    said = "a picture by direct lighting only demonstrates how important the indirect illumination is in this scene"
    here = (
        f"of the picture's light {100 * measured['indirect_share']:.0f} % is indirect; "
        f"{100 * measured['mostly_indirect']:.0f} % of the pixels lose more than half of theirs without it, "
        f"{100 * measured['unlit_share']:.0f} % all. The mean is {100 * measured['mean_off']:.1f} % off Mitsuba's "
        f"of depth 1"
    )
    rows = [direct.row("direct light only"), whole.row("gather, all light")]
    panels = [("direct light only", direct.radiance), (f"gather, {whole.path_sets} path sets", whole.radiance)]
    table = against_paper("path-buffer-13", direct.seconds, direct.path_sets)
    picture = page("Figure 13: the room by direct light only", said, here, panels, table)
    return outcome("path-buffer-13", said, rule, measured, rows, picture, notes(scale))


FIGURES = {
    "path-buffer-11": (figure_11, "a furnished room by Monte Carlo radiosity"),
    "path-buffer-12": (figure_12, "the gather from it, 4096 path sets"),
    "path-buffer-13": (figure_13, "the room by direct light only"),
}
