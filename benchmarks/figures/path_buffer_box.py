"""Figures 5 to 10 of the path-buffer paper [PB]: its box by path tracing to depth 1, 2 and 3, by radiosity,
by a gather from the radiosity, and with a block of brushed metal.

Mitsuba's picture of the same depth is the reference; `path_pictures` has the parts that all figures share.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.figures.eye_hits import ShownHits
from benchmarks.figures.mesh_step import mesh_step
from benchmarks.figures.outcome import Outcome, Rows, Say
from benchmarks.figures.path_pictures import (
    BOX,
    BOX_ELEMENTS,
    SAME,
    against_paper,
    as_mitsuba,
    count,
    error,
    gather_numbers,
    gathered,
    mean_of,
    mean_off,
    notes,
    outcome,
    page,
    scene_at,
    solved,
    traced,
    unlit,
)
from benchmarks.references.stored import ALL_BOUNCES, smaller, stored_reference
from benchmarks.verdict import Condition
from glpath.rendering import render
from glpath.scene import Scene
from glpath.scene.model import Float64, Material, Mesh, Shapes
from glpath.scene.tessellate import with_projected_uv
from glpath.system.reporting import duration

# The block of figure 10: GGX's alpha is 0.2 across the brush strokes, 0.49 along them.
_METAL = "large-box"
_ROUGHNESS, _ANISOTROPY = 0.45, 0.6

# Figures 5 to 7: path tracing

#: Shapes of the box whose shading the paper mentions: "in the shadows and on the front of the yellow box".
_PLACES = ("ceiling", "floor", "large-box", "small-box")


def _places(hits: ShownHits, radiance: Float64) -> dict[str, float]:
    """Return the mean radiance of the pixels that show each shape."""
    return {name: float(radiance[hits.only(name)].mean()) for name in _PLACES}


def figure_5(scale: float, say: Say) -> Outcome:
    """Make figure 5: depth 1, direct light only."""
    scene = scene_at(BOX, scale)
    hits = ShownHits.of(scene)
    found = traced(say, "path-buffer-5", hits, count(1024, scale), 1)
    places = _places(hits, found.radiance)
    measured = as_mitsuba(hits, found, stored_reference(BOX, 1)) | {
        "mean": found.mean,
        # The ceiling is above the light, which shines downwards.
        "ceiling_radiance": places["ceiling"],
        "unlit_share": unlit(hits, found.radiance),
        "seconds": found.seconds,
    }
    rule = (*SAME, Condition("ceiling_radiance", "<=", 0.0), Condition("unlit_share", ">", 0.1))
    said = "depth 1 is direct illumination only, 1024 paths per pixel"
    here = (
        f"the mean is {100 * measured['mean_off']:.2f} % off Mitsuba's of depth 1; no light on the ceiling, and "
        f"{100 * measured['unlit_share']:.0f} % of the picture is black"
    )
    table = against_paper("path-buffer-5", found.seconds, found.path_sets)
    picture = page("Figure 5: path-buffer, depth 1", said, here, [("depth 1", found.radiance)], table)
    rows = [found.row("depth 1"), *({"picture": place, "mean_radiance": mean} for place, mean in places.items())]
    return outcome("path-buffer-5", said, rule, measured, rows, picture, notes(scale))


def figure_6(scale: float, say: Say) -> Outcome:
    """Make figure 6: depth 2, one bounce."""
    return _deeper("path-buffer-6", 2, scale, say)


def figure_7(scale: float, say: Say) -> Outcome:
    """Make figure 7: depth 3, two bounces."""
    return _deeper("path-buffer-7", 3, scale, say)


def _deeper(name: str, depth: int, scale: float, say: Say) -> Outcome:
    """Make figure 6 or 7, with all smaller depths for comparison."""
    scene = scene_at(BOX, scale)
    hits = ShownHits.of(scene)
    sets = count(1024, scale)
    found = {d: traced(say, name, hits, sets, d) for d in range(1, depth + 1)}
    last, before = found[depth], found[depth - 1]
    places = {d: _places(hits, picture.radiance) for d, picture in found.items()}
    everything = stored_reference(BOX, ALL_BOUNCES)
    measured = {f"mean_depth_{d}": picture.mean for d, picture in found.items()}
    measured |= as_mitsuba(hits, last, stored_reference(BOX, depth)) | {
        "missing": error(last.radiance, everything),
        "missing_before": error(before.radiance, everything),
        "least_gain": min(places[depth][place] / max(places[depth - 1][place], 1e-12) for place in _PLACES),
        "unlit_share_before": unlit(hits, before.radiance),
        "unlit_share": unlit(hits, last.radiance),
        "seconds": last.seconds,
    }
    rule: tuple[Condition, ...] = (
        *SAME,
        Condition("missing", "<", "missing_before"),
        Condition("least_gain", ">", 1.0),
    )
    said = "greater depths include better approximations to the indirect light: the shadows and the fronts change"
    if depth == 2:
        rule += (Condition("unlit_share", "<", "unlit_share_before"),)
    else:
        said += "; it took 35 minutes"
    steps = " to ".join(f"{measured['missing_before' if d < depth else 'missing']:.2g}" for d in (depth - 1, depth))
    here = (
        f"the mean is {100 * measured['mean_off']:.2f} % off Mitsuba's of depth {depth}; the relMSE to its picture "
        f"of all bounces falls from {steps}. {last.path_sets} path sets in {duration(last.seconds)}"
    )
    title = f"Figure {name.rsplit('-', 1)[1]}: path-buffer, depth {depth}"
    panels = [(f"depth {d}", picture.radiance) for d, picture in sorted(found.items(), reverse=True)]
    table = against_paper(name, last.seconds, last.path_sets)
    rows: Rows = []
    for d, picture in found.items():
        row = picture.row(f"depth {d}", name if d == depth else "")
        rows.append(row | {f"{place} radiance": mean for place, mean in places[d].items()})
    return outcome(name, said, rule, measured, rows, page(title, said, here, panels, table), notes(scale))


# Figures 8 and 9: radiosity


def figure_8(scale: float, say: Say) -> Outcome:
    """Make figure 8: Monte Carlo radiosity of the box on a coarse mesh, shown directly."""
    scene = scene_at(BOX, scale)
    hits = ShownHits.of(scene)
    solution, seconds = solved(say, scene, scale)
    reference = smaller(stored_reference(BOX, ALL_BOUNCES), len(hits.triangle))
    constant, smooth = (hits.radiance(solution, mode) for mode in ("constant", "smooth"))
    shown = (
        ("constant per element", constant, seconds),
        ("interpolated", smooth, seconds),
        ("Mitsuba, all bounces", reference, None),
    )
    steps = [mesh_step(picture, hits, solution) for _, picture, _ in shown]
    measured = {
        "elements": float(solution.element_count),
        "mean": mean_of(hits, constant),
        "mean_off": mean_off(hits, constant, reference),
        "mesh_step": steps[0],
        "mesh_step_interpolated": steps[1],
        "mesh_step_reference": steps[2],
        "step_share_reference": steps[2] / steps[0],
        "solver_seconds": seconds,
    }
    rule = (
        Condition("elements", "<=", 1.05 * BOX_ELEMENTS),
        Condition("mean_off", "<=", 0.05),
        # Elements are visible: the light changes more at their edges than the reference does.
        Condition("mesh_step", ">=", 0.05),
        Condition("step_share_reference", "<=", 0.3),
    )
    said = f"a Monte Carlo radiosity solution of the box on a coarse mesh of {BOX_ELEMENTS} triangles"
    here = (
        f"{solution.element_count} elements in {duration(seconds)}; the mean is {100 * measured['mean_off']:.1f} % "
        f"off Mitsuba's with all bounces, but an element's edge is a step of {100 * measured['mesh_step']:.1f} %"
    )
    rows: Rows = [
        {"picture": name, "mean_radiance": mean_of(hits, picture), "mesh_step": step, "seconds": taken}
        for (name, picture, taken), step in zip(shown, steps, strict=True)
    ]
    panels = [("constant per element", constant), ("interpolated", smooth)]
    picture = page("Figure 8: Monte Carlo radiosity", said, here, panels)
    return outcome("path-buffer-8", said, rule, measured, rows, picture, notes(scale))


def figure_9(scale: float, say: Say) -> Outcome:
    """Make figure 9: the gather from figure 8."""
    scene = scene_at(BOX, scale)
    hits = ShownHits.of(scene)
    solution, seconds = solved(say, scene, scale)
    found = gathered(say, "path-buffer-9", hits, count(1024, scale), solution)
    reference = smaller(stored_reference(BOX, ALL_BOUNCES), len(hits.triangle))
    shown = hits.radiance(solution, "constant")
    measured = gather_numbers(found, hits, solution, shown, seconds) | as_mitsuba(hits, found, reference)
    measured["relmse_shown"] = error(shown, reference)
    measured["relmse_share"] = measured["relmse"] / measured["relmse_shown"]
    rule = (SAME[0], Condition("step_share", "<=", 0.1), Condition("relmse_share", "<=", 0.5))
    said = (
        "a gather from the coarse mesh of figure 8, 1024 paths per pixel, has far more detail than the mesh; it "
        "took 32 minutes"
    )
    here = (
        f"of the steps at the elements' edges {100 * max(measured['step_share'], 0):.1f} % are left, of the relMSE "
        f"to Mitsuba's picture {100 * measured['relmse_share']:.1f} %; the mean is "
        f"{100 * measured['mean_off']:.2f} % off"
    )
    more = ("radiosity", duration(seconds))
    rows = [
        found.row("gather", "path-buffer-9") | {"mesh_step": measured["mesh_step"]},
        {"picture": "figure 8", "mean_radiance": measured["mean_shown"], "seconds": seconds,
         "mesh_step": measured["mesh_step_shown"]},
        {"picture": "Mitsuba, all bounces", "mean_radiance": mean_of(hits, reference),
         "mesh_step": mesh_step(reference, hits, solution)},
    ]  # fmt: skip
    panels = [("gather", found.radiance), ("figure 8", shown)]
    table = against_paper("path-buffer-9", found.seconds, found.path_sets, more)
    picture = page("Figure 9: gather from figure 8", said, here, panels, table)
    return outcome("path-buffer-9", said, rule, measured, rows, picture, notes(scale))


# Figure 10: brushed metal


def metal_box(scene: Scene) -> Scene:
    """Return the box with its larger block made of yellow brushed metal, with upright brush strokes."""
    metal = Material(
        "brushed",
        np.array([0.95, 0.72, 0.2]),
        roughness=_ROUGHNESS,
        metallic=1.0,
        anisotropy=_ANISOTROPY,
        anisotropy_angle=0.0,
    )
    number = len(scene.materials)
    shapes = [
        replace(shape, material=number, geometry=with_projected_uv(shape.geometry))
        if shape.name == _METAL and isinstance(shape.geometry, Mesh)
        else shape
        for shape in scene.shapes
    ]
    return replace(scene, name="brushed-box", materials=(*scene.materials, metal), shapes=Shapes(shapes))


def _off(radiance: Float64, reference: Float64) -> float:
    """Return the RMS difference of (N, 3) pixels divided by their mean, because metal is too dark for relMSE."""
    return float(np.sqrt(((radiance - reference) ** 2).mean()) / reference.mean())


def figure_10(scale: float, say: Say) -> Outcome:
    """Make figure 10: the yellow box of brushed metal, depth 3, 4096 paths per pixel.

    The reference is the integrator "path", which samples the metal's lobe and traces rays through a BVH. The shared
    directions of the path-buffer hit the highlights of the metal only by chance.
    """
    scene = metal_box(scene_at(BOX, scale))
    hits = ShownHits.of(scene)
    name, sets = "path-buffer-10", count(4096, scale)
    fewer = traced(say, name, hits, count(1024, scale), 3)
    found = traced(say, name, hits, sets, 3)
    say(f"{name}: {sets} path sets of path")
    path = render(scene, spp=sets, max_depth=3).mean
    metal = hits.only(_METAL)
    diffuse = hits.reflecting & ~metal
    measured = {
        "mean": found.mean,
        "mean_off": mean_off(hits, found.radiance, path),
        "mean_off_allowed": 0.01 + 0.3 / found.path_sets,
        "metal_mean_off": abs(float(found.radiance[metal].mean() / path[metal].mean()) - 1),
        "metal_mean_off_allowed": 0.02 + 10.0 / found.path_sets,
        "off_metal": _off(found.radiance[metal], path[metal]),
        "off_diffuse": _off(found.radiance[diffuse], path[diffuse]),
        "off_metal_fewer": _off(fewer.radiance[metal], path[metal]),
        "off_diffuse_fewer": _off(fewer.radiance[diffuse], path[diffuse]),
        "seconds": found.seconds,
    }
    rule = (
        Condition("mean_off", "<=", "mean_off_allowed"),
        Condition("metal_mean_off", "<=", "metal_mean_off_allowed"),
        # The metal needs more path sets: with the same number it is noisier than the diffuse surfaces.
        Condition("off_metal_fewer", ">", "off_diffuse_fewer"),
        Condition("off_metal", "<", "off_metal_fewer"),
    )
    said = "the algorithm can handle non-diffuse BRDFs; brushed metal wants 4096 paths per pixel instead of 1024"
    here = (
        f"the metal's mean is {100 * measured['metal_mean_off']:.2f} % off that of path, whose directions its lobe "
        "chooses; its "
        f"pixels are {100 * measured['off_metal_fewer']:.1f} % off with {fewer.path_sets} path sets and "
        f"{100 * measured['off_metal']:.1f} % with {sets}, all others "
        f"{100 * measured['off_diffuse_fewer']:.1f} % and {100 * measured['off_diffuse']:.1f} %"
    )
    rows = [
        found.row("path-buffer", name) | {"off_metal": measured["off_metal"]},
        fewer.row("path-buffer, fewer") | {"off_metal": measured["off_metal_fewer"]},
    ]
    panels = [("path-buffer", found.radiance), ("path", path)]
    table = against_paper(name, found.seconds, found.path_sets)
    picture = page("Figure 10: brushed yellow metal", said, here, panels, table)
    return outcome(name, said, rule, measured, rows, picture, notes(scale))


FIGURES = {
    "path-buffer-5": (figure_5, "a box by path tracing of depth 1: direct light only"),
    "path-buffer-6": (figure_6, "the same of depth 2"),
    "path-buffer-7": (figure_7, "the same of depth 3"),
    "path-buffer-8": (figure_8, "the box by Monte Carlo radiosity on a coarse mesh"),
    "path-buffer-9": (figure_9, "the gather from it, 1024 path sets"),
    "path-buffer-10": (figure_10, "the box with a block of brushed yellow metal, 4096 path sets"),
}
