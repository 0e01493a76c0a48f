"""Cycles, Blender's path tracer, as a peer: the same triangles, camera, depth and pixel filter.

It is a process of its own (`cycles_worker`), as Blender's module `bpy` wants a Python and a numpy of its own; see
`other_python` for how to install it.

Poor at:  what Cycles counts otherwise; `mitsuba_peer.comparable` lists what a scene may have.
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

from glpath.errors import GlpathError
from glpath.experiments import other_python
from glpath.film import read_image
from glpath.scene.model import Float64, Scene

#: What of its sampling depends on the scene: lights chosen by a tree, and the bounce from which roulette is played.
CANDIDATES: tuple[dict[str, bool | int], ...] = tuple(
    {"use_light_tree": tree, "min_light_bounces": bounces} for tree in (True, False) for bounces in (0, 3, 8)
)
_WORKER = Path(__file__).with_name("cycles_worker.py")


def version() -> str:
    """Of the `bpy` that would be asked. Raises GlpathError without one."""
    return other_python.find_package("bpy", other_python.python())[1]


def write_scene(scene: Scene, max_depth: int, path: Path) -> None:
    """What `cycles_worker` reads: a comparable scene as arrays.

    shapes, bounces, resolution, fov (vertical, degrees), clip (nearest and farthest distance seen),
    world_from_camera (4, 4): x to the right, y up, the camera looks along -z; and for each shape i
    corners<i> (n, 3, 3), light<i> (8,): reflectance, 1 where two-sided, emission, 1 where it emits on both sides
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
    for i, (shape, part) in enumerate(zip(scene.shapes, scene.shapes.ranges, strict=True)):
        material = scene.materials[shape.material]
        light = [*material.reflectance, material.two_sided, *shape.emission, shape.emission_two_sided]
        arrays |= {f"corners{i}": scene.triangles[part], f"light{i}": np.array(light, float)}
    np.savez(path, **arrays)  # type: ignore[arg-type]


class Cycles:
    """A running Cycles with a scene. `render` returns seconds and (H, W, 3) radiance, row 0 at the top."""

    def __init__(self, process: subprocess.Popen[str], folder: Path) -> None:
        self._process = process
        self._out = folder / "picture.exr"
        self.version = self._answer()["version"]
        self.settings = CANDIDATES[0]

    def tune(self, error: Callable[[Float64], float], spp: int = 16, rounds: int = 2) -> None:
        """Take those settings of `CANDIDATES` whose error times time is the least, all tried in turns.

        error : of a picture, falling as 1 / spp
        """
        costs = np.empty((rounds, len(CANDIDATES)))
        for turn in range(rounds):
            for i, self.settings in enumerate(CANDIDATES):
                seconds, image = self.render(spp, turn)
                costs[turn, i] = seconds * error(image)
        self.settings = CANDIDATES[int(np.argmin(np.median(costs, axis=0)))]

    def render(self, spp: int, seed: int) -> tuple[float, Float64]:
        assert self._process.stdin is not None, "opened with a pipe"
        asked = {"spp": spp, "seed": seed, "out": str(self._out), "settings": self.settings}
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        seconds = float(self._answer()["seconds"])
        return seconds, read_image(self._out)

    def _answer(self) -> dict[str, str]:
        assert self._process.stdout is not None, "opened with a pipe"
        line = self._process.stdout.readline()
        if not line:
            raise GlpathError(f"Cycles ended with code {self._process.wait()}.", f"Run {_WORKER.name} by hand.")
        answer: dict[str, str] = json.loads(line)
        return answer


@contextmanager
def cycles(scene: Scene, max_depth: int) -> Iterator[Cycles]:
    """Cycles with a comparable scene, warm. Raises GlpathError where it is absent or fails."""
    version()
    with tempfile.TemporaryDirectory() as folder:
        described = Path(folder, "scene.npz")
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
                program.render(1, 0)
                yield program
            finally:
                process.kill()
