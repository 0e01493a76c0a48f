"""A stretch of hills in tiles, made when it is asked for: geometry of any size.

`python -m tests.support.terrain TILES MIB [INTEGRATOR]` renders it and prints what memory that took.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import glpath
from glpath.gl.geometry_stream import GeometryStream
from glpath.system.machine import peak_resident_bytes
from tests.support.repository import ROOT

#: Squares along a tile: 2 * TILE**2 triangles.
TILE = 128


class Hills:
    """tiles x tiles tiles over [-3, 3] x [-3, 3], y up."""

    def __init__(self, tiles: int, squares: int = TILE) -> None:
        self.tiles, self.squares = tiles, squares

    def __len__(self) -> int:
        return self.tiles**2

    def chunk(self, index: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Vertices and faces of a tile."""
        steps, side = np.arange(self.squares + 1), self.squares + 1
        column, row = divmod(index, self.tiles)
        x, z = (6.0 * (at * self.squares + steps) / (self.tiles * self.squares) - 3.0 for at in (column, row))
        x, z = np.meshgrid(x, -z, indexing="ij")
        y = 0.4 * np.sin(2 * x) * np.cos(3 * z) + 0.05 * np.sin(31 * x - 5 * z) + 0.02 * np.sin(47 * z + 97 * x)
        corner = (steps[:-1, None] * side + steps[None, :-1]).ravel()
        quads = np.stack([corner, corner + side, corner + side + 1, corner + 1], axis=1)
        vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
        return vertices, quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


class Watched(Hills):
    """Hills that know which of their chunks were asked for, in order."""

    def __init__(self, tiles: int, squares: int = TILE) -> None:
        super().__init__(tiles, squares)
        self.asked: list[int] = []

    def chunk(self, index: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        self.asked.append(index)
        return super().chunk(index)


def scene(tiles: int, resolution: tuple[int, int]) -> Any:
    """Hills under a lamp; their triangles are streamed."""
    return glpath.load_scene(
        {
            "camera": {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 45},
            "film": {"resolution": list(resolution)},
            "materials": {"grass": {"reflectance": [0.3, 0.6, 0.3]}},
            "shapes": [
                {
                    "type": "quad",
                    "corners": [[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]],
                    "emission": {"radiance": 10},
                },
                {"type": "stream", "stream": Hills(tiles), "material": "grass"},
            ],
        }
    )


_OPTIONS: dict[str, dict[str, Any]] = {
    "path-buffer": {"directions": "hemisphere", "max_depth": 2, "light_resolution": 128},
    "t-buffer": {},
}


def memory_of(tiles: int, budget: int, integrator: str = "path-buffer") -> dict[str, float]:
    """What `main` prints, of a process of its own."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.support.terrain", str(tiles), str(budget), integrator],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    found: dict[str, float] = json.loads(run.stdout)
    return found


def main(tiles: str, budget: str, integrator: Any = "path-buffer") -> None:
    device: list[int] = []
    reserve = GeometryStream.reserve

    def noted(stream: GeometryStream) -> None:
        reserve(stream)
        device.append(stream.nbytes)

    GeometryStream.reserve = noted  # type: ignore[method-assign]
    started = time.perf_counter()
    film = glpath.render(
        scene(int(tiles), (64, 48)),
        integrator=integrator,
        spp=1,
        geometry_budget=int(budget),
        **_OPTIONS[integrator],
    )
    found = {
        "peak": peak_resident_bytes() / 2**20,
        "device": max(device) / 2**20,
        "seconds": time.perf_counter() - started,
        "cpu_seconds": time.process_time(),
        "mean": float(film.mean.mean()),
        "lit": float((film.mean > 0).mean()),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
