"""Read and render Mitsuba's own files by glpath and by Mitsuba: which files load, and how closely pictures agree.

The files are from public repositories (mitsuba-data, mitsuba-tutorials, sionna-rt) and are not shipped. Pictures
have 64 pixels on the longer side and are rendered eight times with different seeds, whose spread is the noise. Two
numbers are computed for each pair: the ratio of the means of the channel that differs most, and the largest
relative difference of a block of 16 x 16 pixels, minus two standard errors. A block darker than a tenth of the
picture is compared with that tenth. Undecided files are rendered again with more samples. `VERDICTS` are the
outcomes. Each file has its own random numbers, so that the noise of different files is not correlated.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.mitsuba import best_variant
from benchmarks.verdict import Condition, Report, judge, machine
from glpath.errors import GlpathError, SceneWarning
from glpath.gl.context import get_context
from glpath.io import load_scene, scene_parameters
from glpath.io.completed import aside
from glpath.io.mitsuba.document import read_document
from glpath.rendering.calls import render
from glpath.scene.model import Float64, Scene
from glpath.system.versions import versions

RULE = (Condition("loaded", ">=", 100), Condition("same", ">=", 85), Condition("differs", "<=", 0))
MAX_MEAN_DIFFERENCE = 0.01
MAX_BLOCK_DIFFERENCE = 0.05
_BLOCK = 16
#: Meaning of each verdict.
VERDICTS = {
    "same": f"no warning; the mean is within {100 * MAX_MEAN_DIFFERENCE:g} %, and each block of {_BLOCK} x "
    f"{_BLOCK} pixels within {100 * MAX_BLOCK_DIFFERENCE:g} %, beyond noise below these limits",
    "warned": "a warning names the cause of any difference",
    "differs": "no warning, and a larger difference",
    "unclear": "no warning and no such difference, but noise above the limits could hide one",
    "not compared": "no warning; not rendered yet, or not by Mitsuba, or not in time",
    "refused": "an error names the line and the element",
}
#: Values of parameters for which a file has no <default>.
PARAMETERS = {"spp": "16", "res": "64", "integrator": "path", "max_depth": "16"}

#: Samples per pixel; larger numbers are used only for files that smaller ones leave undecided.
SAMPLES = (128, 512, 2048)

_SIDE = 64
_DEPTH = 16
_BATCHES = 8
_SIGMAS = 2.0
_DARK = 0.1
_MITSUBA_SECONDS = 120.0


def files_of(folder: Path) -> list[Path]:
    """Return all .xml files below a folder, except those in hidden folders."""
    found = sorted(folder.rglob("*.xml"))
    return [path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts)]


def load(folder: Path, path: Path) -> dict[str, Any]:
    """Return the row of a file before it is rendered: whether it loads, its warnings and its plugins."""
    row: dict[str, Any] = {"file": path.relative_to(folder).as_posix(), "loads": False, "warnings": []}
    try:
        parameters = _parameters(path)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", SceneWarning)
            load_scene(path, parameters)
    except GlpathError as error:
        row["error"] = _shortened(str(error).splitlines()[0], folder)
    else:
        row |= {"loads": True, "parameters": parameters, "plugins": plugins_of(path, parameters)}
        row["warnings"] = list(dict.fromkeys(_shortened(str(each.message), folder) for each in caught))
    return row | {"verdict": verdict(row)}


def compare(folder: Path, row: dict[str, Any], samples: int) -> dict[str, Any]:
    """Return the row with the numbers of both pictures and the verdict, or with an error.

    samples : samples per pixel
    """
    path = folder / row["file"]
    try:
        with warnings.catch_warnings(), aside("picture"):
            warnings.simplefilter("ignore", SceneWarning)
            scene = load_scene(path, row["parameters"])
            row = row | _compared(scene, path, row["parameters"], samples, first_seed(row["file"], samples))
    except (GlpathError, subprocess.SubprocessError) as error:
        row = row | {"error": _shortened(str(error).splitlines()[-1], folder)[:300]}
    return row | {"verdict": verdict(row)}


def is_waiting(row: Mapping[str, Any], samples: int) -> bool:
    """Return True if `samples` may change a row: it has no numbers yet, or fewer samples left it undecided."""
    if not row["loads"] or "error" in row:
        return False
    undecided = row["verdict"] in ("unclear", "differs") and row.get("samples", 0) < samples
    return "worst_block" not in row or undecided


def _shortened(text: str, folder: Path) -> str:
    """Return the text in one line, with paths relative to the folder."""
    return " ".join(text.replace(f"{folder}/", "").split())


def verdict(row: Mapping[str, Any]) -> str:
    """Return the verdict of a row, one of `VERDICTS`."""
    if not row["loads"]:
        return "refused"
    if row["warnings"]:
        return "warned"
    if "worst_block" not in row:
        return "not compared"
    close = row["mean_difference"] <= MAX_MEAN_DIFFERENCE and row["worst_block"] <= MAX_BLOCK_DIFFERENCE
    if not close:
        return "differs"
    clear = row["mean_noise"] <= MAX_MEAN_DIFFERENCE and row["noise"] <= MAX_BLOCK_DIFFERENCE
    return "same" if clear else "unclear"


def report(rows: Sequence[dict[str, Any]]) -> Report:
    """Return the report of all files."""
    counts = {name: float(sum(row["verdict"] == name for row in rows)) for name in VERDICTS}
    measured = {"files": float(len(rows)), "loaded": float(sum(row["loads"] for row in rows)), **counts}
    claim, holds = judge("Mitsuba's files load, and look as in Mitsuba or name the difference", RULE, measured)
    return Report(
        "mitsuba-scenes",
        claim,
        measured,
        holds,
        rows=list(rows),
        machine=machine(get_context().info.renderer),
        versions=versions("glpath", "moderngl", "numpy", "mitsuba"),
    )


#: Tags of plugins that affect a picture.
_LISTED = ("bsdf", "texture", "shape", "emitter", "sensor", "medium")


def plugins_of(path: Path, parameters: Mapping[str, str]) -> list[str]:
    """Return the sorted plugins that a file uses, such as "bsdf diffuse". Raises SceneError."""
    document = read_document(path, parameters)
    used: set[str] = set()
    examined: set[int] = set()
    waiting = [each for each in document.root.children if each.tag not in ("bsdf", "texture")]
    while waiting:
        element = document.resolved(waiting.pop())
        if id(element) in examined:
            continue
        examined.add(id(element))
        if element.tag in _LISTED:
            used.add(f"{element.tag} {element.attributes.get('type', '')}")
        waiting += element.children
    return sorted(used)


def _parameters(path: Path) -> dict[str, str]:
    """Return values for the parameters without a default in a file. Raises GlpathError."""
    missing = [name for name, (default, _) in scene_parameters(str(path)).items() if default is None]
    return {name: PARAMETERS[name] for name in missing if name in PARAMETERS}


def first_seed(file: str, samples: int) -> int:
    """Return the seed of a file's first batch, far from those of other files and of other counts of samples."""
    return zlib.crc32(f"{samples} {file}".encode()) % 2**31


def _compared(scene: Scene, path: Path, parameters: dict[str, str], samples: int, seed: int) -> dict[str, Any]:
    """Return the numbers of a row. Raises GlpathError, and SubprocessError from Mitsuba."""
    width, height = scene.camera.resolution
    shrink = min(1.0, _SIDE / max(width, height))
    seen = scene.with_camera(resolution=(max(1, round(width * shrink)), max(1, round(height * shrink))))
    variant = best_variant()[0]
    theirs = _mitsubas(seen, path, parameters, samples, seed, variant)
    return {"samples": samples, "variant": variant, **difference(_ours(seen, samples, seed), theirs)}


def difference(ours: Float64, theirs: Float64) -> dict[str, float]:
    """Return how far two sets of pictures (batches, H, W, 3) differ.

    mean_ratio      : our mean divided by Mitsuba's, of the channel that differs most
    mean_difference : relative difference of that channel beyond mean_noise, which is `_SIGMAS` standard errors
    worst_block     : the largest such difference of all blocks; its noise is that of the noisiest block
    """
    channels = [pictures.mean(axis=(1, 2)) for pictures in (ours, theirs)]
    means, errors = zip(*(_mean_and_error(each) for each in channels), strict=True)
    scale = np.maximum(means[1], _DARK * means[1].max())
    scale = np.where(scale > 0, scale, 1.0)
    mean_noise = _SIGMAS * np.hypot(*errors) / scale
    beyond = np.maximum(np.abs(means[0] - means[1]) / scale - mean_noise, 0.0)
    worst = int(np.argmax(beyond + 1e-9 * np.abs(means[0] - means[1])))
    blocks = [_blocks(pictures.mean(axis=3)) for pictures in (ours, theirs)]
    block_means, block_errors = zip(*(_mean_and_error(each) for each in blocks), strict=True)
    block_scale = np.maximum(block_means[1], _DARK * block_means[1].mean())
    block_scale = np.where(block_scale > 0, block_scale, 1.0)
    noise = _SIGMAS * np.hypot(*block_errors) / block_scale
    block_beyond = np.maximum(np.abs(block_means[0] - block_means[1]) / block_scale - noise, 0.0)
    return {
        "mean_ratio": _rounded(1.0 + (means[0] - means[1])[worst] / scale[worst]),
        "mean_difference": _rounded(beyond.max()),
        "mean_noise": _rounded(mean_noise.max()),
        "worst_block": _rounded(block_beyond.max()),
        "noise": _rounded(noise.max()),
    }


def _rounded(value: float) -> float:
    return round(float(value), 5)


def _mean_and_error(batches: Float64) -> tuple[Float64, Float64]:
    """Return the mean over the first axis, and its standard error."""
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(len(batches))


def _blocks(pictures: Float64) -> Float64:
    """Return (batches, blocks) means of blocks of pixels; blocks at the right and bottom edge may be smaller."""
    rows = np.arange(0, pictures.shape[1], _BLOCK)
    columns = np.arange(0, pictures.shape[2], _BLOCK)
    sums = np.add.reduceat(np.add.reduceat(pictures, rows, axis=1), columns, axis=2)
    ones = np.ones(pictures.shape[1:])
    counts = np.add.reduceat(np.add.reduceat(ones, rows, axis=0), columns, axis=1)
    return np.asarray((sums / counts).reshape(len(pictures), -1))


def _ours(scene: Scene, samples: int, seed: int) -> Float64:
    """Return (batches, H, W, 3) pictures of films with different seeds. Raises GlpathError.

    The spread of one film's batches would be up to four times too small, because its path sets share samples of a
    map.
    """
    films = [
        render(scene, integrator="path", spp=samples // _BATCHES, max_depth=_DEPTH, seed=seed + i)
        for i in range(_BATCHES)
    ]
    return np.stack([film.mean for film in films]).astype(np.float64)


def _mitsubas(
    scene: Scene, path: Path, parameters: dict[str, str], samples: int, seed: int, variant: str
) -> Float64:
    """Return Mitsuba's pictures (batches, H, W, 3). Raises SubprocessError and GlpathError."""
    camera = scene.camera
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "pictures.npy"
        request = {
            "path": str(path.resolve()),
            "output": str(output),
            "parameters": parameters,
            "size": camera.resolution,
            "camera": {
                "position": camera.position.tolist(),
                "target": camera.target.tolist(),
                "up": camera.up.tolist(),
                "fov": camera.fov,
            },
            "samples": samples // _BATCHES,
            "batches": _BATCHES,
            "depth": _DEPTH,
            "first_seed": seed,
            "variant": variant,
        }
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.peers.mitsuba_file"],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            check=False,
            timeout=_MITSUBA_SECONDS,
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise GlpathError(f"Mitsuba ends with {done.returncode}: {last}")
        return np.asarray(np.load(output), np.float64)


def examine_all(
    folder: Path,
    kept: Mapping[str, dict[str, Any]],
    on_rows: Callable[[list[dict[str, Any]]], None],
    progress: Callable[[str], None] = lambda text: None,
) -> Report:
    """Load all files of a folder, then render them, those without warnings first. After each, call `on_rows`.

    kept : rows of files that are not examined again, unless they were only loaded

    Raises GlpathError for a folder without files.
    """
    paths = files_of(folder)
    if not paths:
        raise GlpathError(f"mitsuba-scenes: {folder} has no .xml file.", "Bring Mitsuba's repositories into it.")
    rows = {
        name: kept[name] if name in kept else load(folder, folder / name)
        for name in (path.relative_to(folder).as_posix() for path in paths)
    }
    on_rows(list(rows.values()))
    for samples in SAMPLES:
        waiting = [name for name, row in rows.items() if is_waiting(row, samples)]
        for name in sorted(waiting, key=lambda name: bool(rows[name]["warnings"])):
            start = time.perf_counter()
            rows[name] = compare(folder, rows[name], samples)
            progress(f"{name}: {_summary(rows[name])} ({time.perf_counter() - start:.0f} s)")
            on_rows(list(rows.values()))
    return report(list(rows.values()))


def _summary(row: Mapping[str, Any]) -> str:
    if "worst_block" in row:
        return f"{row['verdict']}, mean x {row['mean_ratio']:.4f}, worst block {100 * row['worst_block']:.1f} %"
    return f"{row['verdict']}: {row.get('error', '')}"
