"""The light of all bounces: chance alone ends paths, however white a room is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from glpath.errors import SceneWarning
from glpath.integrators import ray_paths
from glpath.io import load_scene
from glpath.scene import Scene
from tests.support.engines import engine_options


def furnace(reflectance: float) -> Scene:
    """A closed box whose walls all emit 1 and reflect alike: the radiance is 1 / (1 - reflectance) everywhere."""
    return load_scene(
        {
            "camera": {"position": [0, 0, 0.5], "target": [0, 0, -1], "fov": 60},
            "film": {"resolution": [16, 16]},
            "materials": {"white": {"reflectance": reflectance}},
            "shapes": [
                {
                    "type": "box",
                    "min": [-1, -1, -1],
                    "max": [1, 1, 1],
                    "flip_normals": True,
                    "material": "white",
                    "emission": {"radiance": 1.0},
                }
            ],
        }
    )


def points(count: int = 256) -> Any:
    x = np.random.default_rng(2).uniform(-0.9, 0.9, (count, 2))
    return np.column_stack([x[:, 0], np.full(count, -1.0), x[:, 1]])


@pytest.mark.parametrize("reflectance", [0.95, 0.99])
def test_a_closed_white_room_has_all_of_its_light(reflectance: float) -> None:
    """64 vertices would lose 3.7 % and 53 % of it."""
    batches = [
        glpath.irradiance(furnace(reflectance), points(), [0.0, 1.0, 0.0], spp=16, seed=seed).values.mean() / np.pi
        for seed in range(8)
    ]
    error = np.std(batches, ddof=1) / len(batches) ** 0.5
    expected = 1.0 / (1.0 - reflectance)
    assert error < 0.02 * expected
    assert abs(np.mean(batches) - expected) < 3.5 * error


def test_paths_that_a_safety_cuts_are_counted_and_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_paths, "CEILING", 8)
    with pytest.warns(SceneWarning, match="were cut"):
        film = glpath.render(furnace(0.9), max_depth=1000, roulette=4, spp=4)
    cut = film.metadata.statistics["paths_cut"]
    # Of 1024 paths, those that came to the last vertex, or ended on the way to it: a bounce takes a tenth.
    assert cut == pytest.approx(1024 * 0.9**6, rel=0.15)
    monkeypatch.undo()
    film = glpath.render(furnace(0.9), max_depth=1000, roulette=4, spp=4)
    assert "paths_cut" not in film.metadata.statistics


def test_only_scans_of_cells_lose_rays() -> None:
    own, shared = (
        glpath.render(furnace(0.5), max_depth=3, spp=2, **engine_options(engine)) for engine in ("path", "pair")
    )
    assert "paths_lost" not in own.metadata.statistics
    assert "paths_lost" in shared.metadata.statistics
