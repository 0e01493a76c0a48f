"""Renders one model with one program in a separate process, so that time and memory are those of the model alone.

    python -m benchmarks.figures.model_worker < ASKED

ASKED is JSON: {"program": "glpath", "file": "model.glb", "side": 160, "spp": 64, "max_depth": 8, "folder":
"/tmp/a"}. The last line of standard output is the answer. "glpath" reads the model, renders it to
FOLDER/glpath.npy, and exports the scene to FOLDER/scene.xml; "mitsuba" renders that file to FOLDER/mitsuba.npy.
"""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import mitsuba as mitsuba_peer
from benchmarks.peers.blender import view_of
from glpath.errors import GlpathError
from glpath.io import load_scene
from glpath.io.completed import aside
from glpath.io.export import export
from glpath.rendering import render
from glpath.system.machine import peak_resident_bytes


def main() -> None:
    asked = json.load(sys.stdin)
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    make = {"glpath": ours, "mitsuba": mitsubas}[asked["program"]]
    print(json.dumps(make(asked) | {"peak_mib": peak_resident_bytes() / 2**20}), file=answers, flush=True)


def ours(asked: dict[str, Any]) -> dict[str, Any]:
    """Return facts about the model and its picture, and the warnings, or the error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            return _rendered(asked) | {"notes": [str(each.message) for each in caught]}
        except GlpathError as error:
            return {"status": "refused", "message": str(error), "notes": [str(each.message) for each in caught]}


def _rendered(asked: dict[str, Any]) -> dict[str, Any]:
    folder = Path(asked["folder"])
    start = time.perf_counter()
    with aside("picture"):  # a white sky, which the other programs can have, too
        scene = load_scene(asked["file"])
    loaded = time.perf_counter() - start
    scene = scene.with_camera(resolution=(asked["side"], asked["side"]))
    start = time.perf_counter()
    film = render(scene, spp=asked["spp"], max_depth=asked["max_depth"])
    rendered = time.perf_counter() - start
    peak = peak_resident_bytes() / 2**20
    np.save(folder / "glpath.npy", film.mean)
    export(scene, folder / "scene.xml", max_depth=asked["max_depth"], spp=asked["spp"])
    return {
        "status": "rendered",
        "message": "",
        "triangles": scene.shapes.total("triangle"),
        "materials": len(scene.materials),
        "textures": len(scene.textures),
        "lights": len(scene.lights) + sum(shape.emits for shape in scene.shapes),
        "load_seconds": loaded,
        "render_seconds": rendered,
        "render_peak_mib": peak,
        **view_of(scene),
    }


def mitsubas(asked: dict[str, Any]) -> dict[str, Any]:
    mi = mitsuba_peer.load_mitsuba()
    folder = Path(asked["folder"])
    start = time.perf_counter()
    scene = mi.load_file(str(folder / "scene.xml"))
    loaded = time.perf_counter() - start
    start = time.perf_counter()
    np.save(folder / "mitsuba.npy", mitsuba_peer.render_peer(scene, asked["spp"]))
    return {"status": "rendered", "load_seconds": loaded, "render_seconds": time.perf_counter() - start}


if __name__ == "__main__":
    main()
