"""Figures 9 to 18 of the T-buffer paper [TB]: its pictures, and the classical algorithm against the T-buffer.

The paper gives neither the viewport nor the camera of its tests; here the viewport is 320 x 240 at scale 1. Both
algorithms render the same frames in turns, and a frame includes the filling of its shadow-buffers. Besides time all
intersection tests are counted: the count is what the paper argues with, and no machine changes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glpath.experiments.timing import in_turns
from glpath.experiments.verdict import Condition
from glpath.figures.outcome import Outcome, Rows, Say, judged
from glpath.figures.style import Axis, Series, pictures, plot
from glpath.figures.whitted_frame import Setup, WhittedFrame
from glpath.image import tonemap
from glpath.scene import Scene, load_scene

Float64 = NDArray[np.float64]

COUNTS = (10, 30, 100, 300, 1000, 2000, 3000, 4500, 6000)
RESOLUTIONS = tuple(range(200, 2001, 200))
SHOWN_RESOLUTIONS = (400, 800, 1200, 1600, 2000)
VIEWPORT = (320, 240)
# Where the gain is to be linear: an object costs a microsecond, whatever it covers; pixels have to cost more.
LARGE_VIEWPORT = (640, 480)
# From here on the classical algorithm's time is that of its tests.
MANY_OBJECTS = 1000
PICTURE = (480, 360)
REFLECTIONS = 4

# A pixel differs when a channel of its 8-bit sRGB does by more than this.
VISIBLE = 2

CLASSIC = Setup("classic")
T_BUFFER = Setup("t-buffer")


def scaled(number: int, scale: float, least: int) -> int:
    """A size at this scale, but never too small to mean something."""
    return max(least, round(number * scale))


def _size(of: tuple[int, int], scale: float) -> tuple[int, int]:
    return scaled(of[0], scale, 16), scaled(of[1], scale, 12)


def _counts(scale: float) -> list[int]:
    """Numbers of objects; those that a small scale makes equal appear once."""
    return sorted({scaled(n, scale, least) for n, least in zip(COUNTS, range(3, 100), strict=False)})


def _three_spheres(scale: float, textures: bool) -> Scene:
    scene = load_scene("three-spheres").with_camera(resolution=_size(PICTURE, scale))
    if textures:
        return scene
    # Of the mean colour of what they show otherwise.
    colours = [texture.image.mean(axis=(0, 1), dtype=float) for texture in scene.textures]
    materials = tuple(
        m if m.texture is None else replace(m, texture=None, reflectance=m.reflectance * colours[m.texture])
        for m in scene.materials
    )
    return replace(scene, materials=materials)


def _stacked(objects: int, size: tuple[int, int]) -> Scene:
    width, height = size
    parameters = {"objects": objects, "kind": "sphere", "resolution": height, "aspect": width / height}
    return load_scene("stacked", parameters)


def _differing(a: Float64, b: Float64) -> float:
    """Share of pixels that look different in two pictures (H, W, 3), radiance."""
    difference = np.abs(tonemap(a).astype(int) - tonemap(b).astype(int)).max(axis=-1)
    return float((difference > VISIBLE).mean())


_outcome = partial(judged, with_gl=True)


# Figures 9 to 11: the three configurations of one simple scene.


def _table(**on: bool) -> list[tuple[str, str]]:
    """The paper's table of features."""
    features = {"shadows": "Shadows", "reflections": "Inter-object reflections", "textures": "Textures"}
    features |= {"t_buffer": "T-buffer", "shadow_buffer": "Shadow-buffer"}
    on = {"shadows": True, "t_buffer": True} | on
    return [("Feature", "Status")] + [(text, "ON" if on.get(key) else "OFF") for key, text in features.items()]


def _feature_rows(table: Sequence[tuple[str, str]]) -> Rows:
    return [{"feature": feature, "status": status} for feature, status in table[1:]]


def figure_9(scale: float, say: Say) -> Outcome:
    """Three spheres, shadows only: the classical algorithm and the T-buffer give the same picture [TB IV.A]."""
    scene = _three_spheres(scale, textures=False)
    return _plain_features("t-buffer-9", "Figure 9: shadows by rays", scene, 1, _table(), say)


def figure_10(scale: float, say: Say) -> Outcome:
    """With inter-object reflections, which call the classical algorithm [TB IV.B]."""
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
        "differing_share": _differing(classic.image(), image),
        "reflecting_share": _differing(direct, image),
        "classic_primary_tests": float(classic.tests()["primary"]),
        "t_buffer_primary_tests": float(ours.tests()["primary"]),
    }
    rule: tuple[Condition, ...] = (
        Condition("differing_share", "<=", 1e-3),
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
    """Everything on; the shadow-buffer aliases the shadows a little [TB IV.C]."""
    scene, rows = _three_spheres(scale, textures=True), scaled(400, scale, 40)
    say(f"t-buffer-11: shadow-buffer {rows} x {2 * rows}")
    depth = 1 + REFLECTIONS
    buffered = WhittedFrame(scene, Setup("t-buffer", "sphere", rows, depth))
    exact = WhittedFrame(scene, replace(T_BUFFER, max_depth=depth))
    plain = WhittedFrame(_three_spheres(scale, textures=False), Setup("t-buffer", "sphere", rows, depth))
    image = buffered.image()
    measured = {
        "aliased_share": _differing(exact.image(), image),
        "textured_share": _differing(plain.image(), image),
        "exact_shadow_tests": float(exact.tests()["shadow"]),
        "buffer_shadow_tests": float(buffered.tests()["shadow"]),
        "shadow_buffer_tests": float(buffered.tests()["shadow_buffer"]),
        "shadow_rows": float(rows),
    }
    rule = (
        Condition("aliased_share", ">", 0.0),
        Condition("aliased_share", "<=", 0.1),
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
    """The procedural scene for three complexities [TB V.A]."""
    rows: Rows = []
    panels = []
    for objects in (3, 50, 100):
        say(f"t-buffer-12: {objects} objects")
        scene = _stacked(objects, _size(VIEWPORT, scale))
        panels.append((f"{objects} objects", tonemap(WhittedFrame(scene, T_BUFFER).image())))
        covered = _covered(scene)
        extents = [float(covered.any(axis=axis).mean()) for axis in (0, 1)]
        rows.append({"objects": objects, "coverage": float(covered.mean()), "extent": max(extents)})
    measured = {f"coverage_{row['objects']}": row["coverage"] for row in rows}
    measured["least_extent"] = min(row["extent"] for row in rows)
    rule = (Condition("least_extent", ">=", 0.8), Condition("coverage_100", ">=", "coverage_3"))
    said = "the objects grow smaller as they become more, so that they fill the viewport as far as they can"
    covers = ", ".join(f"{100 * row['coverage']:.0f} % ({row['objects']})" for row in rows)
    caption = (
        f"Paper: {said}.\nHere: the pile spans at least {100 * measured['least_extent']:.0f} % of the width or the "
        f"height; the objects cover {covers} of the viewport."
    )
    picture = pictures("Figure 12: the scene of the tests", caption, panels, 3)
    return _outcome("t-buffer-12", said, rule, measured, rows, picture)


def _covered(scene: Scene) -> NDArray[np.bool_]:
    """(H, W): the pixels that see an object."""
    white, black = np.ones(3), np.zeros(3)
    materials = tuple(
        replace(m, reflectance=white, two_sided=True, specular=black, mirror=black, texture=None)
        for m in scene.materials
    )
    lit = replace(scene, materials=materials, lights=(), ambient=white, sky=None)
    return np.asarray(WhittedFrame(lit, T_BUFFER).image().max(axis=-1) > 0)


# Figures 13 to 16: time and tests against the number of objects.


def _sweep(
    name: str, scale: float, setups: Mapping[str, Setup], say: Say, viewport: tuple[int, int] = VIEWPORT
) -> Rows:
    """One row for each number of objects: seconds and tests of a frame for each setup."""
    rows: Rows = []
    for objects in _counts(scale):
        say(f"{name}: {objects} objects")
        scene = _stacked(objects, _size(viewport, scale))
        frames = {key: WhittedFrame(scene, setup) for key, setup in setups.items()}
        seconds = in_turns(
            {key: frame.seconds for key, frame in frames.items()}, rounds=9, min_rounds=3, enough_s=6.0
        )
        row: dict[str, Any] = {"objects": objects, "coverage": float(_covered(scene).mean())}
        row |= {f"{key}_s": value for key, value in seconds.items()}
        for key, frame in frames.items():
            row[f"{key}_tests"] = sum(frame.tests().values())
            row |= {f"{key}_{purpose}_tests": count for purpose, count in frame.tests().items()}
        rows.append(row)
    return rows


def _column(rows: Rows, name: str) -> Float64:
    return np.array([row[name] for row in rows], float)


def _gains(rows: Rows, key: str) -> tuple[Float64, Float64]:
    """By how much `key` beats the classical algorithm: in time, in tests; also added to the rows."""
    gains = []
    for unit in ("s", "tests"):
        gain = _column(rows, f"classic_{unit}") / _column(rows, f"{key}_{unit}")
        for row, value in zip(rows, gain, strict=True):
            row[f"{key}_gain_{'time' if unit == 's' else 'tests'}"] = float(value)
        gains.append(gain)
    return gains[0], gains[1]


def fit(x: ArrayLike, y: ArrayLike, degree: int) -> tuple[Float64, float]:
    """Least-squares polynomial, highest power first, and its coefficient of determination R^2."""
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    coefficients = np.polyfit(xs, ys, degree)
    residual = ys - np.polyval(coefficients, xs)
    return coefficients, float(1 - residual @ residual / np.sum((ys - ys.mean()) ** 2))


def _exponent(rows: Rows, gain: Float64, least: int = 1) -> float:
    """p of gain ~ N^p, by least squares in logarithms, from `least` objects on (of few scenes, of the last two)."""
    n = _column(rows, "objects")
    late = n >= min(least, n[-2])
    return float(np.polyfit(np.log(n[late]), np.log(gain[late]), 1)[0])


OBJECTS = Axis("number of objects", zero=True)
LOG_OBJECTS = Axis("number of objects", log=True)
FRAME_TIME = Axis("time of a frame / s", log=True)
FRAME_TESTS = Axis("intersection tests of a frame", log=True)


def figure_13(scale: float, say: Say) -> Outcome:
    """Running times of both algorithms, shadow-buffer off [TB V.C]."""
    rows = _sweep("t-buffer-13", scale, {"classic": CLASSIC, "t_buffer": T_BUFFER}, say)
    time, tests = _gains(rows, "t_buffer")
    measured = {
        "least_time_ratio": float(time.min()),
        "least_tests_ratio": float(tests.min()),
        "classic_exponent_tests": _exponent(rows, _column(rows, "classic_tests")),
    }
    rule = (Condition("least_time_ratio", ">", 1.0), Condition("least_tests_ratio", ">", 1.0))
    said = "without shadow-buffer the T-buffer is always faster than the classical algorithm"
    here = (
        f"its time is better by at least a factor of {time.min():.2f}, its tests by {tests.min():.2f}, "
        f"for {rows[0]['objects']} to {rows[-1]['objects']} spheres"
    )
    n = _column(rows, "objects")

    def both(unit: str) -> list[Series]:
        names = {"classic": "classical", "t_buffer": "T-buffer"}
        return [Series(text, n, _column(rows, f"{key}_{unit}")) for key, text in names.items()]

    panels = [(LOG_OBJECTS, FRAME_TIME, both("s")), (LOG_OBJECTS, FRAME_TESTS, both("tests"))]
    picture = plot("Figure 13: T-buffer alone", f"Paper: {said}.\nHere: {here}.", panels)
    return _outcome("t-buffer-13", said, rule, measured, rows, picture)


def figure_14(scale: float, say: Say) -> Outcome:
    """The ratio of these times [TB V.C]."""
    rows = _sweep("t-buffer-14", scale, {"classic": CLASSIC, "t_buffer": T_BUFFER}, say)
    time, tests = _gains(rows, "t_buffer")
    late = tests[_column(rows, "objects") >= rows[-1]["objects"] / 6]
    # Both algorithms shoot the same shadow rays; beside them all primary rays of the classical one are saved.
    limit = 1 + rows[-1]["classic_primary_tests"] / max(1, rows[-1]["t_buffer_shadow_tests"])
    measured = {
        "first_time_ratio": float(time[0]),
        "last_time_ratio": float(time[-1]),
        "first_tests_ratio": float(tests[0]),
        "last_tests_ratio": float(tests[-1]),
        "late_tests_spread": float(late.max() / late.min() - 1),
        "limit": float(limit),
    }
    rule = (
        Condition("last_time_ratio", ">", "first_time_ratio"),
        Condition("late_tests_spread", "<=", 0.1),
        Condition("last_tests_ratio", "<=", "limit"),
    )
    said = "the ratio of the times grows with the number of objects and saturates (there near 2.2)"
    here = (
        f"from {time[0]:.2f} to {time[-1]:.2f} in time, to {tests[-1]:.2f} in tests. Primary rays are all that is "
        f"saved: with {limit - 1:.2f} of them for each shadow ray the limit is {limit:.2f}"
    )
    n = _column(rows, "objects")
    series = [
        Series("in time", n, time),
        Series("in intersection tests", n, tests),
        Series(f"limit of the tests, {limit:.2f}", (n[0], n[-1]), (limit, limit), "guide"),
    ]
    panels = [(OBJECTS, Axis("classical / T-buffer", zero=True), series)]
    picture = plot(
        "Figure 14: gain of the T-buffer alone", f"Paper: {said}.\nHere: {here}.", panels, size=(720, 420)
    )
    return _outcome("t-buffer-14", said, rule, measured, rows, picture)


def figure_15(scale: float, say: Say) -> Outcome:
    """The gain with a shadow-buffer of 400 x 800 [TB V.D]."""
    entries = scaled(400, scale, 20)
    setups = {"classic": CLASSIC, "shadow_buffer": Setup("t-buffer", "sphere", entries)}
    rows = _sweep("t-buffer-15", scale, setups, say, LARGE_VIEWPORT)
    time, tests = _gains(rows, "shadow_buffer")
    n = _column(rows, "objects")
    line, r2 = fit(n, time, 1)
    seconds = _column(rows, "shadow_buffer_s")
    measured = {
        "shadow_rows": float(entries),
        "last_gain_time": float(time[-1]),
        "last_gain_tests": float(tests[-1]),
        "linear_r2_time": r2,
        "linear_r2_tests": fit(n, tests, 1)[1],
        "exponent_time": _exponent(rows, time),
        "late_exponent_time": _exponent(rows, time, MANY_OBJECTS),
        "late_exponent_time_of_area": _exponent(rows, time * _column(rows, "coverage"), MANY_OBJECTS),
        "exponent_tests": _exponent(rows, tests),
        # The more spheres, the less lies free between them; the gain at one and the same covered area:
        "exponent_tests_of_area": _exponent(rows, tests * _column(rows, "coverage")),
        "slowdown": float(seconds[-1] / seconds[0]),
        "classic_linear_r2": fit(n, _column(rows, "classic_s"), 1)[1],
    }
    rule = (
        Condition("linear_r2_time", ">=", 0.95),
        Condition("linear_r2_tests", ">=", 0.95),
        Condition("exponent_tests_of_area", ">=", 1.0),
        Condition("slowdown", "<", 3.0),
    )
    said = (
        f"with a shadow-buffer of {entries} x {2 * entries} the gain is about linear in the number of objects, "
        "and the time hardly depends on it"
    )
    here = (
        f"gain {time[-1]:.0f} in time and {tests[-1]:.0f} in tests at {n[-1]:.0f} spheres, straight lines with "
        f"R² = {r2:.3f} and {measured['linear_r2_tests']:.3f} (tests for the same covered area: N to the power "
        f"{measured['exponent_tests_of_area']:.2f}; time from {MANY_OBJECTS} on: "
        f"{measured['late_exponent_time_of_area']:.2f}); from {n[0]:.0f} to {n[-1]:.0f} spheres the time of "
        f"a frame grows {measured['slowdown']:.2f} x"
    )
    tests_line, _ = fit(n, tests, 1)
    panels = [
        (
            OBJECTS,
            Axis(f"gain in {unit}", zero=True),
            [Series("classical / T-buffer", n, gain), Series("straight line", n, np.polyval(through, n), "guide")],
        )
        for unit, gain, through in (("time", time, line), ("intersection tests", tests, tests_line))
    ]
    times = [
        Series("classical", n, _column(rows, "classic_s")),
        Series("T-buffer and shadow-buffer", n, seconds),
    ]
    panels.append((LOG_OBJECTS, FRAME_TIME, times))
    title = "Figure 15: gain of T-buffer and shadow-buffer"
    picture = plot(title, f"Paper: {said}.\nHere: {here}.", panels, size=(480, 380))
    return _outcome("t-buffer-15", said, rule, measured, rows, picture)


def figure_16(scale: float, say: Say) -> Outcome:
    """The gain with a shadow-buffer of 1000 x 2000, beside that of figure 15 [TB V.E]."""
    coarse, fine = scaled(400, scale, 20), scaled(1000, scale, 50)
    setups = {
        "classic": CLASSIC,
        "coarse": Setup("t-buffer", "sphere", coarse),
        "fine": Setup("t-buffer", "sphere", fine),
    }
    rows = _sweep("t-buffer-16", scale, setups, say)
    coarse_time, coarse_tests = _gains(rows, "coarse")
    fine_time, fine_tests = _gains(rows, "fine")
    measured = {
        "coarse_rows": float(coarse),
        "fine_rows": float(fine),
        "coarse_gain_time": float(coarse_time[-1]),
        "fine_gain_time": float(fine_time[-1]),
        "coarse_gain_tests": float(coarse_tests[-1]),
        "fine_gain_tests": float(fine_tests[-1]),
        "fine_first_gain_time": float(fine_time[0]),
        "fine_first_gain_tests": float(fine_tests[0]),
    }
    rule = (
        Condition("fine_gain_time", "<", "coarse_gain_time"),
        Condition("fine_gain_tests", "<", "coarse_gain_tests"),
        Condition("fine_gain_time", ">", "fine_first_gain_time"),
        Condition("fine_gain_tests", ">", "fine_first_gain_tests"),
    )
    names = f"{coarse} x {2 * coarse}", f"{fine} x {2 * fine}"
    said = f"with a shadow-buffer of {names[1]} the gain still grows, but less than with {names[0]}"
    here = (
        f"at {rows[-1]['objects']} spheres the gain in time falls from {coarse_time[-1]:.0f} to "
        f"{fine_time[-1]:.0f}, in tests from {coarse_tests[-1]:.0f} to {fine_tests[-1]:.0f}"
    )
    n = _column(rows, "objects")
    panels = [
        (OBJECTS, Axis(f"gain in {unit}", zero=True), [Series(names[0], n, a), Series(names[1], n, b)])
        for unit, a, b in (("time", coarse_time, fine_time), ("intersection tests", coarse_tests, fine_tests))
    ]
    picture = plot("Figure 16: a finer shadow-buffer costs gain", f"Paper: {said}.\nHere: {here}.", panels)
    return _outcome("t-buffer-16", said, rule, measured, rows, picture)


# Figures 17 and 18: the resolution of the shadow-buffer.


def figure_17(scale: float, say: Say) -> Outcome:
    """Time of a frame against the resolution of the shadow-buffer, 500 objects [TB V.E]."""
    objects = scaled(500, scale, 20)
    scene = _stacked(objects, _size(VIEWPORT, scale))
    sizes = sorted({scaled(r, scale, 20 + i) for i, r in enumerate(RESOLUTIONS)})
    say(f"t-buffer-17: {objects} objects, shadow-buffers up to {sizes[-1]} x {2 * sizes[-1]}")
    frames = {str(r): WhittedFrame(scene, Setup("t-buffer", "sphere", r)) for r in sizes}
    seconds = in_turns(
        {key: frame.seconds for key, frame in frames.items()}, rounds=15, min_rounds=3, enough_s=60.0
    )
    rows: Rows = [
        {"rows": r, "columns": 2 * r, "s": seconds[str(r)], "tests": frames[str(r)].tests()["shadow_buffer"]}
        for r in sizes
    ]
    r, s = _column(rows, "rows"), _column(rows, "s")
    curve, r2 = fit(r, s, 2)
    tests_curve, tests_r2 = fit(r, _column(rows, "tests"), 2)
    measured = {
        "objects": float(objects),
        "quadratic_r2_time": r2,
        "quadratic_r2_tests": tests_r2,
        "quadratic_ms_per_megacell": float(1e3 * 1e6 * curve[0] / 2),
        "first_s": float(s[0]),
        "last_s": float(s[-1]),
    }
    rule = (Condition("quadratic_r2_time", ">=", 0.99), Condition("quadratic_r2_tests", ">=", 0.99))
    said = "time is quadratic in the resolution of the shadow-buffer, R² = 0.9996"
    here = (
        f"R² = {r2:.4f} in time, {tests_r2:.4f} in tests, with {objects} spheres; "
        f"from {1e3 * s[0]:.0f} ms at {sizes[0]} x {2 * sizes[0]} to {1e3 * s[-1]:.0f} ms at "
        f"{sizes[-1]} x {2 * sizes[-1]}"
    )
    smooth = np.linspace(r[0], r[-1], 100)
    across = Axis("rows of the shadow-buffer (columns: twice as many)", zero=True)
    panels = [
        (
            across,
            Axis("time of a frame / ms", zero=True),
            [Series("measured", r, 1e3 * s), Series("quadratic", smooth, 1e3 * np.polyval(curve, smooth), "guide")],
        ),
        (
            across,
            Axis("tests to fill the shadow-buffer / 1000", zero=True),
            [
                Series("counted", r, 1e-3 * _column(rows, "tests")),
                Series("quadratic", smooth, 1e-3 * np.polyval(tests_curve, smooth), "guide"),
            ],
        ),
    ]
    title = "Figure 17: time against the resolution of the shadow-buffer"
    picture = plot(title, f"Paper: {said}.\nHere: {here}.", panels)
    return _outcome("t-buffer-17", said, rule, measured, rows, picture)


def figure_18(scale: float, say: Say) -> Outcome:
    """One scene with exact shadows and with shadow-buffers of five resolutions [TB V.F]."""
    scene = _three_spheres(scale, textures=False)
    exact = WhittedFrame(scene, T_BUFFER).image()
    panels = [("shadow rays", tonemap(exact))]
    rows: Rows = []
    for r in SHOWN_RESOLUTIONS:
        size = scaled(r, scale, r // 20)
        say(f"t-buffer-18: shadow-buffer {size} x {2 * size}")
        image = WhittedFrame(scene, Setup("t-buffer", "sphere", size)).image()
        share = _differing(exact, image)
        rows.append({"paper_rows": r, "rows": size, "columns": 2 * size, "differing_share": share})
        panels.append((f"{size} x {2 * size}: {100 * share:.2f} % differ", tonemap(image)))
    measured = {f"differing_{row['paper_rows']}": float(row["differing_share"]) for row in rows}
    measured["gained_400_to_1200"] = measured["differing_400"] - measured["differing_1200"]
    measured["gained_1200_to_2000"] = measured["differing_1200"] - measured["differing_2000"]
    rule = (
        Condition("gained_400_to_1200", ">", 0.0),
        Condition("gained_1200_to_2000", "<", "gained_400_to_1200"),
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
    "t-buffer-13": (figure_13, "times of the classical algorithm and the T-buffer, 10 to 6000 objects"),
    "t-buffer-14": (figure_14, "the ratio of these times"),
    "t-buffer-15": (figure_15, "gain with a shadow-buffer of 400 x 800, 10 to 6000 objects"),
    "t-buffer-16": (figure_16, "gain with a shadow-buffer of 1000 x 2000"),
    "t-buffer-17": (figure_17, "time against the resolution of the shadow-buffer, with a quadratic fit"),
    "t-buffer-18": (figure_18, "shadows at five resolutions of the shadow-buffer, beside exact ones"),
}
