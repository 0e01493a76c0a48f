"""The figures of PB, each made small, and the radiosity solution as the eye sees it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.figures.catalogue import FIGURES
from benchmarks.figures.eye_hits import ShownHits
from benchmarks.figures.mesh_step import mesh_step
from benchmarks.figures.path_buffer_room import post_shadow
from benchmarks.scenes.room import POSTS
from glpath.io import load_scene
from glpath.radiosity import RadiositySolution
from glpath.radiosity.mesh import lattice
from glpath.scene import Scene

SCALE = "0.004"


@pytest.mark.parametrize("name", [name for name in FIGURES if name.startswith("path-buffer")])
def test_a_small_figure_has_its_files_and_its_numbers(name: str, tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["figure", name, "--scale", SCALE, "-o", str(tmp_path)])
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / f"{name}.json").read_text())
    assert isinstance(report["holds"], bool)
    measured = report["measured"]
    # The shadow of a post is narrower than a pixel here.
    assert all(isinstance(value, float) for key, value in measured.items() if key != "post_shadow")
    rows = list(csv.DictReader((tmp_path / f"{name}.csv").read_text().splitlines()))
    assert len(rows) == len(report["rows"]) >= 2
    picture = iio.imread(tmp_path / f"{name}.png")
    assert picture.shape[1] >= 480
    assert np.any(picture < 100)
    if name == "path-buffer-8":
        assert measured["elements"] == 210
    if name == "path-buffer-11":
        assert measured["triangles"] == measured["elements"] == 14920
        assert measured["noise_of_small"] > 2 * measured["noise_of_large"]


# A radiosity solution, shown


@pytest.fixture(scope="module")
def box() -> Scene:
    return load_scene("cornell-box-36").with_camera(resolution=(96, 96))


def solution_of(scene: Scene, n: int, elements: np.ndarray, vertices: np.ndarray) -> RadiositySolution:
    """A solution by what fronts reflect at the elements and at the vertices, a half of it direct light."""
    count = len(scene.triangles)
    front = scene.side_reflectance[0]
    values = [
        np.tile(0.5 * reflected[:, None] / np.repeat(front, len(reflected) // count, axis=0), (2, 2, 1, 1))
        for reflected in (elements, vertices)
    ]
    return RadiositySolution(scene.digest(camera=False), np.full(count, n), *values)


def test_what_the_eye_sees_is_emission_and_the_solution(box: Scene):
    hits = ShownHits.of(box)
    count = len(box.triangles)
    even = solution_of(box, 1, np.full(count, np.pi), np.full(3 * count, np.pi))
    for mode in ("constant", "interpolated", "smooth"):
        shown = hits.radiance(even, mode)
        assert shown[hits.reflecting] == pytest.approx(1)
        lamp = hits.only("light")
        assert shown[lamp] == pytest.approx(np.broadcast_to(np.array([19.387, 14.9873, 7.75357]), (lamp.sum(), 3)))
        beyond = (hits.triangle < 0).all(axis=2)
        assert beyond.any()
        assert (shown[beyond] == 0).all()
    # The floor is in the lower half, and the red wall to the left.
    assert np.flatnonzero(hits.only("floor").any(axis=1)).min() > 48
    assert np.flatnonzero(hits.only("red-wall").any(axis=0)).max() < 48


def test_the_steps_of_a_mesh_are_told_from_light_that_is_smooth(box: Scene):
    hits = ShownHits.of(box)
    n, count = 4, len(box.triangles)
    rng = np.random.default_rng(2)
    elements = rng.uniform(1, 1.5, count * n * n)
    # At the vertices, light that is linear over the room.
    where = lattice.vertex_barycentrics(n)
    corners = box.triangles
    points = corners[:, :1] + np.einsum("vk,tkj->tvj", where, corners[:, 1:] - corners[:, :1])
    solution = solution_of(box, n, elements, (3 + points.sum(axis=2)).ravel() + 1)
    stepped, smooth = (hits.radiance(solution, mode) for mode in ("constant", "smooth"))
    assert mesh_step(stepped, hits, solution) > 0.04
    assert abs(mesh_step(smooth, hits, solution)) < 0.01


def test_the_shadow_of_a_post_is_what_the_plaster_behind_it_lacks() -> None:
    hits = ShownHits.of(load_scene("room").with_camera(resolution=(192, 192)), 2)
    x = hits.position[..., 0].mean(axis=2)
    light = np.where(np.abs(x - POSTS[0]) < 0.06, 0.5, 1.0)[..., None] * [1, 1, 1]
    assert post_shadow(hits, light) == pytest.approx(0.5, abs=0.03)
    assert post_shadow(hits, np.ones((192, 192, 3))) == pytest.approx(1)
