"""Figures 13 to 17 of the T-buffer paper [TB]: time and tests of the classical algorithm and the T-buffer.

The paper states neither the viewport nor the camera of its tests; here the viewport is 320 x 240 at scale 1. Both
algorithms render the same frames in turns, and a frame includes filling its shadow-buffers. In addition to the
time, all intersection tests are counted: the paper argues with this count, and it does not depend on the machine. A
count with numpy, `sphere_rays`, checks the shaders' counters. Comparing the pictures checks that the omitted tests
were not needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.figures.outcome import Outcome, Rows, Say, judged
from benchmarks.figures.sphere_rays import SphereRays
from benchmarks.figures.style import Axis, Series, plot
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
from benchmarks.timing import in_turns
from benchmarks.verdict import Condition

Float64 = NDArray[np.float64]

COUNTS = (10, 30, 100, 300, 1000, 2000, 3000, 4500, 6000)
RESOLUTIONS = tuple(range(200, 2001, 200))
VIEWPORT = (320, 240)
# Viewport in which the gain should be linear: an object costs a microsecond at any size, so pixels must cost more.
LARGE_VIEWPORT = (640, 480)
# With at least this many objects, tests dominate the time of the classical algorithm.
MANY_OBJECTS = 1000

_outcome = partial(judged, with_gl=True)


def counts(scale: float) -> list[int]:
    """Return the numbers of objects without duplicates, which a small scale would produce."""
    return sorted({scaled(n, scale, least) for n, least in zip(COUNTS, range(3, 100), strict=False)})


# Figures 13 to 16: time and tests by the number of objects.


def _sweep(
    name: str, scale: float, setups: Mapping[str, Setup], say: Say, viewport: tuple[int, int] = VIEWPORT
) -> Rows:
    """Return a row for each number of objects: seconds and tests of a frame for each setup."""
    rows: Rows = []
    for objects in counts(scale):
        say(f"{name}: {objects} objects")
        scene = stacked(objects, size_at(scale, viewport))
        frames = {key: WhittedFrame(scene, setup) for key, setup in setups.items()}
        seconds = in_turns(
            {key: frame.seconds for key, frame in frames.items()}, rounds=9, min_rounds=3, enough_s=6.0
        )
        rays = SphereRays.of(scene)
        row: dict[str, Any] = {"objects": objects, "coverage": float((rays.nearest >= 0).mean())}
        row |= {f"{key}_s": value for key, value in seconds.items()}
        row |= {"numpy_primary_tests": rays.primary_tests, "numpy_hits": rays.hits}
        row |= {"numpy_shadow_tests": rays.shadow_tests, "numpy_tests_ratio": rays.tests_ratio}
        for key, frame in frames.items():
            row[f"{key}_tests"] = sum(frame.tests().values())
            row |= {f"{key}_{purpose}_tests": count for purpose, count in frame.tests().items()}
            if key != "classic":
                exact, found = frames["classic"].image(), frame.image()
                row[f"{key}_differing_share"] = differing(exact, found)
                brighter = differing(exact, np.maximum(exact, found)) * exact[..., 0].size
                row[f"{key}_lost_shadow_share"] = float(brighter / max(rays.shadowed, 1.0))
        rows.append(row)
    return rows


def _column(rows: Rows, name: str) -> Float64:
    return np.array([row[name] for row in rows], float)


def _gains(rows: Rows, key: str) -> tuple[Float64, Float64]:
    """Return the gains of `key` over the classical algorithm, in time and in tests, and add them to the rows."""
    gains = []
    for unit in ("s", "tests"):
        with np.errstate(divide="ignore"):
            gain = _column(rows, f"classic_{unit}") / _column(rows, f"{key}_{unit}")
        for row, value in zip(rows, gain, strict=True):
            row[f"{key}_gain_{'time' if unit == 's' else 'tests'}"] = float(value)
        gains.append(gain)
    return gains[0], gains[1]


def fit(x: ArrayLike, y: ArrayLike, degree: int) -> tuple[Float64, float]:
    """Fit a polynomial by least squares; return it, highest power first, and R^2."""
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    coefficients = np.polyfit(xs, ys, degree)
    residual = ys - np.polyval(coefficients, xs)
    variance = float(np.sum((ys - ys.mean()) ** 2))
    return coefficients, float(1 - residual @ residual / variance) if variance else math.nan


def _slope(rows: Rows, gain: Float64) -> float:
    """Return the slope of a straight line through the gain: the gain of a thousand more objects."""
    return float(1000 * fit(_column(rows, "objects"), gain, 1)[0][0])


def _exponent(rows: Rows, gain: Float64, least: float = 1) -> float:
    """Fit p of gain ~ N^p in logarithms, to rows of at least `least` objects, or to the last two rows."""
    n = _column(rows, "objects")
    late = n >= min(least, n[-2])
    return float(np.polyfit(np.log(n[late]), np.log(gain[late]), 1)[0])


def _counters(rows: Rows, *keys: str) -> dict[str, float]:
    """Return the shaders' counts of primary tests divided by numpy's counts; see `COUNTED`."""
    hits, pairs = _column(rows, "numpy_hits"), _column(rows, "numpy_primary_tests")
    classic = _column(rows, "classic_primary_tests") / pairs
    found = np.concatenate([_column(rows, f"{key}_primary_tests") / hits for key in keys])
    return {"classic_miscounted": float(np.abs(classic - 1).max()), "least_tests_over_hits": float(found.min())}


#: The classical algorithm tests every pair of a ray and an object. No algorithm may skip a pair that hits, except
#: by rounding at an outline.
COUNTED = (Condition("classic_miscounted", "<=", 0.0), Condition("least_tests_over_hits", ">=", 0.999))

OBJECTS = Axis("number of objects", zero=True)
LOG_OBJECTS = Axis("number of objects", log=True)
FRAME_TIME = Axis("time of a frame / s", log=True)
FRAME_TESTS = Axis("intersection tests of a frame", log=True)


def figure_13(scale: float, say: Say) -> Outcome:
    """Make figure 13: running times of both algorithms, without shadow-buffer [TB V.C]."""
    rows = _sweep("t-buffer-13", scale, {"classic": CLASSIC, "t_buffer": T_BUFFER}, say)
    time, tests = _gains(rows, "t_buffer")
    measured = {
        "least_time_ratio": float(time.min()),
        "least_tests_ratio": float(tests.min()),
        "classic_exponent_tests": _exponent(rows, _column(rows, "classic_tests")),
        "differing_share": float(_column(rows, "t_buffer_differing_share").max()),
    } | _counters(rows, "t_buffer")
    rule = (
        Condition("least_time_ratio", ">", 1.0),
        Condition("least_tests_ratio", ">", 1.0),
        Condition("differing_share", "<=", 0.0),
        *COUNTED,
    )
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
    """Make figure 14: the ratio of the times of figure 13 [TB V.C]."""
    rows = _sweep("t-buffer-14", scale, {"classic": CLASSIC, "t_buffer": T_BUFFER}, say)
    time, tests = _gains(rows, "t_buffer")
    expected, late = float(rows[-1]["numpy_tests_ratio"]), rows[-1]["objects"] / 6
    measured = {
        "first_time_ratio": float(time[0]),
        "last_time_ratio": float(time[-1]),
        "late_exponent_time": _exponent(rows, time, late),
        "first_tests_ratio": float(tests[0]),
        "last_tests_ratio": float(tests[-1]),
        "late_exponent_tests": _exponent(rows, tests, late),
        "last_tests_ratio_in_numpy": expected,
        "tests_over_numpy": float(tests[-1]) / expected,
        "differing_share": float(_column(rows, "t_buffer_differing_share").max()),
    } | _counters(rows, "t_buffer")
    rule = (
        *COUNTED,
        Condition("last_time_ratio", ">", "first_time_ratio"),
        # The gain has levelled off: a gain in proportion to the objects would have exponent 1.
        Condition("late_exponent_time", "<=", 0.2),
        Condition("late_exponent_tests", "<=", 0.2),
        # An algorithm without useless primary tests gains what numpy counts; this one makes a few useless tests.
        Condition("tests_over_numpy", ">=", 0.9),
        Condition("tests_over_numpy", "<=", 1.02),
        Condition("differing_share", "<=", 0.0),
    )
    said = "the ratio of the times grows with the number of objects and saturates (there near 2.2)"
    here = (
        f"from {time[0]:.2f} to {time[-1]:.2f} in time, to {tests[-1]:.2f} in tests. Primary rays are all that is "
        f"saved: without any in vain the tests would come to {expected:.2f}, by a count in numpy"
    )
    n = _column(rows, "objects")
    series = [
        Series("in time", n, time),
        Series("in intersection tests", n, tests),
        Series("tests without primary rays in vain", n, _column(rows, "numpy_tests_ratio"), "guide"),
    ]
    panels = [(OBJECTS, Axis("classical / T-buffer", zero=True), series)]
    picture = plot(
        "Figure 14: gain of the T-buffer alone", f"Paper: {said}.\nHere: {here}.", panels, size=(720, 420)
    )
    return _outcome("t-buffer-14", said, rule, measured, rows, picture)


def figure_15(scale: float, say: Say) -> Outcome:
    """Make figure 15: the gain with a shadow-buffer of 400 x 800 [TB V.D]."""
    # Entries per object are the same at every scale.
    entries = scaled(400, math.sqrt(scale), 20)
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
        # With more spheres, less area is free between them, so this is the gain for a constant covered area:
        "exponent_tests_of_area": _exponent(rows, tests * _column(rows, "coverage")),
        "slowdown": float(seconds[-1] / seconds[0]),
        "classic_linear_r2": fit(n, _column(rows, "classic_s"), 1)[1],
        "last_differing_share": float(_column(rows, "shadow_buffer_differing_share")[-1]),
        "most_lost_shadow_share": float(_column(rows, "shadow_buffer_lost_shadow_share").max()),
    } | _counters(rows, "shadow_buffer")
    rule = (
        Condition("linear_r2_time", ">=", 0.95),
        Condition("linear_r2_tests", ">=", 0.95),
        Condition("exponent_tests_of_area", ">=", 1.0),
        Condition("slowdown", "<", 3.0),
        Condition("classic_linear_r2", ">=", 0.95),
        # It saves shadow rays, but does not lose shadows.
        Condition("most_lost_shadow_share", "<=", 0.8),
        *COUNTED,
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
        f"a frame grows {measured['slowdown']:.2f} x. A sphere is smaller than an entry then: "
        f"{100 * measured['last_differing_share']:.0f} % of the pixels have other shadows than by rays"
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
    """Make figure 16: the gain with a shadow-buffer of 1000 x 2000, beside that of figure 15 [TB V.E]."""
    coarse, fine = scaled(400, math.sqrt(scale), 20), scaled(1000, math.sqrt(scale), 50)
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
        "coarse_slope_tests": _slope(rows, coarse_tests),
        "fine_slope_tests": _slope(rows, fine_tests),
        "coarse_differing_share": float(_column(rows, "coarse_differing_share")[-1]),
        "fine_differing_share": float(_column(rows, "fine_differing_share")[-1]),
    } | _counters(rows, "coarse", "fine")
    rule = (
        Condition("fine_gain_time", "<", "coarse_gain_time"),
        Condition("fine_gain_tests", "<", "coarse_gain_tests"),
        Condition("fine_gain_time", ">", "fine_first_gain_time"),
        Condition("fine_gain_tests", ">", "fine_first_gain_tests"),
        Condition("fine_slope_tests", "<", "coarse_slope_tests"),
        Condition("fine_differing_share", "<", "coarse_differing_share"),
        *COUNTED,
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


def quadratic_share(x: Float64, curve: Float64) -> float:
    """Return the square term's fraction of a quadratic's growth from first to last x: 1 for x^2, 0 for a line."""
    first, last = np.polyval(curve, x[[0, -1]])
    return float(curve[0] * (x[-1] ** 2 - x[0] ** 2) / (last - first)) if last > first else math.nan


def figure_17(scale: float, say: Say) -> Outcome:
    """Make figure 17: time of a frame by the resolution of the shadow-buffer, with 500 objects [TB V.E]."""
    objects = scaled(500, scale, 20)
    scene = stacked(objects, size_at(scale, VIEWPORT))
    sizes = sorted({scaled(r, scale, 20 + i) for i, r in enumerate(RESOLUTIONS)})
    say(f"t-buffer-17: {objects} objects, shadow-buffers up to {sizes[-1]} x {2 * sizes[-1]}")
    frames = {str(r): WhittedFrame(scene, Setup("t-buffer", "sphere", r)) for r in sizes}
    seconds = in_turns(
        {key: frame.seconds for key, frame in frames.items()}, rounds=15, min_rounds=3, enough_s=60.0
    )
    rows: Rows = [
        {
            "rows": r,
            "columns": 2 * r,
            "s": seconds[str(r)],
            "tests": frames[str(r)].tests()["shadow_buffer"],
            "entries": frames[str(r)].shadow_entries(),
        }
        for r in sizes
    ]
    r, s = _column(rows, "rows"), _column(rows, "s")
    curve, r2 = fit(r, s, 2)
    tests_curve, tests_r2 = fit(r, _column(rows, "tests"), 2)
    measured = {
        "objects": float(objects),
        "quadratic_r2_time": r2,
        "quadratic_r2_tests": tests_r2,
        "quadratic_share_time": quadratic_share(r, curve),
        "quadratic_share_tests": quadratic_share(r, tests_curve),
        # Each entry that holds an object was tested.
        "tests_over_entries": float((_column(rows, "tests") / _column(rows, "entries")).min()),
        "quadratic_ms_per_megacell": float(1e3 * 1e6 * curve[0] / 2),
        "first_s": float(s[0]),
        "last_s": float(s[-1]),
    }
    rule = (
        Condition("quadratic_r2_time", ">=", 0.99),
        Condition("quadratic_r2_tests", ">=", 0.99),
        # A quadratic also fits a straight line, so require that the square term causes the growth.
        Condition("quadratic_share_time", ">=", 0.5),
        Condition("quadratic_share_time", "<=", 1.5),
        Condition("quadratic_share_tests", ">=", 0.5),
        Condition("quadratic_share_tests", "<=", 1.5),
        Condition("tests_over_entries", ">=", 1.0),
    )
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


FIGURES = {
    "t-buffer-13": (figure_13, "times of the classical algorithm and the T-buffer, 10 to 6000 objects"),
    "t-buffer-14": (figure_14, "the ratio of these times"),
    "t-buffer-15": (figure_15, "gain with a shadow-buffer of 400 x 800, 10 to 6000 objects"),
    "t-buffer-16": (figure_16, "gain with a shadow-buffer of 1000 x 2000"),
    "t-buffer-17": (figure_17, "time against the resolution of the shadow-buffer, with a quadratic fit"),
}
