"""A few of many punctual lights for each point: in the mean what all bring, sooner."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from glpath.errors import TimeLimitError
from glpath.io import scene_from_dict
from glpath.io.completed import uniform_sky
from glpath.radiosity.form_factors import light_choice
from glpath.radiosity.form_factors.light_choice import MANY, Chosen, LightChoice
from glpath.radiosity.form_factors.lights import DirectLight
from glpath.radiosity.mesh.mesh import Elements
from glpath.radiosity.mesh.sides import Sides
from glpath.radiosity.solution import INDIRECT
from glpath.radiosity.solvers.solve import solve_radiosity
from glpath.scene.model import Scene
from glpath.scene.triangulate import path_traceable
from glpath.system.time_limit import limited
from tests.support.clock import Clock


def hall(lamps: int) -> Scene:
    """A closed box with a block in it, under lamps of many strengths."""
    random = np.random.default_rng(3)
    lights: list[dict[str, Any]] = [
        {"type": "point", "position": at.tolist(), "intensity": (1 + 9 * i % 5) / lamps}
        for i, at in enumerate(random.uniform([-1.9, 1.5, -1.9], [1.9, 1.9, 1.9], (lamps, 3)))
    ]
    return path_traceable(
        scene_from_dict(
            {
                "camera": {"position": [0, 1, 1.9], "target": [0, 0.5, 0], "fov": 70},
                "film": {"resolution": [32, 24]},
                "materials": {"grey": {"reflectance": 0.5}},
                "shapes": [
                    {"type": "box", "min": [-2, 0, -2], "max": [2, 2, 2], "material": "grey"},
                    {"type": "box", "min": [-0.5, 0, -0.5], "max": [0.5, 1, 0.5], "material": "grey"},
                ],
                "lights": lights,
            }
        )
    )


def on_triangles(scene: Scene, count: int) -> tuple[Any, Any, Any]:
    """Points, normals and triangles."""
    random = np.random.default_rng(0)
    triangle = random.integers(0, len(scene.triangles), count)
    b = random.dirichlet([1.0, 1.0, 1.0], count)
    return np.einsum("pk,pkc->pc", b, scene.triangles[triangle]), scene.normals[triangle], triangle


def test_few_lights_bring_in_the_mean_what_all_do() -> None:
    scene = hall(40)
    light = DirectLight(scene)
    points, normals, triangle = on_triangles(scene, 64)
    every = light.at(points, normals, triangle)
    # Rows of points beside, so that worth and light differ: some lights are hidden from one and not from the other.
    beside = 0.8 * points + 0.2 * scene.triangles[triangle].mean(axis=1)
    choice = light.choice(beside, normals, triangle, np.full(64, 0.5))
    assert choice is not None
    found = [
        light.estimate(points, normals, triangle, np.random.default_rng(i), chosen=Chosen(choice, np.arange(64)))
        for i in range(600)
    ]
    error = np.std(found, axis=0) / np.sqrt(len(found))
    assert np.mean(found) == pytest.approx(every.mean(), rel=0.01)
    assert (np.abs(np.mean(found, axis=0) - every) < 5 * error + 1e-12).all()


def test_the_chances_are_those_that_samples_count_by() -> None:
    brings = np.array([[0.0, 1.0, 3.0], [0.0, 0.0, 0.0]])
    may_bring = np.array([[2.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    choice = LightChoice.of(brings, may_bring)
    rows = np.repeat([0, 1], 40_000)
    drawn, counts = choice.draw(rows, np.random.default_rng(0))
    alike = 0.05 / 3
    for row, expected in (
        (0, [0.175 + alike, 0.15 + 0.0875 + alike, 0.45 + 0.0875 + alike]),
        (1, [1 / 3] * 3),
    ):
        lights = drawn[rows == row].ravel()
        np.testing.assert_allclose(np.bincount(lights, minlength=3) / len(lights), expected, rtol=0.03)
        each = [counts[rows == row].ravel()[lights == i].mean() for i in range(3)]
        np.testing.assert_allclose(each, 0.25 / np.array(expected), rtol=1e-9)


def test_of_too_many_chances_all_points_have_the_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(light_choice, "_MAX_CHANCES", 8)
    choice = LightChoice.of(np.eye(3), np.ones((3, 3)))
    drawn, counts = choice.draw(np.array([0, 1, 2]), np.random.default_rng(0))
    assert drawn.shape == (3, 4)
    np.testing.assert_allclose(counts, 0.75)


@pytest.mark.parametrize("limit", [8, 1 << 22])
def test_choices_made_in_parts_are_those_of_all_points(monkeypatch: pytest.MonkeyPatch, limit: int) -> None:
    monkeypatch.setattr(light_choice, "_MAX_CHANCES", limit)
    light = DirectLight(hall(40))
    points, normals, triangle = on_triangles(light.scene, 64)
    brings = [light._of_light(each, points, normals, triangle).mean(axis=1) for each in light.lighting.punctual]
    may_bring = light._mixed.bounds(points, normals, np.full(64, 0.5))
    monkeypatch.setattr("glpath.radiosity.form_factors.lights._TOGETHER", 24)
    monkeypatch.setattr("glpath.radiosity.form_factors.lights._BOUNDS_TOGETHER", 400)
    found = light.choice(points, normals, triangle, np.full(64, 0.5))
    assert found is not None
    np.testing.assert_allclose(found.edges, LightChoice.of(np.stack(brings, axis=1), may_bring).edges, rtol=1e-12)


def test_memory_of_a_choice_does_not_grow_with_points_times_lights(monkeypatch: pytest.MonkeyPatch) -> None:
    """The vectors between all points and all lights took 118 MB."""
    monkeypatch.setattr(light_choice, "_MAX_CHANCES", 1 << 20)
    light = DirectLight(hall(200))
    points, normals, triangle = on_triangles(light.scene, 8192)
    monkeypatch.setattr(light, "_of_light", lambda each, at, *_: np.ones((len(at), 3)))
    tracemalloc.start()
    light.choice(points, normals, triangle, np.full(8192, 0.5))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


def test_the_choice_of_lights_ends_at_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    light, clock = DirectLight(hall(40)), Clock(monkeypatch)
    with limited(1.0):
        clock.ahead = 2.5
        with pytest.raises(TimeLimitError, match="over while finding the light of each lamp, before"):
            light.choice(*on_triangles(light.scene, 8), np.ones(8))


@pytest.mark.parametrize("sky", [None, uniform_sky()])
def test_direct_light_of_elements_ends_at_the_time_limit(sky: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, clock = replace(hall(4), sky=sky), Clock(monkeypatch)
    elements = Elements.of_lattices(np.ones(len(scene.triangles), np.int64))
    sides = Sides.of(scene, elements)
    points = scene.triangles.mean(axis=1)[sides.element]
    with limited(1.0):
        clock.ahead = 2.5
        with pytest.raises(TimeLimitError, match="over while finding the direct light, before"):
            DirectLight(scene).of_sides(sides, sides.element, points, np.arange(len(sides)), 1)


@pytest.mark.parametrize("for_camera", [True, False])
def test_a_solution_of_many_lights_is_that_of_all(monkeypatch: pytest.MonkeyPatch, for_camera: bool) -> None:
    scene = hall(40)

    def solved(seed: int) -> Any:
        return (
            solve_radiosity(
                scene, method="monte-carlo", patches=60, particles=1 << 17, for_camera=for_camera, seed=seed
            )
            .elements[INDIRECT]
            .mean()
        )

    few = [solved(seed) for seed in range(3)]
    monkeypatch.setattr("glpath.radiosity.form_factors.lights.MANY", 1 << 30)
    every = [solved(seed) for seed in range(3)]
    assert np.mean(few) == pytest.approx(np.mean(every), rel=4e-3)
    assert not np.array_equal(few, every)


def test_few_lights_are_all_looked_at() -> None:
    scene = hall(MANY - 1)
    assert DirectLight(scene).choice(*on_triangles(scene, 8), np.ones(8)) is None
