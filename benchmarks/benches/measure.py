"""Irradiance at points: compared with a closed form under a lamp, and with Radiance's `rtrace` in an office.

Points of the office form a grid above its desks. The reference is a long run of our own paths, whose standard error
is reported. `rtrace` runs with and without its ambient cache, with increasing numbers of rays. Path tracing and the
gather, including its solver, run with increasing numbers of paths, on the same cores in the same run. The error is
the root mean square of the illuminances' differences divided by their mean. For each of Radiance's runs, our time
to the same error is interpolated on the line through log(error) over log(time). Compilation is not counted.
`measured`:

    lamp_off            : largest relative error under a lamp, against the closed form
    reference_error     : relative standard error of the reference
    radiance_off        : relative difference of the mean of Radiance's most accurate run from the reference
    radiance_error      : the error of that run
    vs_radiance         : Radiance's time divided by ours at equal error, for the run that is best for Radiance

Source: Larson & Shakespeare 1998, Rendering with Radiance; Lambert's polygon formula for the lamp.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.peers import radiance as radiance_peer
from benchmarks.peers.mitsuba import comparable
from benchmarks.verdict import Condition, Report, faults, judge, machine
from glpath.errors import GlpathError
from glpath.gl.context import get_context
from glpath.io import load_scene
from glpath.rendering.points import Irradiance, irradiance
from glpath.scene.model import Float64, Scene, Shapes
from glpath.system.colour import luminance
from glpath.system.versions import versions

Row = dict[str, Any]
Say = Callable[[str], None]

CLAIM = "irradiance within 1 % of a closed form and 2 % of Radiance's rtrace, and sooner at equal error"
AGREEMENT = (Condition("lamp_off", "<=", 0.01), Condition("radiance_off", "<=", 0.02))
RULE = (*AGREEMENT, Condition("vs_radiance", ">=", 1.0))

#: Options of `rtrace` for direct light: lamps in parts, jittered, all tested for shadows.
_DIRECT = "-ds .05 -dj .9 -dt 0 -dc 1"
#: Options without interpolation: each point has its own rays, which end by chance below a weight, without bias.
_ALONE = "-ab 12 -aa 0 -ad {0} -as 0 -lr -12 -lw {1}"
#: Options with values that are cached all over the scene and interpolated.
_CACHED = "-ab 5 -aa .2 -ar 64 -ad {0} -as {2} -lr 8 -lw .002"
_RUNS = (
    ("rtrace", _ALONE, 64),
    ("rtrace", _ALONE, 256),
    ("rtrace", _ALONE, 1024),
    ("rtrace, cached", _CACHED, 256),
)
_PATHS = (64, 256, 1024)
_TRUTH = 8192
#: Number of points along the office, and their height above its floor.
_COLUMNS, _HEIGHT = 16, 0.85

#: Corners of a lamp that emits down to the points below it.
_LAMP = np.array([[-0.6, 2, -0.4], [0.6, 2, -0.4], [0.6, 2, 0.4], [-0.6, 2, 0.4]])


def lamp_off(paths: int = 1024) -> float:
    """Return the largest relative error of the irradiance under a lamp."""
    scene = load_scene(
        {
            "camera": {"position": [0, 1, 4], "target": [0, 1, 0]},
            "materials": {"black": {"reflectance": 0}},
            "shapes": [
                {"type": "quad", "corners": _LAMP.tolist(), "material": "black", "emission": {"radiance": 10}}
            ],
        }
    )
    x, z = np.meshgrid(np.linspace(-2, 2, 16), np.linspace(-2, 2, 16))
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    found = irradiance(scene, points, [0.0, 1.0, 0.0], spp=paths, max_depth=2)
    expected = 10.0 * _form_factor(points)
    return float(np.max(np.abs(found.values[:, 0] / expected - 1)))


def _form_factor(points: Float64) -> Float64:
    """Return pi times the lamp's view factor from points that face up, by the angles that its edges subtend."""
    to = _LAMP - points[:, None]
    to /= np.linalg.norm(to, axis=-1, keepdims=True)
    following = np.roll(to, -1, axis=1)
    across = np.cross(to, following)
    angle = np.arccos(np.clip(np.sum(to * following, axis=-1), -1, 1))
    return np.asarray(np.abs(0.5 * np.sum(angle * across[..., 1] / np.linalg.norm(across, axis=-1), axis=-1)))


def office_grid(columns: int) -> tuple[Scene, Float64, Float64]:
    """Return the office, and points above its desks with their normals, (N, 3) each.

    Its lamps reflect nothing, as in Radiance.
    """
    scene, _ = comparable(load_scene("office"))
    dark = replace(scene.materials[0], name="lamp that reflects nothing", reflectance=np.zeros(3))
    shapes = [replace(each, material=len(scene.materials)) if each.emits else each for each in scene.shapes]
    scene = replace(scene, materials=(*scene.materials, dark), shapes=Shapes(shapes))
    lower, upper = scene.bounds
    step = (upper[0] - lower[0]) / columns
    rows = max(1, int((upper[2] - lower[2]) / step))
    x, z = np.meshgrid(
        lower[0] + step * (np.arange(columns) + 0.5),
        lower[2] + (upper[2] - lower[2]) * (np.arange(rows) + 0.5) / rows,
    )
    points = np.stack([x.ravel(), np.full(x.size, _HEIGHT), z.ravel()], axis=1)
    return scene, points, np.broadcast_to([0.0, 1.0, 0.0], points.shape)


def _error(found: Float64, truth: Float64) -> float:
    """Return the relative error of the luminance, which includes the error of the reference."""
    off = luminance(found) - luminance(truth)
    return float(np.sqrt(np.mean(off**2)) / luminance(truth).mean())


def _seconds_at(rows: list[Row], error: float) -> float:
    """Return our shortest time to an error, on straight lines through the logarithms of successive runs."""
    found = []
    for program in dict.fromkeys(row["program"] for row in rows):
        runs = sorted((row for row in rows if row["program"] == program), key=lambda row: row["seconds"])
        x, y = (np.log([row[name] for row in runs]) for name in ("error", "seconds"))
        # Beyond the runs, the error is extrapolated as in Monte Carlo, with the inverse square root of the time.
        if np.log(error) >= x[0]:
            found.append(float(runs[0]["seconds"]))
        elif np.log(error) <= x[-1]:
            found.append(float(np.exp(y[-1] + 2.0 * (x[-1] - np.log(error)))))
        else:
            found.append(float(np.exp(np.interp(np.log(error), x[::-1], y[::-1]))))
    return min(found)


def bench_measure(scale: float = 1.0, say: Say = lambda text: None) -> Report:
    """Measure; takes some minutes on two cores.

    scale : below 1, fewer points, rays and paths
    say   : function that gets messages about the progress
    """
    context = get_context()
    notes: list[str] = [] if scale >= 1 else [f"at scale {scale:g}"]
    say("a lamp")
    numbers = {"lamp_off": lamp_off()}
    scene, points, normals = office_grid(max(4, round(_COLUMNS * scale)))

    def ours(integrator: str, paths: int, seed: int) -> tuple[float, Irradiance]:
        start = time.perf_counter()
        found = irradiance(scene, points, normals, integrator=integrator, spp=paths, seed=seed)  # type: ignore[arg-type]
        return time.perf_counter() - start, found

    for integrator in ("path", "gather"):
        ours(integrator, 1, 0)  # compiles
    say(f"the truth, of {len(points)} points")
    _, long = ours("path", max(64, round(_TRUTH * scale)), 1)
    truth = long.values
    own = np.sqrt(np.mean(long.illuminance_errors() ** 2))
    numbers["reference_error"] = float(own / long.illuminance().mean())
    rows: list[Row] = []
    peers: list[Row] = []
    for paths in _PATHS:
        count = max(8, round(paths * scale))
        for integrator in ("path", "gather"):
            say(f"{integrator}, {count} paths")
            seconds, found = ours(integrator, count, 2)
            error = _error(found.values, truth)
            rows.append({"program": integrator, "samples": count, "seconds": seconds, "error": error})
    for name, how, divisions in _RUNS:
        rays = max(32, round(divisions * scale))
        say(f"{name}, {rays} rays")
        settings = f"{_DIRECT} {how.format(rays, 1 / rays, rays // 4)}"
        try:
            seconds, values = radiance_peer.irradiance(scene, points, normals, settings)
        except GlpathError as missing:
            notes.append(f"without {name}, {rays} rays: {missing}")
            continue
        off = float(luminance(values).mean() / luminance(truth).mean() - 1)
        error = _error(values, truth)
        peers.append({"program": name, "samples": rays, "seconds": seconds, "error": error, "mean off": off})
    if peers:
        for row in peers:
            row["ours, seconds"] = _seconds_at(rows, row["error"])
            row["times ours"] = row["seconds"] / row["ours, seconds"]
        best = min(peers, key=lambda row: row["error"])
        numbers |= {
            "radiance_off": abs(best["mean off"]),
            "radiance_error": best["error"],
            "vs_radiance": min(row["times ours"] for row in peers),
        }
    claim, holds = judge(CLAIM, RULE, numbers) if peers else (CLAIM, None)
    return Report(
        name="measure",
        claim=claim,
        measured=numbers,
        holds=holds,
        rows=[*rows, *peers],
        machine=machine(context.info.renderer),
        versions=versions("glpath", "moderngl", "numpy") | _peer_version(),
        notes=list(dict.fromkeys(notes)),
        faults=faults(AGREEMENT, numbers),
    )


def _peer_version() -> dict[str, str]:
    try:
        return {"pyradiance": radiance_peer.version()}
    except GlpathError:
        return {}
