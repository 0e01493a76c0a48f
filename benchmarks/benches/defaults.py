"""Cost of a render with default options: seconds of the whole process, and the error of the picture.

`glpath render SCENE -o a.png` runs with warm caches. Processes take turns, and the median counts. Then the scene is
rendered once more to a film, which is denoised and compared with unbiased paths from the cache folder. The error
excludes the worst thousandth of the pixels and the reference's own error.

Cycles renders the scenes that it supports with Blender's defaults (noise threshold 0.01, at most 4,096 samples, its
denoiser), but with all bounces of light and at most two minutes. Its seconds exclude its start and the building of
its tree. Larger thresholds follow, so that both can be compared at the error of glpath's picture. `parlour` is read
by Blender's importer, which gives slightly different glass and plastic. Cycles' error is there relative to a long
render of its own.

measured, for each scene:
    SCENE_s, SCENE_relmse            : seconds and error of glpath's picture
    SCENE_cycles_s, .._cycles_relmse : Cycles at the same error, interpolated between two pictures; else its best
                                       one
    SCENE_vs_cycles                  : Cycles' time divided by glpath's
    helmet_s                         : seconds for a model file as from an artist, under an environment map; no
                                       error
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

import glpath
from benchmarks.peers import cycles as cycles_peer
from benchmarks.peers.blender import render_model, view_of
from benchmarks.peers.mitsuba import comparable
from benchmarks.references.kept import reference_folder
from benchmarks.scenes.helmet import helmet
from benchmarks.timing import in_turns, seconds_of
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.errors import GlpathError
from glpath.film.exr import write_exr
from glpath.film.film import Film
from glpath.gl.context import get_context
from glpath.integrators.settings import DEEPEST
from glpath.io import load_scene
from glpath.io.export.gltf import write_gltf
from glpath.scene.model import Float64, Scene
from glpath.system.files import shipped_folder
from glpath.system.units import EFFICACY
from glpath.system.versions import versions

Say = Callable[[str], None]

#: Target seconds and error of each scene.
AIMS = {"cornell-box": (4.0, 5e-4), "room": (12.0, 1.5e-3), "parlour": (15.0, 2.5e-3)}
#: Target seconds for the model.
MODEL_AIM = 8.0
#: Size of the picture, if it is not the scene's own.
SIZES = {"room": (640, 640)}
#: Scenes that are model files in the folder of scenes.
MODELS = {"parlour": "parlour.glb"}
#: Number of path sets of the unbiased picture.
SETS = 512
# Samples of each of the two pictures that estimate the error of Cycles in a model.
_OWN_SAMPLES = 64
#: Noise thresholds of Cycles; the first is Blender's default.
THRESHOLDS = (0.01, 0.03, 0.1)
_CYCLES_SAMPLES = 4096
# Time limit of a picture by Cycles, seconds. The picture's error shows the effect of the limit.
_CYCLES_SECONDS = 120.0
_WORST = 1e-3
RULE = (
    *(Condition(f"{name}_s", "<=", seconds) for name, (seconds, _) in AIMS.items()),
    *(Condition(f"{name}_relmse", "<=", error) for name, (_, error) in AIMS.items()),
    Condition("helmet_s", "<=", MODEL_AIM),
)


def bench_defaults(rounds: int = 3, scale: float = 1.0, progress: Say = lambda text: None) -> Report:
    """Time the processes, and measure their errors.

    scale : below 1, fraction of the reference's path sets
    Raises GlpathError if a render fails. Cycles is left out if it is not installed.
    """
    measured: dict[str, float] = {}
    rows: list[dict[str, float | str | None]] = []
    notes: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        picture, film = str(Path(folder, "a.png")), Path(folder, "a.npz")
        model, sky = write_model(Path(folder))
        renders = {name: partial(_render, name, picture) for name in AIMS}
        renders["helmet"] = partial(_render, str(model), picture, "--environment", str(sky))
        for name, render in renders.items():
            progress(f"{name}, once to fill its caches")
            render()
        seconds = in_turns({name: partial(seconds_of, render) for name, render in renders.items()}, max(rounds, 1))
        measured["helmet_s"] = seconds["helmet"]
        rows.append({"scene": "helmet", "program": "glpath", "seconds": seconds["helmet"], "relmse": None})
        for name in AIMS:
            scene = load_scene(name)
            if name in SIZES:
                scene = scene.with_camera(resolution=SIZES[name])
            reference = _reference(scene, max(16, round(SETS * scale)), progress)
            _render(name, str(film), "--denoise")
            error = error_beside(Film.load(film).denoised(), reference)
            measured |= {f"{name}_s": seconds[name], f"{name}_relmse": error}
            rows.append({"scene": name, "program": "glpath", "seconds": seconds[name], "relmse": error})
            try:
                by_cycles = _model_by_cycles if name in MODELS else _by_cycles
                found = by_cycles(scene, reference, progress)
            except GlpathError as left_out:
                notes.append(f"without Cycles: {str(left_out).splitlines()[0]}")
                continue
            for each in found:
                program = f"Cycles at {each.threshold:g}"
                rows.append({"scene": name, "program": program, "seconds": each.seconds, "relmse": each.relmse})
            taken, left = seconds_to(found, error)
            measured |= {f"{name}_cycles_s": taken, f"{name}_cycles_relmse": left}
            measured[f"{name}_vs_cycles"] = taken / seconds[name]
    claim, holds = judge("pictures without options, the whole process", RULE, measured)
    return Report(
        "defaults",
        claim,
        measured,
        holds,
        rows=rows,
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "pyoidn"),
        notes=notes,
    )


def write_model(folder: Path, side: int = 2048) -> tuple[Path, Path]:
    """Write the helmet as .glb, with side x side textures, and an environment map with a bright spot."""
    model, sky = folder / "helmet.glb", folder / "sky.exr"
    write_gltf(helmet(side), model)
    rows, columns = 256, 512
    y, x = np.mgrid[0:rows, 0:columns]
    spot = 60.0 * np.exp(-((x - 140) ** 2 + (y - 70) ** 2) / 200.0)
    level = np.where(y < rows // 2, 0.3 + 0.7 * y / (rows // 2), 0.25)
    write_exr(sky, np.stack([level + spot, level + 0.9 * spot, 1.2 * level + 0.8 * spot], axis=-1))
    return model, sky


class ByCycles(NamedTuple):
    """Seconds and error of a picture by Cycles."""

    threshold: float
    seconds: float
    relmse: float


def _render(scene: str, output: str, *more: str) -> None:
    if scene in SIZES:
        more = (*more, "--resolution", "{}x{}".format(*SIZES[scene]))
    command = [sys.executable, "-m", "glpath", "render", scene, "--quiet", "-o", output, *more]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True)
    if done.returncode:
        word = (done.stderr.decode(errors="replace").strip().splitlines() or ["no word"])[-1]
        raise GlpathError(f"bench defaults: glpath render {scene} failed: {word}", "See `glpath doctor`.")


def _reference(scene: Scene, sets: int, say: Say) -> Film:
    """Return unbiased paths. A cached film with fewer path sets is resumed. No default uses this seed."""
    width, height = scene.camera.resolution
    path = reference_folder() / f"{scene.name}-{width}x{height}-paths-{scene.digest()[:16]}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = Film.load(path) if path.exists() else None
    if kept is None or kept.path_sets < sets:
        say(f"{scene.name}: the unbiased picture of {sets} path sets, kept in {path}")
        kept = glpath.render(scene, integrator="path", spp=sets, seed=1_000_000, film=kept)
        kept.save(path)
    return kept


class Converged(Protocol):
    """Picture with an estimate of its own error."""

    @property
    def mean(self) -> Float64: ...

    def variance_of_mean(self) -> Float64: ...


def error_beside(picture: ArrayLike, reference: Converged) -> float:
    """Return the relMSE without the worst thousandth of the pixels, minus the reference's own error."""
    expected = reference.mean
    own = reference.variance_of_mean()
    weight = expected**2 + 1e-2
    errors = ((np.asarray(picture, float) - expected) ** 2 / weight).mean(axis=2).ravel()
    keep = np.argsort(errors)[: round((1.0 - _WORST) * len(errors))]
    return float(errors[keep].mean() - (own / weight).mean(axis=2).ravel()[keep].mean())


def seconds_to(found: Sequence[ByCycles], error: float) -> tuple[float, float]:
    """Return the seconds to an error, and the error that they are for.

    The seconds are interpolated in logarithms between the quickest picture that is good enough and the best of the
    quicker ones. They are those of the quickest picture if no quicker one exists, and those of the best if none is
    good enough.
    """
    good = [each for each in found if each.relmse <= error]
    others = [each for each in found if each.relmse > error]
    if not good:
        best = min(others, key=lambda each: each.relmse)
        return best.seconds, best.relmse
    quickest = min(good, key=lambda each: each.seconds)
    others = [each for each in others if each.seconds < quickest.seconds]
    if not others:
        return quickest.seconds, quickest.relmse
    near = min(others, key=lambda each: each.relmse)
    share = np.log(near.relmse / error) / np.log(near.relmse / quickest.relmse)
    return float(near.seconds * (quickest.seconds / near.seconds) ** share), error


def _by_cycles(scene: Scene, reference: Film, say: Say) -> list[ByCycles]:
    flat, _ = comparable(scene)
    found = []
    with cycles_peer.cycles(flat, DEEPEST) as program:
        for threshold in THRESHOLDS:
            say(f"{scene.name}: Cycles {program.version}, noise threshold {threshold:g}")
            program.settings = {
                "use_adaptive_sampling": True,
                "adaptive_threshold": threshold,
                "use_denoising": True,
                "time_limit": _CYCLES_SECONDS,
            }
            seconds, picture = program.render(_CYCLES_SAMPLES, 1)
            found.append(ByCycles(threshold, seconds, error_beside(picture, reference)))
    return found


class _OwnReference(NamedTuple):
    """Reference from two pictures with different seeds, see `Converged`."""

    mean: Float64
    squared_error: Float64

    def variance_of_mean(self) -> Float64:
        return self.squared_error


def _model_by_cycles(scene: Scene, reference: Film, say: Say) -> list[ByCycles]:
    """Compare Cycles with a long render of its own, in watts, because the file is in candela."""
    folder = shipped_folder("scenes")
    assert folder is not None, "the scene itself was read from it"
    file = folder / MODELS[scene.name]
    width, height = scene.camera.resolution
    asked = {"side": width, "height": height, "max_depth": DEEPEST, **view_of(scene)}
    asked["exposure"] = 1.0 / EFFICACY  # Cycles' thresholds refer to the brightness of the displayed picture
    say(f"{scene.name}: Cycles' own long render")
    one, other = (render_model(file, {**asked, "spp": _OWN_SAMPLES, "seed": seed}).image for seed in (1_000, 1_001))
    own = _OwnReference(0.5 * (one + other), (0.5 * (one - other)) ** 2)
    say(f"{scene.name}: Cycles' picture is {own.mean.mean() / reference.mean.mean():.3f} times as bright as ours")
    found = []
    for threshold in THRESHOLDS:
        say(f"{scene.name}: Cycles, noise threshold {threshold:g}")
        settings = {"spp": _CYCLES_SAMPLES, "threshold": threshold, "denoise": True, "seed": 1}
        theirs = render_model(file, asked | settings | {"time_limit": _CYCLES_SECONDS})
        found.append(ByCycles(threshold, theirs.render_seconds, error_beside(theirs.image, own)))
    return found
