"""Render a folder of scenes in Mitsuba's format by glpath and by Mitsuba, and compare pictures and seconds.

No such scene ships with glpath. Bitterli's collection (https://benedikt-bitterli.me/resources) and the scenes of
Mitsuba's tutorials are suitable folders. A scene is an .xml in the folder, or a scene*.xml in a subfolder.

Mitsuba reads its own file. Only the camera's film, its pixel filter and the integrator are changed, so that both
programs have the same pixels, a box filter, and the same path length. Noise is the variance over pictures of
several seeds, as relMSE = mean of (variance / (mean^2 + 0.01)). Seconds to the target are those until the first
path set, plus those of the path sets that are needed.

measured:
    scenes, refused : number of compared scenes, and of scenes that glpath refuses because of unsupported features
    worst_mean_off  : largest difference between the means of two pictures, among scenes that are read without a
                      warning
    worst_warned_off : the same for the other scenes, whose warnings name the differences from Mitsuba
    worst_apart     : largest relMSE of one program's mean picture against the other's, without their noise
    faster          : number of scenes for which glpath needs fewer seconds
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.benches.equal_error import TARGET
from benchmarks.benches.own_noise import Program, bias_of
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.errors import GlpathError, SceneWarning
from glpath.gl.context import get_context
from glpath.io import load_scene
from glpath.rendering.calls import render
from glpath.scene.model import Float64, Scene
from glpath.system.versions import versions

RULE = (Condition("scenes", ">=", 5), Condition("worst_mean_off", "<=", 0.02))

_SIDE = 128
_DEPTH = 16
_SETS, _SAMPLES = 64, 128


def bench_standard_scenes(
    folder: Path,
    seeds: int = 3,
    scale: float = 1.0,
    progress: Callable[[str], None] = lambda text: None,
) -> Report:
    """Compare the scenes of a folder.

    folder : folder of the scenes
    seeds  : pictures of each program, two at least
    scale  : below 1, fewer samples

    Raises GlpathError if Mitsuba is missing, and for a folder without scenes.
    """
    mitsuba = mitsuba_peer.load_mitsuba()
    paths = sorted({*folder.glob("*.xml"), *folder.glob("*/scene*.xml")})
    if not paths:
        raise GlpathError(
            f"bench standard-scenes: {folder} has no scenes.",
            "A scene is an .xml in it, or a scene*.xml in a folder below it.",
        )
    rows: list[dict[str, Any]] = []
    notes: list[str] = []
    for path in paths:
        name = str(path.relative_to(folder))
        progress(name)
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", SceneWarning)
                scene = load_scene(path)
        except GlpathError as error:
            notes.append(f"refused: {str(error).splitlines()[0].replace(str(folder), '.')}")
            continue
        notes += [f"{name}: {str(each.message).partition(': ')[2]}" for each in caught]
        row = {"scene": name, "warned": "yes" if caught else "no"}
        rows.append(row | _compared(mitsuba, path, scene, max(seeds, 2), scale))
    measured: dict[str, float] = {"scenes": len(rows), "refused": len(paths) - len(rows)}
    if rows:
        measured |= {
            "worst_mean_off": max((row["mean_off"] for row in rows if row["warned"] == "no"), default=np.nan),
            "worst_warned_off": max((row["mean_off"] for row in rows if row["warned"] == "yes"), default=np.nan),
            "worst_apart": max(row["apart"] for row in rows),
            "faster": sum(row["glpath_s"] < row["mitsuba_s"] for row in rows),
        }
    else:
        measured["worst_mean_off"] = float("nan")
    claim, holds = judge(
        "scenes of Mitsuba's format that are read without a warning have its picture", RULE, measured
    )
    return Report(
        "standard-scenes",
        claim,
        measured,
        holds,
        rows=rows,
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "mitsuba"),
        notes=notes,
    )


def _compared(mitsuba: Any, path: Path, scene: Scene, seeds: int, scale: float) -> dict[str, Any]:
    """Return the row of one scene."""
    width, height = scene.camera.resolution
    shrink = min(1.0, _SIDE / max(width, height))
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    seen = scene.with_camera(resolution=size)
    theirs = mitsuba.load_file(str(path))
    sensor = _sensor(mitsuba, theirs, size)
    integrator = mitsuba.load_dict({"type": "path", "max_depth": _DEPTH + 1, "rr_depth": 5})
    first_s = {"glpath": float("inf"), "mitsuba": float("inf")}

    def ours(sets: int, seed: int) -> tuple[float, Float64]:
        once = _seconds(lambda: _rendered(seen, 1, seed))
        start = time.perf_counter()
        picture = _rendered(seen, 1 + sets, seed)
        total = time.perf_counter() - start
        first_s["glpath"] = min(first_s["glpath"], once)
        return 1e3 * max(total - once, 1e-6) / sets, picture

    def mitsubas(samples: int, seed: int) -> tuple[float, Float64]:
        def draw(spp: int) -> Float64:
            image = mitsuba.render(theirs, sensor=sensor, integrator=integrator, spp=spp, seed=seed)
            return np.array(image, np.float64)[..., :3]

        draw(samples)  # compiles
        start = time.perf_counter()
        picture = draw(samples)
        total = time.perf_counter() - start
        first_s["mitsuba"] = 0.0
        return 1e3 * total / samples, picture

    sets, samples = max(2, round(scale * _SETS)), max(2, round(scale * _SAMPLES))
    programs = {"glpath": Program(sets, ours), "mitsuba": Program(samples, mitsubas)}
    for seed in range(seeds):
        for program in programs.values():
            program.run(seed)
    row: dict[str, Any] = {}
    for name, program in programs.items():
        needed = program.samples * program.relmse / TARGET
        row[f"{name}_samples_to_target"] = needed
        row[f"{name}_s"] = first_s[name] + 1e-3 * needed * program.ms_per_sample
    means = {name: program.mean for name, program in programs.items()}
    row["vs_mitsuba"] = row["mitsuba_s"] / row["glpath_s"]
    row["mean_off"] = abs(float(means["glpath"].mean() / means["mitsuba"].mean()) - 1)
    row["apart"] = bias_of(programs["glpath"], programs["mitsuba"])
    return row


def _rendered(scene: Scene, sets: int, seed: int) -> Float64:
    film = render(scene, integrator="path", spp=sets, seed=seed, max_depth=_DEPTH)
    return np.asarray(film.mean, np.float64)


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _sensor(mitsuba: Any, scene: Any, size: tuple[int, int]) -> Any:
    """Return the camera of Mitsuba's scene with a film of `size` pixels and a box filter."""
    first = scene.sensors()[0]
    parameters = mitsuba.traverse(first)
    near, far = float(parameters["near_clip"]), float(parameters["far_clip"])
    plugin: dict[str, Any] = {
        "type": "perspective",
        "to_world": first.world_transform().matrix,
        "near_clip": near,
        "far_clip": far,
        "fov": float(np.array(parameters["x_fov"]).ravel()[0]),
        "fov_axis": "x",
        "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}},
        "sampler": {"type": "independent"},
    }
    if "aperture_radius" in parameters:
        plugin |= {
            "type": "thinlens",
            "aperture_radius": float(parameters["aperture_radius"]),
            "focus_distance": float(parameters["focus_distance"]),
        }
    plugin["to_world"] = mitsuba.ScalarTransform4f(np.array(plugin["to_world"], np.float64).reshape(4, 4))
    return mitsuba.load_dict(plugin)
