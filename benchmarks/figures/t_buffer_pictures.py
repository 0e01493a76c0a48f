"""Figures 9 to 12 and 18 of the T-buffer paper [TB]: its pictures, and how its buffers change them.

The classical algorithm and the T-buffer render the same frames; see `whitted_frame`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.figures.outcome import Outcome, Rows, Say, judged
from benchmarks.figures.sphere_rays import SphereRays
from benchmarks.figures.style import pictures
from benchmarks.figures.whitted_frame import (
    CLASSIC,
    T_BUFFER,
    Setup,
    WhittedFrame,
    differing,
    scaled,
    size_at,
    stacked,
)
from benchmarks.verdict import Condition
from glpath.film.tonemap import tonemap
from glpath.io import load_scene
from glpath.scene import Scene

SHOWN_RESOLUTIONS = (400, 800, 1200, 1600, 2000)
PICTURE, VIEWPORT = (480, 360), (320, 240)
REFLECTIONS = 4

_outcome = partial(judged, with_gl=True)


def _three_spheres(scale: float, textures: bool) -> Scene:
    scene = load_scene("three-spheres").with_camera(resolution=size_at(scale, PICTURE))
    if textures:
        return scene
    # Use the mean colours of the textures.
    colours = [texture.image.mean(axis=(0, 1), dtype=float) for texture in scene.textures]
    materials = tuple(
        m if m.texture is None else replace(m, texture=None, reflectance=m.reflectance * colours[m.texture.texture])
        for m in scene.materials
    )
    return replace(scene, materials=materials)


# Figures 9 to 11: three configurations of one simple scene.


def _table(**on: bool) -> list[tuple[str, str]]:
    """Return the paper's table of features."""
    features = {"shadows": "Shadows", "reflections": "Inter-object reflections", "textures": "Textures"}
    features |= {"t_buffer": "T-buffer", "shadow_buffer": "Shadow-buffer"}
    on = {"shadows": True, "t_buffer": True} | on
    return [("Feature", "Status")] + [(text, "ON" if on.get(key) else "OFF") for key, text in features.items()]


def _feature_rows(table: Sequence[tuple[str, str]]) -> Rows:
    return [{"feature": feature, "status": status} for feature, status in table[1:]]


def figure_9(scale: float, say: Say) -> Outcome:
    """Make figure 9: three spheres with shadows only; both algorithms give the same picture [TB IV.A]."""
    scene = _three_spheres(scale, textures=False)
    return _plain_features("t-buffer-9", "Figure 9: shadows by rays", scene, 1, _table(), say)


def figure_10(scale: float, say: Say) -> Outcome:
    """Make figure 10: inter-object reflections, which use the classical algorithm [TB IV.B]."""
    scene = _three_spheres(scale, textures=False)
    table = _table(reflections=True)
    return _plain_features("t-buffer-10", "Figure 10: reflections", scene, 1 + REFLECTIONS, table, say)


def _plain_features(
    name: str, title: str, scene: Scene, depth: int, table: list[tuple[str, str]], say: Say
) -> Outcome:
    say(f"{name}: both algorithms, {depth - 1} reflections")
    classic = WhittedFrame(scene, replace(CLASSIC, max_depth=depth))
    ours = WhittedFrame(scene, replace(T_BUFFER, max_depth=depth))
    image = ours.image()
    direct = image if depth == 1 else WhittedFrame(scene, T_BUFFER).image()
    measured = {
        "differing_share": differing(classic.image(), image),
        "reflecting_share": differing(direct, image),
        "classic_primary_tests": float(classic.tests()["primary"]),
        "t_buffer_primary_tests": float(ours.tests()["primary"]),
    }
    rule: tuple[Condition, ...] = (
        Condition("differing_share", "<=", 0.0),
        Condition("t_buffer_primary_tests", "<", "classic_primary_tests"),
    )
    said = "the T-buffer's picture is the classical algorithm's, with fewer primary tests"
    if depth > 1:
        rule += (Condition("reflecting_share", ">", 0.05),)
        said += ", and reflections change what is seen"
    here = (
        f"{100 * measured['differing_share']:.3g} % of the pixels differ; "
        f"{measured['t_buffer_primary_tests']:,.0f} primary tests instead of "
        f"{measured['classic_primary_tests']:,.0f}"
    )
    if depth > 1:
        here += f"; reflections change {100 * measured['reflecting_share']:.0f} % of the pixels"
    picture = pictures(title, f"Paper: {said}.\nHere: {here}.", [("T-buffer", tonemap(image))], 1, table)
    return _outcome(name, said, rule, measured, _feature_rows(table), picture)


def figure_11(scale: float, say: Say) -> Outcome:
    """Make figure 11: all features; the shadow-buffer aliases the shadows a little [TB IV.C]."""
    scene, rows = _three_spheres(scale, textures=True), scaled(400, scale, 40)
    say(f"t-buffer-11: shadow-buffer {rows} x {2 * rows}")
    depth = 1 + REFLECTIONS
    buffered = WhittedFrame(scene, Setup("t-buffer", "sphere", rows, depth))
    exact = WhittedFrame(scene, replace(T_BUFFER, max_depth=depth))
    plain = WhittedFrame(_three_spheres(scale, textures=False), Setup("t-buffer", "sphere", rows, depth))
    image = buffered.image()
    measured = {
        "aliased_share": differing(exact.image(), image),
        "textured_share": differing(plain.image(), image),
        "exact_shadow_tests": float(exact.tests()["shadow"]),
        "buffer_shadow_tests": float(buffered.tests()["shadow"]),
        "shadow_buffer_tests": float(buffered.tests()["shadow_buffer"]),
        "shadow_rows": float(rows),
    }
    rule = (
        Condition("aliased_share", ">", 0.0),
        Condition("aliased_share", "<=", 0.05),
        Condition("textured_share", ">", 0.05),
    )
    said = "textures and reflections at their full, shadows slightly aliased by the shadow-buffer"
    here = (
        f"with {rows} x {2 * rows} entries the shadows of {100 * measured['aliased_share']:.2g} % of the pixels "
        f"differ from exact ones; textures change {100 * measured['textured_share']:.0f} %"
    )
    table = _table(reflections=True, textures=True, shadow_buffer=True)
    panels = [("T-buffer and shadow-buffer", tonemap(image))]
    picture = pictures("Figure 11: all features", f"Paper: {said}.\nHere: {here}.", panels, 1, table)
    return _outcome("t-buffer-11", said, rule, measured, _feature_rows(table), picture)


# Figure 12: the scene of the tests.


def figure_12(scale: float, say: Say) -> Outcome:
    """Make figure 12: the procedural scene at three complexities [TB V.A]."""
    rows: Rows = []
    panels = []
    for objects in (3, 50, 100):
        say(f"t-buffer-12: {objects} objects")
        scene = stacked(objects, size_at(scale, VIEWPORT))
        frame = WhittedFrame(scene, T_BUFFER)
        panels.append((f"{objects} objects", tonemap(frame.image())))
        nearest = frame.nearest()
        covered = nearest >= 0
        rows.append({
            "objects": objects,
            "seen": len(np.unique(nearest[covered])),
            "coverage": float(covered.mean()),
            "extent": max(float(covered.any(axis=axis).mean()) for axis in (0, 1)),
            "pixels of an object": float(covered.sum() / objects),
            "other objects": float((nearest != SphereRays.of(scene).nearest).mean()),
        })  # fmt: skip
    measured: dict[str, float] = {}
    for row in rows:
        for name in ("coverage", "pixels of an object"):
            measured[f"{name.replace(' ', '_')}_{row['objects']}"] = row[name]
    measured |= {
        "least_extent": min(row["extent"] for row in rows),
        "least_seen_share": min(row["seen"] / row["objects"] for row in rows),
        "most_seen_share": max(row["seen"] / row["objects"] for row in rows),
        "other_objects_share": max(row["other objects"] for row in rows),
    }
    rule = (
        Condition("least_extent", ">=", 0.8),
        Condition("least_seen_share", ">=", 0.95),
        Condition("most_seen_share", "<=", 1.0),
        Condition("pixels_of_an_object_50", "<", "pixels_of_an_object_3"),
        Condition("pixels_of_an_object_100", "<", "pixels_of_an_object_50"),
        Condition("coverage_100", ">=", "coverage_3"),
        # Compare what the T-buffer sees with a count by numpy; they may differ by rounding at an outline.
        Condition("other_objects_share", "<=", 0.001),
    )
    said = "the objects grow smaller as they become more, so that they fill the viewport as far as they can"
    covers = ", ".join(f"{100 * row['coverage']:.0f} % ({row['objects']})" for row in rows)
    caption = (
        f"Paper: {said}.\nHere: the pile spans at least {100 * measured['least_extent']:.0f} % of the width or the "
        f"height; the objects cover {covers} of the viewport."
    )
    picture = pictures("Figure 12: the scene of the tests", caption, panels, 3)
    return _outcome("t-buffer-12", said, rule, measured, rows, picture)


def figure_18(scale: float, say: Say) -> Outcome:
    """Make figure 18: one scene with exact shadows and with shadow-buffers of five resolutions [TB V.F]."""
    scene = _three_spheres(scale, textures=False)
    exact = WhittedFrame(scene, T_BUFFER).image()
    panels = [("shadow rays", tonemap(exact))]
    rows: Rows = []
    for r in SHOWN_RESOLUTIONS:
        size = scaled(r, scale, r // 20)
        say(f"t-buffer-18: shadow-buffer {size} x {2 * size}")
        image = WhittedFrame(scene, Setup("t-buffer", "sphere", size)).image()
        share = differing(exact, image)
        rows.append({"paper_rows": r, "rows": size, "columns": 2 * size, "differing_share": share})
        panels.append((f"{size} x {2 * size}: {100 * share:.2f} % differ", tonemap(image)))
    measured = {f"differing_{row['paper_rows']}": float(row["differing_share"]) for row in rows}
    measured["left_at_2000"] = measured["differing_2000"] / max(measured["differing_400"], 1e-12)
    measured["gained_400_to_1200"] = measured["differing_400"] - measured["differing_1200"]
    measured["gained_1200_to_2000"] = measured["differing_1200"] - measured["differing_2000"]
    rule = (
        Condition("gained_400_to_1200", ">", 0.0),
        Condition("gained_1200_to_2000", "<", "gained_400_to_1200"),
        Condition("left_at_2000", "<=", 0.5),
    )
    said = "shadows improve much from 400 to 1200 rows, and little from there to 2000"
    here = "share of pixels whose shadow differs from exact rays, " + ", ".join(
        f"{100 * row['differing_share']:.2f} % ({row['rows']})" for row in rows
    )
    picture = pictures("Figure 18: resolution of the shadow-buffer", f"Paper: {said}.\nHere: {here}.", panels, 3)
    return _outcome("t-buffer-18", said, rule, measured, rows, picture)


FIGURES = {
    "t-buffer-9": (figure_9, "three spheres on a ground: shadows by rays, both algorithms alike"),
    "t-buffer-10": (figure_10, "the same with inter-object reflections"),
    "t-buffer-11": (figure_11, "the same with textures and a shadow-buffer as well"),
    "t-buffer-12": (figure_12, "the scene of the tests: 3, 50 and 100 stacked spheres"),
    "t-buffer-18": (figure_18, "shadows at five resolutions of the shadow-buffer, beside exact ones"),
}
