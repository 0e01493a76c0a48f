"""Rooms that leak: each loads, is closed, has light and a solution, and no two of its faces coincide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import glpath
from benchmarks.scenes.leaky_rooms import ROOMS, held_out, room
from glpath.io import load_scene
from glpath.scene.triangulate import path_traceable

SEEDS = (1, 3, 12)
SIZE = (24, 18)
#: Radiance under a sky of radiance 1: a few paths in 100,000 get past an edge where two walls meet.
LIGHT_PAST_EDGES = 2e-3
DESCRIPTIONS = [*map(room, ROOMS), *map(held_out, SEEDS)]
NAMES = [description["name"] for description in DESCRIPTIONS]


@pytest.fixture(params=DESCRIPTIONS, ids=NAMES)
def description(request: pytest.FixtureRequest) -> dict[str, Any]:
    return dict(request.param)


@pytest.mark.filterwarnings("ignore:.*the bias of the gather:glpath.SceneWarning")
def test_camera_sees_light_and_the_solver_takes_the_room(description: dict[str, Any], tmp_path: Path) -> None:
    scene = load_scene(description)
    solution = glpath.solve_radiosity(scene, method="monte-carlo", patches=200, particles=16384)
    assert solution.elements.sum() > 0
    film = glpath.render(scene, integrator="gather", radiosity=solution, spp=4, resolution=SIZE)
    assert film.mean.mean() > 0
    glpath.export(scene, tmp_path / "room.xml")


@pytest.mark.parametrize("name", [name for name in ROOMS if name != "sun-blinds"])
def test_a_room_is_closed_to_a_sky(name: str) -> None:
    dark = room(name)
    dark["shapes"] = [{k: v for k, v in shape.items() if k != "emission"} for shape in dark["shapes"]]
    film = glpath.render(dark | {"sky": {"zenith": 1.0}}, integrator="path", guide="cosine", spp=8, resolution=SIZE)
    assert film.mean.mean() < LIGHT_PAST_EDGES


def test_no_faces_coincide(description: dict[str, Any]) -> None:
    triangles = path_traceable(load_scene(description)).triangles
    coinciding = [(i, j) for i, j in coplanar_pairs(triangles) if overlaps(triangles[i], triangles[j])]
    assert coinciding == []


def test_held_out_rooms_follow_from_their_seed() -> None:
    assert held_out(5) == held_out(5)
    kinds = {held_out(seed)["name"].split("-", 3)[3] for seed in range(13)}
    assert len(kinds) == 13


def coplanar_pairs(triangles: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return the pairs of triangles (T, 3, 3) that lie in one plane."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.einsum("td,td->t", normals, triangles[:, 0])
    heights = np.abs(np.einsum("td,ukd->tuk", normals, triangles) - offsets[:, None, None]).max(axis=2)
    return [(int(i), int(j)) for i, j in np.argwhere(heights < 1e-7) if i < j]


def overlaps(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return True if two coplanar triangles share more than an edge: no edge separates them."""
    normal = np.cross(one[1] - one[0], one[2] - one[0])
    for corners in (one, other):
        for k in range(3):
            across = np.cross(normal, corners[(k + 1) % 3] - corners[k])
            a, b = one @ across / np.linalg.norm(across), other @ across / np.linalg.norm(across)
            if a.max() <= b.min() + 1e-7 or b.max() <= a.min() + 1e-7:
                return False
    return True
