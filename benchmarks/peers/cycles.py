"""Cycles, Blender's path tracer, as a peer: same triangles, depth, and camera with pixel filter, or atlas.

It runs in a separate process (`cycles_worker`), because Blender's module `bpy` needs other versions of Python and
numpy; `other_python` says how to install it.

Poor at:  features that Cycles defines differently; `mitsuba_peer.comparable` lists what a scene may have.
Source:   Blender 5.0, https://www.cycles-renderer.org
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.peers import other_python
from glpath.apps.lightmap.surfaces import AtlasSurfaces
from glpath.errors import GlpathError
from glpath.film.film import read_image
from glpath.scene.model import Float64, Scene

#: Sampling settings whose best value depends on the scene: a light tree, and the first bounce with roulette.
CANDIDATES: tuple[dict[str, bool | float], ...] = tuple(
    {"use_light_tree": tree, "min_light_bounces": bounces} for tree in (True, False) for bounces in (0, 3, 8)
)
_WORKER = Path(__file__).with_name("cycles_worker.py")


def version() -> str:
    """Return the version of the `bpy` that would run. Raises GlpathError if there is none."""
    return other_python.find_package("bpy", other_python.python())[1]


def write_scene(scene: Scene, max_depth: int, path: Path) -> None:
    """Write a comparable scene as arrays for `cycles_worker`.

    shapes, bounces, resolution, fov (vertical, degrees), clip (nearest and farthest visible distance),
    world_from_camera (4, 4): x to the right, y up, the camera looks along -z; and for each shape i:
    corners<i> (n, 3, 3), light<i> (8,): reflectance, 1 if two-sided, emission, 1 if it emits on both sides
    """
    camera = scene.camera
    right, up, forward = camera.frame()
    world_from_camera = np.eye(4)
    world_from_camera[:3] = np.stack([right, up, -forward, camera.position], axis=1)
    low, high = scene.bounds
    diagonal = float(np.linalg.norm(high - low))
    far = float(np.linalg.norm(camera.position - 0.5 * (low + high))) + diagonal
    arrays: dict[str, object] = {
        "shapes": len(scene.shapes),
        "bounces": max_depth - 1,
        "resolution": camera.resolution,
        "fov": camera.fov,
        "clip": (1e-4 * diagonal, far),
        "world_from_camera": world_from_camera,
    }
    lights = _lights(scene)
    for i, part in enumerate(scene.shapes.ranges):
        arrays |= {f"corners{i}": scene.triangles[part], f"light{i}": lights[i]}
    np.savez(path, **arrays)  # type: ignore[arg-type]


def write_bake(surfaces: AtlasSurfaces, max_depth: int, path: Path) -> None:
    """Write the scene of one page as arrays for `cycles_worker`, to bake the same texels.

    size, bounces; for the F triangles that have texels: corners (F, 3, 3), uv (F, 3, 2) from 0 to 1, upwards,
    light_of (F,): index in lights (S, 8), see `write_scene`; and the other triangles as shapes of `write_scene`
    """
    scene, atlas = surfaces.scene, surfaces.atlas
    if atlas.pages != 1 or np.any(atlas.side):
        raise GlpathError("Cycles bakes one page of front sides here.", "Give the size of the page.")
    lights = _lights(scene)
    shape_of = np.repeat(np.arange(len(lights)), [part.stop - part.start for part in scene.shapes.ranges])
    without = np.setdiff1d(np.arange(len(scene.triangles)), atlas.triangle)
    rest = [without[shape_of[without] == i] for i in range(len(lights))]
    arrays: dict[str, object] = {
        "size": atlas.size[0],
        "bounces": max_depth - 1,
        "corners": scene.triangles[atlas.triangle],
        "uv": atlas.uv / atlas.size * [1.0, -1.0] + [0.0, 1.0],
        "light_of": shape_of[atlas.triangle],
        "lights": lights,
        "shapes": sum(len(some) > 0 for some in rest),
    }
    for i, (some, light) in enumerate((some, lights[j]) for j, some in enumerate(rest) if len(some)):
        arrays |= {f"corners{i}": scene.triangles[some], f"light{i}": light}
    np.savez(path, **arrays)  # type: ignore[arg-type]


def _lights(scene: Scene) -> Float64:
    """Return (S, 8) lights of the shapes; see `write_scene`."""
    return np.array(
        [
            [*(m := scene.materials[s.material]).reflectance, m.two_sided, *s.emission, s.emission_two_sided]
            for s in scene.shapes
        ],
        float,
    )


class Cycles:
    """A running Cycles process with a scene. `render` returns seconds and (H, W, 3) radiance, row 0 at the top."""

    def __init__(self, process: subprocess.Popen[str], folder: Path) -> None:
        self._process = process
        self._folder = folder
        #: Peak memory of its process, after the last picture.
        self.peak_bytes = 0
        self.version = self._answer()["version"]
        #: Settings of `scene.cycles`.
        self.settings: dict[str, bool | float] = dict(CANDIDATES[0])

    def tune(self, error: Callable[[Float64], float], spp: int = 16, rounds: int = 2) -> None:
        """Choose the settings of `CANDIDATES` with the least error times time, trying all in turns.

        error : function that returns a picture's error, which falls as 1 / spp
        """
        costs = np.empty((rounds, len(CANDIDATES)))
        for turn in range(rounds):
            for i, self.settings in enumerate(CANDIDATES):
                seconds, image = self.render(spp, turn)
                costs[turn, i] = seconds * error(image)
        self.settings = CANDIDATES[int(np.argmin(np.median(costs, axis=0)))]

    def tune_bake(self, noise2: Callable[[Float64, Float64], float], spp: int = 4) -> None:
        """Do what `tune` does for bakes; noise2: squared noise from two pages of other seeds, falls as 1 / spp."""
        costs = []
        for self.settings in CANDIDATES:
            (seconds, one), (more, other) = self.bake(spp, 1), self.bake(spp, 2)
            costs.append(min(seconds, more) * noise2(one, other))
        self.settings = CANDIDATES[int(np.argmin(costs))]

    def render(self, spp: int, seed: int) -> tuple[float, Float64]:
        out = self._folder / "picture.exr"
        return self._made(spp, seed, out), read_image(out)

    def bake(self, spp: int, seed: int) -> tuple[float, Float64]:
        """Return seconds, and irradiance (size, size, 3), row 0 at the top, 0 outside texels."""
        out = self._folder / "page.npy"
        return self._made(spp, seed, out), np.pi * np.load(out)[::-1].astype(float)

    def _made(self, spp: int, seed: int, out: Path) -> float:
        assert self._process.stdin is not None, "opened with a pipe"
        asked = {"spp": spp, "seed": seed, "out": str(out), "settings": self.settings}
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        answer = self._answer()
        self.peak_bytes = int(answer["peak_bytes"])
        return float(answer["seconds"])

    def _answer(self) -> dict[str, str]:
        assert self._process.stdout is not None, "opened with a pipe"
        line = self._process.stdout.readline()
        if not line:
            raise GlpathError(f"Cycles ended with code {self._process.wait()}.", f"Run {_WORKER.name} by hand.")
        answer: dict[str, str] = json.loads(line)
        return answer


@contextmanager
def cycles(scene: Scene | AtlasSurfaces, max_depth: int) -> Iterator[Cycles]:
    """Start Cycles with a comparable scene to render, or with surfaces to bake, and render once to warm up.

    Raises GlpathError if Cycles is missing or fails.
    """
    version()
    with tempfile.TemporaryDirectory() as folder:
        described = Path(folder, "scene.npz")
        if isinstance(scene, AtlasSurfaces):
            write_bake(scene, max_depth, described)
        else:
            write_scene(scene, max_depth, described)
        with subprocess.Popen(
            [other_python.python(), str(_WORKER), str(described)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as process:
            try:
                program = Cycles(process, Path(folder))
                (program.bake if isinstance(scene, AtlasSurfaces) else program.render)(1, 0)
                yield program
            finally:
                process.kill()
