"""Scenes with streamed triangles, and the same triangles in memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import glpath
from tests.support.terrain import Hills

GRASS = {"grass": {"reflectance": [0.3, 0.6, 0.3]}, "clay": {"reflectance": [0.7, 0.2, 0.2]}}
SKY = {"sky": {"zenith": [0.2, 0.3, 0.6], "horizon": 0.5}}
LAMPS = {
    "lights": [
        {"type": "point", "position": [1, 2, 1], "intensity": 5},
        {"type": "directional", "direction": [1, -1, -0.5], "irradiance": 1},
    ]
}

TRIANGLE = np.array([[[0, 0, 0], [1, 0, 0], [0, 0, -1]]], float)


class Given:
    """Chunks that a test gives."""

    def __init__(self, *chunks: Any) -> None:
        self.chunks = chunks

    def __len__(self) -> int:
        return len(self.chunks)

    def chunk(self, index: int) -> Any:
        return self.chunks[index]


def streamed_corners(hills: Hills) -> NDArray[np.float64]:
    """Return (T, 3, 3) corners of a whole terrain."""
    found = (hills.chunk(i) for i in range(len(hills)))
    return np.concatenate([vertices[faces] for vertices, faces in found]).astype(np.float64)


def in_memory(triangles: NDArray[Any], **more: Any) -> dict[str, Any]:
    """Return the description of a shape of triangles (T, 3, 3)."""
    vertices = np.asarray(triangles, np.float64).reshape(-1, 3)
    return {"vertices": vertices, "faces": np.arange(len(vertices)).reshape(-1, 3), **more}


def scene_of(terrain: dict[str, Any], **more: Any) -> glpath.Scene:
    """Return a scene with a box and a lamp over a terrain, which is the last shape."""
    return glpath.load_scene(
        {
            "camera": {"position": [0, 3, 6], "target": [0, 0, 0], "fov": 45},
            "film": {"resolution": [40, 30]},
            "materials": GRASS,
            "shapes": [
                {"type": "box", "min": [-0.4, 0.5, -0.3], "max": [0.3, 1.2, 0.3], "material": "clay"},
                {
                    "type": "quad",
                    "corners": [[-1, 3, -1], [1, 3, -1], [1, 3, 1], [-1, 3, 1]],
                    "emission": {"radiance": 9},
                },
                {"material": "grass", **terrain},
            ],
            **more,
        }
    )
