"""The bias of reflected daylight: by closed forms and by another engine, and what follows from a large bias."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.apps.daylight.bias import bias_of_solution, walk_to_sky
from glpath.apps.daylight.bounces import ReflectingSides, Reflections
from glpath.apps.daylight.coefficients import DaylightCoefficients
from glpath.apps.daylight.compute import daylight_coefficients
from glpath.io import scene_from_dict
from glpath.scene import path_traceable


def scene_of(*shapes: dict[str, Any], reflectance: float = 0.5, **material: Any) -> glpath.Scene:
    camera = {"position": [0, 1, 4], "target": [0, 1, 0], "fov": 60}
    materials = {"grey": {"reflectance": reflectance, **material}}
    return scene_from_dict({"camera": camera, "materials": materials, "shapes": list(shapes)})


def quad(*corners: tuple[float, float, float]) -> dict[str, Any]:
    return {"type": "quad", "corners": [list(corner) for corner in corners], "material": "grey"}


GROUND = quad((-900, 0, 900), (900, 0, 900), (900, 0, -900), (-900, 0, -900))


def reflected(scene: glpath.Scene, point: list[float], normal: list[float], reflections: int = 500) -> float:
    """Irradiance by reflected light of a sky and a ground of radiance 1 / pi."""
    sides = ReflectingSides(path_traceable(scene), 10)
    receivers = np.array([point], float), np.array([normal], float), "plane"
    return float(walk_to_sky(sides, receivers, 1 << 16, 0, np.zeros(1, np.int64), reflections).mean() / np.pi)


def test_a_sensor_above_a_wide_ground_gets_its_reflectance() -> None:
    assert reflected(scene_of(GROUND, reflectance=0.3), [0, 1, 0], [0, -1, 0]) == pytest.approx(0.3, abs=0.006)
    assert reflected(scene_of(GROUND, reflectance=0.3), [0, 1, 0], [0, 1, 0]) == 0.0


def test_between_two_wide_plates_light_is_reflected_as_often_as_allowed() -> None:
    """Of a slot between large parallel plates, rays leave at the far edges alone."""
    near = scene_of(GROUND, quad((-900, 2, -900), (900, 2, -900), (900, 2, 900), (-900, 2, 900)))
    assert reflected(near, [0, 1, 0], [0, 1, 0]) < 0.01


def test_paths_end_after_the_reflections_that_are_allowed() -> None:
    """In an open corner of two quads some light comes after two reflections."""
    wall = quad((-900, 0, -1), (900, 0, -1), (900, 900, -1), (-900, 900, -1))
    corner = scene_of(GROUND, wall)
    one, two, every = (reflected(corner, [0, 1, 0], [0, -1, 0], count) for count in (1, 2, 500))
    assert one < two < every < 0.5


def shaded_room() -> dict[str, Any]:
    """A room without a left wall, behind a sheet that is open above."""
    walls = [
        quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)),
        quad((-1, 2, -1), (1, 2, -1), (1, 2, 1), (-1, 2, 1)),
        quad((-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1)),
        quad((1, 0, 1), (-1, 0, 1), (-1, 2, 1), (1, 2, 1)),
        quad((1, 0, -1), (1, 0, 1), (1, 2, 1), (1, 2, -1)),
        quad((-0.9, 0.0, -1), (-0.9, 0.0, 1), (-0.9, 1.6, 1), (-0.9, 1.6, -1)),
    ]
    materials = {"grey": {"reflectance": 0.6}}
    return {"camera": {"position": [0, 1, 0.9], "target": [0, 1, 0]}, "materials": materials, "shapes": walls}


def sensors() -> tuple[np.ndarray, list[float]]:
    x, z = np.meshgrid(np.linspace(-0.7, 0.8, 8), np.linspace(-0.8, 0.8, 8))
    return np.stack([x.ravel(), np.full(64, 0.5), z.ravel()], axis=1), [0.0, 1.0, 0.0]


def witness_at_sensors(scene: dict[str, Any]) -> float:
    points, normal = sensors()
    white = scene | {"sky": {"zenith": 1.0, "horizon": 1.0}}
    return float(glpath.irradiance(white, points, normal, integrator="path", spp=1024).values.mean())


def test_the_bias_is_the_difference_to_paths_and_a_large_one_warns() -> None:
    points, normal = sensors()
    with pytest.warns(glpath.SceneWarning, match="bias of the reflected light .* more than 60 elements"):
        coarse = daylight_coefficients(shaded_room(), points, normal, samples=32, elements=60)
    off = coarse.sky_sums.mean() / witness_at_sensors(shaded_room()) - 1
    assert off > 0.1
    assert coarse.indirect is not None
    assert coarse.indirect.bias is not None
    # The bias and the 32 samples of each sensor have about 2 % of noise each.
    assert coarse.indirect.bias.mean == pytest.approx(off, abs=0.06)


def test_a_filter_that_raises_the_warning_about_a_bias_leaves_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.apps.daylight.bias.Bias.is_large", lambda *_: True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(glpath.SceneWarning, match="bias of the reflected light") as caught:
            daylight_coefficients(scene_of(GROUND), [[0, 1, 0]], [0, 1, 0], samples=2, elements=2, gather_rays=16)
    assert len(caught.value.result) == 1
    assert caught.value.result.indirect is not None


def test_by_default_elements_are_refined_if_their_bias_is_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    points, normal = sensors()
    bright = shaded_room()
    del bright["shapes"][-1]
    monkeypatch.setattr("glpath.apps.daylight.compute.DEFAULT_ELEMENTS", 10)
    monkeypatch.setattr("glpath.apps.daylight.compute.REFINED", 200)
    found = daylight_coefficients(bright, points, normal, samples=32)
    assert found.indirect is not None
    assert found.indirect.bias is not None
    assert found.indirect.bias.is_small()
    assert found.sky_sums.mean() == pytest.approx(witness_at_sensors(bright), rel=0.015)
    monkeypatch.setattr("glpath.apps.daylight.compute.REFINED", 1)
    with pytest.warns(glpath.SceneWarning, match="more than 10 elements"):
        daylight_coefficients(bright, points, normal, samples=4)


def test_the_bias_is_kept_in_files_and_by_merging(tmp_path) -> None:
    points, normal = sensors()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", glpath.SceneWarning)
        parts = [
            daylight_coefficients(
                shaded_room(), points, normal, samples=4, elements=60, gather_rays=128, shard=(k, 2)
            )
            for k in (1, 2)
        ]
    from glpath.apps.daylight.merging import together

    biases = [part.indirect.bias for part in parts]
    assert biases[0] == biases[1]
    whole = together(parts)
    whole.save(tmp_path / "a.npz")
    assert DaylightCoefficients.load(tmp_path / "a.npz").indirect.bias == biases[0]


def test_a_bias_of_few_sensors_is_measured_too() -> None:
    scene = path_traceable(scene_of(GROUND))
    sides = ReflectingSides(scene, 10)
    receivers = np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, -1.0, 0.0]]), "plane"
    bias = bias_of_solution(sides, Reflections(sides, None, 0), receivers, 1)
    assert abs(bias.mean) < 0.05


def test_standard_errors_are_those_of_the_rays_of_reflected_light() -> None:
    """Above half of a ground, a sensor that looks down has reflected light alone."""
    half = scene_of(quad((-900, 0, 900), (0, 0, 900), (0, 0, -900), (-900, 0, -900)))
    options: dict[str, Any] = {"samples": 4, "elements": 10, "gather_rays": 128}
    found = [daylight_coefficients(half, [[0, 1, 0]], [0, -1, 0], seed=seed, **options) for seed in range(12)]
    spread = np.std([each.sky_sums[0] for each in found], ddof=1)
    told = np.mean([each.standard_errors[0] for each in found])
    assert 0.5 * spread < told < 3 * spread
