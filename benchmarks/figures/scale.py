"""Growth of the time of a path set with the number of triangles, from 36 to 5 million, beside Mitsuba 3.

No figure of a paper. The scenes show nearly the same picture: the Cornell box with fifteen equal balls instead of
its two boxes. The balls are tessellated more and more finely (12 + 15 * 20 * 4^k triangles; the first scene is the
original box, with 36). Their area stays the same, so the same fraction p of R rays hits them for any number N of
triangles. A set hits about N (1 - exp(-p R / N)) triangles: nearly all that face the room while they are larger
than the distance between rays, and never more than p R. The number of triangles that the eye sees is counted.

The programs render the same scenes at the same depth, in turns. The time before the first path set is reported
separately: upload and BVH for ours, loading, which builds a BVH, for Mitsuba. Scans draw every triangle for every
direction, so larger scenes skip them after a scene in which a set takes too long.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.figures.outcome import Outcome, Rows, Say, judged
from benchmarks.figures.style import Axis, Series, plot
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.timing import in_turns, seconds_of
from benchmarks.verdict import Condition
from glpath.errors import GlpathError
from glpath.gl.context import get_context
from glpath.gl.device_scene import DeviceScene
from glpath.integrators.path_engines import path_engine
from glpath.integrators.path_set_engine import PathSetEngine
from glpath.integrators.path_settings import PathBufferSettings, PathSettings
from glpath.integrators.settings import PathSetSettings
from glpath.io import load_scene
from glpath.scene import Scene
from glpath.scene.model import Float64, Shape, Shapes
from glpath.scene.tessellate import unit_sphere

#: Numbers of subdivisions of the balls' triangles; the largest gives 4,915,200. Scale S limits the triangles to S
#: times that.
FINENESS = (0, 1, 2, 3, 4, 5, 6, 7)
DEPTH = 3
SIDE = 256
# Centres of the balls, in three layers of five.
_CENTRES = [
    (x, y, z)
    for y in (-0.75, -0.15, 0.45)
    for x, z in ((-0.65, -0.55), (0.05, -0.7), (0.65, -0.4), (-0.35, 0.15), (0.4, 0.35))
]
_RADIUS = 0.22
# Fits use scenes with at least this many triangles: below, costs that do not depend on triangles dominate.
_MANY = 1000
# If a set of scans takes more seconds than this, larger scenes skip scans.
_TOO_LONG = 8.0
# Number of path sets for the mean, and number of samples of one picture by Mitsuba.
_SETS, _SAMPLES = 32, 9
PROGRAMS = {"path": "path", "scans": "path-buffer", "mitsuba": "Mitsuba, LLVM"}


def balls(fineness: int, side: int = SIDE) -> Scene:
    """Return the Cornell box with fifteen balls instead of its boxes: 12 + 15 * 20 * 4^fineness triangles.

    The balls have flat normals, because programs differ in the meaning of smooth ones.
    """
    box = load_scene("cornell-box-36").with_camera(resolution=(side, side))
    walls = [shape for shape in box.shapes if not shape.name.endswith("-box")]
    white = next(shape.material for shape in walls if shape.name == "floor")
    maps = np.zeros((len(_CENTRES), 3, 4))
    maps[:, :, :3] = _RADIUS * np.eye(3)
    maps[:, :, 3] = _CENTRES
    ball = replace(unit_sphere(fineness), normals=None)
    return replace(box, name=f"balls-{fineness}", shapes=Shapes([*walls, Shape("balls", ball, white, maps)]))


def scenes(scale: float) -> list[Callable[[], Scene]]:
    """Return functions that make the scenes of the figure, small ones first; at least four."""
    side = SIDE if scale >= 1 else max(32, round(SIDE * math.sqrt(scale)))
    most = scale * 4 ** FINENESS[-1]
    kept = [k for k in FINENESS if k < 3 or 4**k <= 1.01 * most]
    box = load_scene("cornell-box-36").with_camera(resolution=(side, side))
    return [lambda: box, *(lambda k=k: balls(k, side) for k in kept)]


class _Ours:
    """One of our engines with a scene, and the seconds of its set-up."""

    def __init__(self, scene: Scene, settings: PathSetSettings) -> None:
        self._gl = get_context().gl
        made: list[PathSetEngine] = []
        self.setup_s = seconds_of(lambda: made.append(self._engine(scene, settings)), self._gl.finish)
        (self._engine_of_scene,) = made
        self._index = 0
        self.first_s = self.seconds()  # compiles the remaining kernels and shaders

    def _engine(self, scene: Scene, settings: PathSetSettings) -> PathSetEngine:
        context = get_context()
        return path_engine(
            context.gl,
            DeviceScene(context.gl, scene),
            settings,
            (0, 0, *scene.camera.resolution),
        ).prepare()

    def seconds(self) -> float:
        """Return the seconds of one path set."""
        taken = seconds_of(lambda: self._engine_of_scene.trace_path_set(self._index), self._gl.finish)
        self._index += 1
        return taken

    def mean(self) -> float:
        """Return the mean of the picture, after tracing the remaining path sets if they are fast."""
        while self._index < _SETS and self.first_s < 1:
            self.seconds()
        return float(self._engine_of_scene.take().mean()) / self._index

    def seen(self) -> int:
        """Return the number of triangles that the eye sees."""
        numbers = self._engine_of_scene.seen()
        return len(np.unique(numbers[numbers >= 0]))

    def release(self) -> None:
        self._engine_of_scene.close()


class _Mitsuba:
    """Mitsuba with a scene, and the seconds of its loading."""

    def __init__(self, scene: Scene) -> None:
        made: list[Any] = []
        self.setup_s = seconds_of(lambda: made.append(mitsuba_peer.to_mitsuba(scene, DEPTH, spp=_SAMPLES)))
        (self._scene,) = made
        self._spp = mitsuba_peer.samples_rendered(self._scene, _SAMPLES)
        self._image: Float64 = mitsuba_peer.render_peer(self._scene, self._spp, 1)

    def seconds(self) -> float:
        """Return the seconds of one sample of all pixels."""
        timing = mitsuba_peer.time_to_render(self._scene, self._spp, DEPTH, repeats=1, warm=True)
        return float(timing.seconds[0]) / timing.spp

    def mean(self) -> float:
        return float(self._image.mean())


def _row(scene: Scene, with_scans: bool, with_mitsuba: bool) -> dict[str, Any]:
    """Return triangles, each program's seconds for a set and for set-up, and the means of the pictures."""
    path = _Ours(scene, PathSettings(max_depth=DEPTH))
    programs: dict[str, _Ours | _Mitsuba] = {"path": path}
    if with_scans:
        programs["scans"] = _Ours(scene, PathBufferSettings(max_depth=DEPTH))
    if with_mitsuba:
        programs["mitsuba"] = _Mitsuba(scene)
    seconds = in_turns(
        {name: program.seconds for name, program in programs.items()}, rounds=9, min_rounds=1, enough_s=15.0
    )
    row: dict[str, Any] = {"triangles": len(scene.triangles), "seen_by_eye": path.seen()}
    row |= {f"{name}_s": seconds.get(name) for name in PROGRAMS}
    row |= {f"{name}_setup_s": programs[name].setup_s if name in programs else None for name in PROGRAMS}
    row |= {f"{name}_mean": programs[name].mean() if name in programs else None for name in PROGRAMS}
    for program in programs.values():
        if isinstance(program, _Ours):
            program.release()
    return row


def exponent(rows: Rows, name: str, least: float = _MANY) -> float:
    """Fit p of time ~ N^p in logarithms, to scenes of at least `least` triangles; NaN for fewer than two scenes."""
    points = [(row["triangles"], row[name]) for row in rows if row[name] is not None and row["triangles"] >= least]
    if len(points) < 2:
        return math.nan
    n, y = np.log(points).T
    return float(np.polyfit(n, y, 1)[0])


def crossing(rows: Rows, a: str = "path_s", b: str = "scans_s") -> float:
    """Return the triangles from which on `a` is faster in all scenes that both rendered; infinity if none."""
    both = [row for row in rows if row[a] is not None and row[b] is not None]
    faster = math.inf
    for row in reversed(both):
        if row[a] >= row[b]:
            break
        faster = row["triangles"]
    return float(faster)


def figure_scale(scale: float, say: Say) -> Outcome:
    """Measure the time of a path set for growing numbers of triangles."""
    notes: list[str] = []
    try:
        mitsuba_peer.load_mitsuba()
        peer = True
    except GlpathError as error:
        notes.append(f"without Mitsuba: {error}")
        peer = False
    rows: Rows = []
    scans = True
    for make in scenes(scale):
        scene = make()
        say(f"scale: {len(scene.triangles):,} triangles")
        rows.append(_row(scene, scans, peer))
        if scans and rows[-1]["scans_s"] > _TOO_LONG:
            scans = False
            took = rows[-1]["scans_s"]
            notes.append(f"no scans above {len(scene.triangles):,} triangles, where a set took {took:.0f} s")
    first, last = rows[0], rows[-1]
    path = [row["path_s"] for row in rows]
    off = {
        name: max(
            abs(row[f"{name}_mean"] / row["path_mean"] - 1) for row in rows if row[f"{name}_mean"] is not None
        )
        for name in PROGRAMS
        if first[f"{name}_mean"] is not None
    }
    measured = {
        "most_triangles": float(last["triangles"]),
        "path_exponent": exponent(rows, "path_s"),
        "scans_exponent": exponent(rows, "scans_s"),
        "path_setup_exponent": exponent(rows, "path_setup_s"),
        "path_growth": path[-1] / path[0],
        "path_faster_from": crossing(rows),
        "scans_mean_off": off["scans"],
        "last_seen_by_eye": float(last["seen_by_eye"]),
        "last_path_setup_s": last["path_setup_s"],
    }
    rule: tuple[Condition, ...] = (
        # A BVH's depth is a logarithm: over a factor of 1000 in triangles, the best power is below a quarter.
        Condition("path_exponent", "<=", 0.25),
        Condition("scans_exponent", ">=", 0.5),
        Condition("path_faster_from", "<=", "most_triangles"),
        # The paths of a scan set share their directions, so few sets leave much noise, and large scenes get few.
        Condition("scans_mean_off", "<=", 0.1),
    )
    if peer:
        measured |= {
            "mitsuba_mean_off": off["mitsuba"],
            "mitsuba_exponent": exponent(rows, "mitsuba_s"),
            "last_vs_mitsuba": last["mitsuba_s"] / last["path_s"],
            "first_vs_mitsuba": first["mitsuba_s"] / first["path_s"],
            "last_mitsuba_setup_s": last["mitsuba_setup_s"],
        }
        rule += (Condition("mitsuba_mean_off", "<=", 0.02),)
    said = "a path set of path takes a small power of the number of triangles, one of path-buffer a large one"
    laws = ", ".join(
        f"{text} N^{measured[f'{name}_exponent']:.2f}"
        for name, text in PROGRAMS.items()
        if f"{name}_exponent" in measured
    )
    here = (
        f"from {_MANY} triangles on {laws}; path is ahead of path-buffer from {crossing(rows):,.0f} triangles on. "
        f"Before the first set of {last['triangles']:,} come {last['path_setup_s']:.1f} s for scene and BVH"
    )
    if peer:
        here += f" (Mitsuba: {last['mitsuba_setup_s']:.1f} s)"
    side = scenes(scale)[0]().camera.resolution[0]
    picture = plot(
        f"Time and number of triangles: depth {DEPTH}, {side} x {side}",
        f"Claim: {said}.\nHere: {here}.",
        [
            (_TRIANGLES, Axis("time of a path set, or of a sample / s", log=True), _series(rows, "s", fits=True)),
            (_TRIANGLES, Axis("time before the first / s", log=True), _series(rows, "setup_s", fits=False)),
        ],
    )
    return judged("scale", said, rule, measured, rows, picture, notes, with_gl=True)


_TRIANGLES = Axis("number of triangles", log=True)


def _series(rows: Rows, what: str, fits: bool) -> list[Series]:
    series, guides = [], []
    for name, text in PROGRAMS.items():
        points = [(row["triangles"], row[f"{name}_{what}"]) for row in rows if row[f"{name}_{what}"] is not None]
        if not points:
            continue
        n, y = np.array(points, float).T
        series.append(Series(text, n, y))
        p = exponent(rows, f"{name}_{what}")
        if fits and not math.isnan(p):
            late = n >= _MANY
            through = np.exp(np.mean(np.log(y[late]) - p * np.log(n[late])))
            guides.append(Series(f"N^{p:.2f}", n[late], through * n[late] ** p, "guide"))
    return series + guides


FIGURES = {"scale": (figure_scale, "time of a path set against the number of triangles, 36 to 5 million")}
