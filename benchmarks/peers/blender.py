"""Renders a model with Cycles as Blender's importer reads it, in a separate process (`blender_worker`)."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.peers import other_python
from glpath.errors import GlpathError
from glpath.film.film import read_image
from glpath.scene import Scene
from glpath.scene.model import Float64
from glpath.sky.sky import Environment

_WORKER = Path(__file__).with_name("blender_worker.py")


class Picture(NamedTuple):
    """image : (H, W, 3) radiance in the units of the file; version : Blender's version"""

    image: Float64
    load_seconds: float
    render_seconds: float
    version: str


def render_model(file: Path, asked: dict[str, Any], patience: float = 1200.0) -> Picture:
    """Render a model. Raises GlpathError if Blender is missing, fails, or takes more than `patience` s.

    asked : input of `blender_worker`, without "file" and "folder"
    """
    interpreter = other_python.python()
    other_python.find_package("bpy", interpreter)
    with tempfile.TemporaryDirectory() as folder:
        question = json.dumps({**asked, "file": str(file.resolve()), "folder": folder})
        try:
            done = subprocess.run(
                [interpreter, str(_WORKER)], input=question, capture_output=True, text=True, timeout=patience
            )
        except subprocess.TimeoutExpired:
            raise GlpathError(f"Cycles had no picture of {file.name} in {patience:g} s.") from None
        if done.returncode:
            word = (done.stderr.strip().splitlines() or ["no word"])[-1]
            raise GlpathError(f"Cycles failed with {file.name}: {word}", f"Run {_WORKER.name} by hand.")
        answer = json.loads(done.stdout.strip().splitlines()[-1])
        image = read_image(Path(folder, "blender.exr"))
    return Picture(image, answer["load_seconds"], answer["render_seconds"], answer["version"])


def view_of(scene: Scene) -> dict[str, Any]:
    """Return the camera and the surrounding light, for another program that reads the file itself."""
    camera = scene.camera
    right, up, forward = camera.frame()
    world_from_camera = np.eye(4)
    world_from_camera[:3] = np.stack([right, up, -forward, camera.position], axis=1)
    low, high = scene.bounds
    size = float(np.linalg.norm(high - low))
    far = float(np.linalg.norm(camera.position - 0.5 * (low + high))) + size
    sky = None if scene.sky is None or isinstance(scene.sky, Environment) else scene.sky.zenith.tolist()
    return {"camera": world_from_camera.tolist(), "fov": camera.fov, "clip": [1e-4 * size, far], "sky": sky}
