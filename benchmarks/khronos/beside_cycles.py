"""Renders a sample model with the defaults of `glpath render`, and with Cycles under the same sky.

The sky is the studio that models without lights get, as an environment map; the camera is the one that frames the
model. Both pictures are denoised, and use the sRGB curve at exposure 0, so a white ground is 255. The lights of a
model shine, too. Processor time is that of the whole process.

Poor at: features for which Blender's importer deviates from glTF, such as culled backs.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.khronos.models import Mark, SampleModel, mark_of
from benchmarks.peers import other_python
from benchmarks.peers.blender import render_model, view_of
from glpath.errors import GlpathError
from glpath.film.exr import read_exr_channels, write_exr
from glpath.film.tonemap import tonemap
from glpath.io import load_scene
from glpath.io.completed import aside
from glpath.scene.model import Float64
from glpath.sky.studio import studio

UInt8 = NDArray[np.uint8]
Say = Callable[[str], None]

#: Limit of the processor seconds of a 512 x 512 picture: about 8 s on two cores.
ENOUGH_SECONDS = 16.0
_CYCLES_SPP = 256
_PATIENCE = 1200.0  # seconds for a picture


@dataclass
class Beside:
    """A model's row of the table, and its pictures by program as uint8 sRGB."""

    row: dict[str, Any]
    pictures: dict[str, UInt8] = field(default_factory=dict)


def compare_models(models: list[SampleModel], side: int, say: Say) -> tuple[list[Beside], list[str]]:
    """Return each model's pictures and their difference, and notes on missing programs."""
    notes = []
    try:
        other_python.find_package("bpy", other_python.python())
        with_cycles = True
    except GlpathError as error:
        with_cycles = False
        notes.append(f"without Cycles: {error}")
    found = []
    for i, model in enumerate(models):
        with tempfile.TemporaryDirectory() as folder:
            found.append(_compared(model, side, Path(folder), with_cycles))
        row = found[-1].row
        say(f"{i + 1}/{len(models)} {model.name}: {_in_words(row)}")
    return found, notes


def _compared(model: SampleModel, side: int, folder: Path, with_cycles: bool) -> Beside:
    row: dict[str, Any] = {"model": model.name, "file": str(model.file)}
    shown = Beside(row)
    try:
        view = _view(model.file, side)
        mark = mark_of(model.file)
    except GlpathError as error:
        row |= {"status": "refused", "message": str(error)}
        return shown
    row |= {"features": ", ".join(mark.features), "limit": mark.limit}
    picture = _by_glpath(model.file, side, folder, row)
    if picture is None:
        return shown
    shown.pictures["glpath"] = tonemap(picture)
    if with_cycles:
        theirs = _by_cycles(model.file, side, folder, view, row)
        if theirs is not None:
            shown.pictures["cycles"] = tonemap(theirs)
            row |= differences(shown.pictures["glpath"], shown.pictures["cycles"], mark)
    return shown


def differences(ours: UInt8, theirs: UInt8, mark: Mark) -> dict[str, Any]:
    """Return mean differences of eight-bit values: of all pixels, of the worst tenth, and whether it is small."""
    apart = np.abs(ours.astype(float) - theirs).mean(axis=2)
    worst = np.sort(apart, axis=None)[-max(1, apart.size // 10) :]
    mean = float(apart.mean())
    holds = None if mark.limit is None else mean <= mark.limit
    return {"difference": mean, "worst_tenth": float(worst.mean()), "holds": holds}


def _view(file: Path, side: int) -> dict[str, Any]:
    with aside("camera", "light"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = load_scene(str(file))
    return view_of(scene.with_camera(resolution=(side, side)))


def _by_glpath(file: Path, side: int, folder: Path, row: dict[str, Any]) -> Float64 | None:
    sky, picture = folder / "sky.exr", folder / "glpath.exr"
    write_exr(sky, studio().image)
    command = [sys.executable, "-m", "glpath", "render", str(file), "--environment", str(sky), "--quiet"]
    command += ["--resolution", f"{side}x{side}", "-o", str(picture)]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_PATIENCE)
    row["seconds"] = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    row["processor_seconds"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    row["notes"] = done.stderr.strip()
    if done.returncode:
        row |= {"status": "failed", "message": done.stderr.strip()}
        return None
    row["status"] = "rendered"
    channels, _ = read_exr_channels(picture)
    layer = "denoised." if "denoised.R" in channels else ""
    return np.stack([channels[layer + letter] for letter in "RGB"], axis=-1).astype(np.float64)


def _by_cycles(file: Path, side: int, folder: Path, view: dict[str, Any], row: dict[str, Any]) -> Float64 | None:
    sky = folder / "sky-cycles.exr"
    # The middle of a map faces +x in Blender, but +z in glpath.
    write_exr(sky, np.roll(studio().image, studio().image.shape[1] // 4, axis=1))
    asked = {"side": side, "spp": _CYCLES_SPP, "max_depth": 33, "denoise": True}
    try:
        theirs = render_model(file, {**asked, "environment": str(sky), **view, "sky": None}, _PATIENCE)
    except GlpathError as error:
        row["cycles"] = str(error).splitlines()[0]
        return None
    row |= {"cycles": theirs.version, "cycles_seconds": theirs.render_seconds}
    return theirs.image


def _in_words(row: dict[str, Any]) -> str:
    if row["status"] != "rendered":
        return f"{row['status']}: {row['message'].splitlines()[0]}"
    words = f"{row['processor_seconds']:.1f} s of processor time"
    if "difference" in row:
        limit = "no mark" if row["limit"] is None else f"at most {row['limit']:g}"
        words += f", differs by {row['difference']:.2f} ({limit})"
    return words
