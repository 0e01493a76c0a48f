"""A room as a model: `parlour` by path tracing, by the gather, and by Mitsuba 3, all in the same time.

No figure of a paper. The scene is written as .glb and read again, like a user's model; Mitsuba gets what `glpath
export` makes of that. Each program takes as many samples as fit into the time of the gather with its radiosity
solution; compilation is not counted. Time is processor time, which other programs on the machine hardly change. Our
errors are against a long run of path tracing, Mitsuba's against a long run of its own. The difference between the
references is reported, too.

Coats over a diffuse base are removed, and panes do not reflect, because Mitsuba's models of them differ from
glTF's. For example, the base of its principled BSDF loses none of the light that the coat reflects, which made
Mitsuba's picture lighter, the ceiling by 15 %. The rest stays: textures, normal maps, metal, glass, a mirror,
window light.

Fireflies, paths that happen to hit a lamp after glass or metal, would be most of the error of every program, so the
errors are also reported without the worst thousandth of the pixels.
"""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figures.models import difference
from benchmarks.figures.outcome import Outcome, Rows, Say, judged
from benchmarks.figures.style import pictures
from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.verdict import Condition
from glpath.compare import relative_mse
from glpath.errors import SceneWarning
from glpath.film.tonemap import auto_exposure, tonemap
from glpath.io import load_scene
from glpath.io.export import export
from glpath.rendering import render
from glpath.scene import Scene
from glpath.scene.material import Material
from glpath.scene.model import Float64
from glpath.system.machine import core_count

DEPTH = 12
_WIDTH, _GATHER_SETS, _REFERENCE = 240, 64, 512
_WORST = 1e-3
_EPSILON = 1e-2
_BATCH = 256  # of Mitsuba's samples at a time


def model_room(scale: float, say: Say) -> Outcome:
    """Make the figure. Scale S multiplies the pictures' width by sqrt(S), and the samples by S."""
    width = max(32, round(_WIDTH * math.sqrt(scale) / 8) * 8)
    sets, many = max(4, round(_GATHER_SETS * scale)), max(32, round(_REFERENCE * scale))
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        scene = comparable(_as_model(Path(folder), width))
        mi = mitsuba_peer.load_mitsuba()
        export(scene, Path(folder, "room.xml"), max_depth=DEPTH)
        peer = mi.load_file(str(Path(folder, "room.xml")))
    say(f"references: {many} samples each")
    reference = _ours(scene, many, first=100_000)
    theirs = _mitsubas(peer, many, 1000)
    say(f"gather: {sets} path sets")
    _gather(scene, 1)
    # Render a new copy of the scene, because its cached texture means are part of the time of the solution.
    gathered, budget = _timed(lambda: _gather(replace(scene), sets))
    path, path_sets, path_s = _within(budget, lambda count: _ours(scene, count))
    say(f"path tracing: {path_sets} path sets in {path_s:.1f} s of {budget:.1f} s")
    mitsuba, samples, mitsuba_s = _within(budget, lambda count: _mitsubas(peer, count, 1))
    say(f"Mitsuba: {samples} samples in {mitsuba_s:.1f} s")
    rows: Rows = [
        _row("gather", gathered, reference, sets, budget),
        _row("path tracing", path, reference, path_sets, path_s),
        _row("Mitsuba 3", mitsuba, theirs, samples, mitsuba_s),
    ]
    apart, ratio = difference(reference, theirs)
    measured = {"references_apart": apart, "references_mean": ratio, "cores": float(core_count())}
    for name, row in zip(("gather", "path", "mitsuba"), rows, strict=True):
        keys = ("relmse", "relmse_without_worst", "mean", "processor_seconds")
        measured |= {f"{key}_{name}": row[key] for key in keys}
    rule = (
        Condition("references_apart", "<=", 0.1),
        Condition("relmse_without_worst_gather", "<=", "relmse_without_worst_mitsuba"),
    )
    claim = (
        "in the same time the gather's picture of a textured room has less error than Mitsuba's, and means the same"
    )
    exposure = auto_exposure(reference)
    shown = [
        (f"{row['program']}, {row['samples']} samples", image)
        for row, image in zip(rows, (gathered, path, mitsuba), strict=True)
    ]
    shown += [(f"glpath, {many} samples", reference), (f"Mitsuba 3, {many} samples", theirs)]
    caption = (
        f"{budget / core_count():.1f} s on {core_count()} cores each, relMSE (without the worst thousandth of the "
        "pixels) "
        + ", ".join(f"{row['program']} {row['relmse_without_worst']:.2g}" for row in rows)
        + f"; the references differ by {100 * apart:.1f} % in blocks of 8 x 8 pixels."
    )
    picture = pictures("A room as a model", caption, [(name, tonemap(image, exposure)) for name, image in shown], 3)
    return judged("model-room", claim, rule, measured, rows, picture, with_gl=True)


def _as_model(folder: Path, width: int) -> Scene:
    # In photometric units the export keeps the numbers. The error measure depends on them: it has a threshold.
    export(replace(load_scene("parlour"), unit="photometric"), folder / "parlour.glb")
    return load_scene(folder / "parlour.glb").with_camera(resolution=(width, 3 * width // 4))


def comparable(scene: Scene) -> Scene:
    """Reduce the materials to those that glTF and Mitsuba define equally."""

    def alike(material: Material) -> Material:
        material = replace(material, multiple_scattering=False)
        solid_glass = material.transmission == 1 and not material.thin
        if material.roughness is None or material.metallic == 1 or solid_glass:
            return material
        return replace(material, specular_weight=0.0, clearcoat=0.0)

    return replace(scene, materials=tuple(map(alike, scene.materials)))


def _ours(scene: Scene, count: int, first: int = 0) -> Float64:
    # Mitsuba's roulette starts at the fifth segment, too; here it halves the error of the same time.
    return render(scene, spp=count, first_path_set=first, max_depth=DEPTH, roulette=4).mean


def _gather(scene: Scene, count: int) -> Float64:
    return render(scene, integrator="gather", spp=count).mean


def _mitsubas(peer: Any, count: int, seed: int) -> Float64:
    batches = [min(_BATCH, count - start) for start in range(0, count, _BATCH)]
    images = [mitsuba_peer.render_peer(peer, batch, seed + i) for i, batch in enumerate(batches)]
    return np.asarray(np.average(images, axis=0, weights=batches))


def _timed(make: Callable[[], Float64]) -> tuple[Float64, float]:
    """Return a picture and the processor seconds that it took."""
    start = time.process_time()
    image = make()
    return image, time.process_time() - start


def _within(budget: float, make: Callable[[int], Float64]) -> tuple[Float64, int, float]:
    """Return a picture of as many samples as fit into the seconds, their number, and the seconds that they took."""
    make(8)
    _, taken = _timed(lambda: make(8))
    count = max(8, int(8 * budget / taken))
    make(count)  # Mitsuba compiles for each number of samples
    image, seconds = _timed(lambda: make(count))
    return image, count, seconds


def _row(program: str, image: Float64, reference: Float64, samples: int, seconds: float) -> dict[str, Any]:
    error = ((image - reference) ** 2 / (reference**2 + _EPSILON)).mean(axis=2).ravel()
    kept = np.sort(error)[: len(error) - max(1, round(_WORST * len(error)))]
    return {
        "program": program,
        "samples": samples,
        "processor_seconds": seconds,
        "relmse": relative_mse(image, reference, _EPSILON),
        "relmse_without_worst": float(kept.mean()),
        "mean": float(image.mean()) / float(reference.mean()),
    }


FIGURES = {"model-room": (model_room, "a textured room as a model, beside Mitsuba in the same time")}
