"""A contact sheet of models: each is rendered by glpath and by other programs.

No figure of a paper. GLPATH_MODELS names the folders (separated by ":") that are searched for models, with their
subfolders; by default, the folder of Debian's assimp-testmodels. Each model is read and rendered in a separate
process, which measures its time and memory. Two other programs render it, too, if they are installed:

- Mitsuba 3 renders the scene that glpath read, from `glpath export`: this checks the light;
- Blender reads the file itself, and Cycles renders it from the same camera: this checks the reader.

Their pictures get the exposure of ours. The difference between two pictures is the mean absolute difference of
blocks of 8 x 8 pixels, divided by the mean, so that noise hardly counts.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figures.outcome import Outcome, Rows, Say, judged
from benchmarks.figures.style import pictures
from benchmarks.peers import other_python
from benchmarks.verdict import Condition
from glpath.errors import GlpathError, UsageError
from glpath.film.film import read_image
from glpath.film.tonemap import auto_exposure, tonemap
from glpath.io.models import FORMATS
from glpath.scene.model import Float64

FOLDERS = "GLPATH_MODELS"
DEBIAN = Path("/usr/share/assimp/models")
DEPTH = 8
_SIDE, _SPP = 160, 64
_PATIENCE = 600  # seconds for one model of one program
_BLOCK = 8
_MODELS_A_ROW = 3
_BLANK = 235


@dataclass
class Shown:
    """A model: its row of the table, and the pictures by program."""

    row: dict[str, Any]
    pictures: dict[str, Float64] = field(default_factory=dict)


def found() -> list[Path]:
    """Find all models in the folders that GLPATH_MODELS names. Raises UsageError if there are none."""
    named = os.environ.get(FOLDERS)
    folders = [Path(each) for each in named.split(os.pathsep) if each] if named else [DEBIAN]
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(
                f"{FOLDERS}: {folder} is not a folder."
                if named
                else f"{FOLDERS} is not set, and {folder} not there.",
                f"Name folders of models, {', '.join(FORMATS)}: {FOLDERS}=/path/to/models. Debian has some: "
                "apt-get install assimp-testmodels",
            )
    files = sorted(path for each in folders for path in each.rglob("*") if path.suffix.lower() in FORMATS)
    if not files:
        raise UsageError(
            f"{FOLDERS}: no models in {', '.join(map(str, folders))}.", f"Known: {', '.join(FORMATS)}."
        )
    return files


def contact_sheet(scale: float, say: Say) -> Outcome:
    """Make the sheet of all models. Scale S multiplies the pictures' side by sqrt(S), and the paths by S."""
    files = found()
    side, spp = max(24, round(_SIDE * math.sqrt(scale) / 8) * 8), max(4, round(_SPP * scale))
    peers, notes = _peers()
    every = []
    for i, file in enumerate(files):
        with tempfile.TemporaryDirectory() as folder:
            every.append(_shown(file, {"side": side, "spp": spp, "max_depth": DEPTH, "folder": folder}, peers))
        row = every[-1].row
        say(f"{i + 1}/{len(files)} {file}: {row['status']} {row.get('message') or ''}")
    measured = _measured(every)
    claim = "every model is rendered, or refused with a message that says what is wrong with it"
    caption = (
        f"{len(files)} models, {side} x {side}, {spp} paths per pixel of at most {DEPTH} vertices; "
        f"{measured['refused']:.0f} were refused, each for a reason, which the table has. Left glpath's picture, "
        "then Mitsuba's of what glpath exports, then Cycles' of the file as Blender reads it; the exposure is ours."
    )
    picture = _sheet(every, side, caption)
    rule = (Condition("without_message", "<=", 0), Condition("rendered", ">=", 1))
    return judged("models", claim, rule, measured, [each.row for each in every], picture, notes, with_gl=True)


def _peers() -> tuple[tuple[str, ...], list[str]]:
    """Return the other programs that are installed, and notes on those that are missing."""
    peers, notes = [], []
    for name, package, interpreter in (
        ("mitsuba", "mitsuba", sys.executable),
        ("blender", "bpy", other_python.python()),
    ):
        try:
            other_python.find_package(package, interpreter)
            peers.append(name)
        except GlpathError as error:
            notes.append(f"without {name}: {error}")
    return tuple(peers), notes


def _shown(file: Path, asked: dict[str, Any], peers: Sequence[str]) -> Shown:
    here = [sys.executable, "-m", "benchmarks.figures.model_worker"]
    asked |= {"file": str(file.resolve())}
    answer = _run(here, asked | {"program": "glpath"})
    row: dict[str, Any] = {"file": str(file), "status": answer["status"], "message": answer["message"]}
    row["notes"] = " ".join(answer.get("notes", []))
    shown = Shown(row)
    if answer["status"] != "rendered":
        return shown
    names = ("triangles", "materials", "textures", "lights", "load_seconds", "render_seconds")
    row |= {name: answer[name] for name in names} | {"peak_mib": answer["render_peak_mib"]}
    folder = Path(asked["folder"])
    shown.pictures["glpath"] = np.load(folder / "glpath.npy")
    if "mitsuba" in peers:
        theirs = _run(here, asked | {"program": "mitsuba"})
        if theirs["status"] == "rendered":
            shown.pictures["mitsuba"] = np.load(folder / "mitsuba.npy")
        row["mitsuba"] = theirs["message"] if "message" in theirs else theirs["render_seconds"]
    if "blender" in peers:
        view = {name: answer[name] for name in ("camera", "fov", "clip", "sky")}
        worker = str(Path(__file__).parents[1] / "peers" / "blender_worker.py")
        theirs = _run([other_python.python(), worker], asked | view)
        if theirs["status"] == "rendered":
            shown.pictures["blender"] = read_image(folder / "blender.exr")
        row["blender"] = theirs["message"] if "message" in theirs else theirs["render_seconds"]
    for name in shown.pictures.keys() - {"glpath"}:
        row[f"{name}_differs"], row[f"{name}_mean"] = difference(shown.pictures["glpath"], shown.pictures[name])
    return shown


def _run(command: Sequence[str], asked: dict[str, Any]) -> dict[str, Any]:
    """Return a worker's answer; if it died or took too long, a row that says so."""
    try:
        done = subprocess.run(
            command, input=json.dumps(asked), capture_output=True, text=True, timeout=_PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        return {"status": "too slow", "message": f"no picture in {_PATIENCE} s"}
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 and lines:
        answer: dict[str, Any] = json.loads(lines[-1])
        return answer
    ending = done.stderr.strip().splitlines()
    return {"status": "crashed", "message": f"code {done.returncode}: {ending[-1] if ending else ''}"}


def difference(ours: Float64, theirs: Float64) -> tuple[float, float]:
    """Return the mean absolute difference of blocks divided by the mean, and the ratio of the means."""
    side = len(ours) // _BLOCK * _BLOCK
    a, b = (
        image[:side, :side].reshape(side // _BLOCK, _BLOCK, side // _BLOCK, _BLOCK, 3).mean(axis=(1, 3))
        for image in (ours, theirs)
    )
    mean = max(float(b.mean()), 1e-12)
    return float(np.abs(a - b).mean()) / mean, float(a.mean()) / mean


def _measured(every: Sequence[Shown]) -> dict[str, float]:
    rows: Rows = [each.row for each in every]
    drawn = [row for row in rows if row["status"] == "rendered"]
    said = [row for row in rows if row["status"] == "refused" and row["message"]]
    measured = {
        "models": float(len(rows)),
        "rendered": float(len(drawn)),
        "refused": float(len(said)),
        "without_message": float(len(rows) - len(drawn) - len(said)),
    }
    for name in ("load_seconds", "render_seconds", "peak_mib"):
        values = [row[name] for row in drawn]
        measured |= {f"{name}_median": float(np.median(values)), f"{name}_most": max(values)} if values else {}
    for name in ("mitsuba", "blender"):
        values = [row[f"{name}_differs"] for row in drawn if f"{name}_differs" in row]
        measured |= {f"{name}_differs_median": float(np.median(values))} if values else {}
    return measured


def _sheet(every: Sequence[Shown], side: int, caption: str) -> Any:
    programs = [name for name in ("glpath", "mitsuba", "blender") if any(name in each.pictures for each in every)]
    blank = np.full((side, side, 3), _BLANK, np.uint8)
    titles = {"mitsuba": "Mitsuba 3", "blender": "Cycles"}
    panels = []
    for each in every:
        if "glpath" not in each.pictures:
            continue
        exposure = auto_exposure(each.pictures["glpath"])
        for name in programs:
            image = each.pictures.get(name)
            # Cut the name to the width of its picture.
            title = Path(each.row["file"]).name[: max(8, side // 8)] if name == "glpath" else titles[name]
            panels.append((title, blank if image is None else tonemap(image, exposure)))
    if not panels:
        panels, programs = [("no picture", blank)], ["glpath"]
    return pictures("Models", caption, panels, _MODELS_A_ROW * len(programs))


FIGURES = {"models": (contact_sheet, f"a contact sheet of all models in the folders that {FOLDERS} names")}
