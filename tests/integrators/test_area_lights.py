"""The ray tracers are lit by shapes that emit, by the light points that the path-buffer takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import glpath
from benchmarks.figures.eye_hits import ShownHits
from glpath.compare import relative_mse
from glpath.io import scene_from_dict
from glpath.scene import Scene
from tests.reference.closed_forms import polygon_irradiance

RAY_TRACERS = pytest.mark.parametrize("integrator", ["classic", "t-buffer"])
LAMP = [[1, 1, 0.3], [1, 1, -0.3], [2, 1, -0.3], [2, 1, 0.3]]


def lamp_over_floor(corners: list[list[float]] = LAMP, **emission: Any) -> Scene:
    """A lamp of 1 x 0.6 one unit above a white floor, seen from above and beside."""
    return scene_from_dict(
        {
            "camera": {"position": [-0.5, 3, 0.01], "target": [0, 0, 0], "up": [0, 0, -1], "fov": 20},
            "film": {"resolution": [16, 16]},
            "materials": {"white": {"reflectance": 0.5}},
            "shapes": [
                {"type": "quad", "corners": [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], "material": "white"},
                {"type": "quad", "corners": corners, "emission": {"radiance": 2.0, **emission}},
            ],
        }
    )


@RAY_TRACERS
@pytest.mark.parametrize("samples", [1, 4])
def test_a_floor_has_the_irradiance_of_the_closed_form(integrator: Any, samples: int):
    scene = lamp_over_floor()
    film = glpath.render(scene, integrator=integrator, spp=256 // samples, light_samples=samples, max_depth=1)
    rays = scene.camera.rays()
    floor = scene.camera.position - scene.camera.position[1] / rays[..., 1:2] * rays
    expected = [polygon_irradiance(x, [0, 1, 0], LAMP, 1.0) / np.pi for x in floor.reshape(-1, 3)]
    np.testing.assert_allclose(film.mean[..., 0].ravel(), expected, rtol=0.015)


@RAY_TRACERS
def test_a_lamp_that_faces_away_gives_no_light_unless_both_sides_emit(integrator: Any):
    options: Any = {"integrator": integrator, "spp": 4, "max_depth": 1}
    lit = glpath.render(lamp_over_floor(), **options).mean.mean()
    assert glpath.render(lamp_over_floor(LAMP[::-1]), **options).mean.max() == 0.0
    assert glpath.render(lamp_over_floor(LAMP[::-1], two_sided=True), **options).mean.mean() > 0.5 * lit


@pytest.mark.parametrize(
    ("name", "sets", "path_options"),
    # Of the room's blinds and chair legs, texels of the default see too little: 0.2 % of its light.
    [
        ("cornell-box", 128, {}),
        ("cornell-box", 128, {"integrator": "path-buffer"}),
        pytest.param("room", 512, {}, marks=pytest.mark.evidence),
        pytest.param(
            "room", 384, {"integrator": "path-buffer", "light_resolution": 1024}, marks=pytest.mark.evidence
        ),
    ],
)
def test_engines_agree_on_direct_light(name: str, sets: int, path_options: Any):
    """As near to each other as two renders of either are in the mean; the means within 0.3 %."""
    options: Any = {"max_depth": 1, "resolution": (64, 48)}
    paths = [glpath.render(name, spp=sets, seed=s, **path_options, **options).mean for s in (1, 2)]
    both = [glpath.render(name, integrator="t-buffer", spp=sets // 2, seed=s, **options).mean for s in (3, 4)]
    path, rays = np.mean(paths, axis=0), np.mean(both, axis=0)
    assert relative_mse(rays, path) < 0.5 * (relative_mse(*paths) + relative_mse(*both))
    # A lamp that is seen shines a hundred times as brightly as what it lights, and its edge is antialiased by
    # chance.
    reflecting = ShownHits.of(glpath.load_scene(name).with_camera(resolution=(64, 48))).reflecting
    assert rays[reflecting].mean() == pytest.approx(path[reflecting].mean(), rel=0.003)


def test_classic_and_t_buffer_have_the_same_bits_under_area_lights():
    films = [
        glpath.render("cornell-box", integrator=i, spp=2, resolution=(32, 24)) for i in ("classic", "t-buffer")
    ]
    np.testing.assert_array_equal(films[0].radiance_sums, films[1].radiance_sums)


def test_path_sets_split_anywhere_under_area_lights():
    options: Any = {"integrator": "t-buffer", "resolution": (24, 18)}
    whole = glpath.render("cornell-box", spp=16, **options)
    parts = [glpath.render("cornell-box", spp=8, first_path_set=i, **options) for i in (0, 8)]
    np.testing.assert_array_equal(parts[0].merge(parts[1]).radiance_sums, whole.radiance_sums)


@RAY_TRACERS
def test_a_sphere_that_emits_lights_what_is_around_it(integrator: Any):
    """An exact sphere of radius r lights a plane below its centre like a point of intensity pi r^2 L."""
    scene = scene_from_dict(
        {
            "camera": {"position": [3, 2, 0], "target": [0.5, 0, 0], "fov": 10},
            "film": {"resolution": [12, 12]},
            "materials": {"white": {"reflectance": 0.5}},
            "shapes": [
                {"type": "quad", "corners": [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], "material": "white"},
                {"type": "sphere", "center": [0, 1, 0], "radius": 0.25, "emission": {"radiance": 8.0}},
            ],
        }
    )
    film = glpath.render(scene, integrator=integrator, spp=256, max_depth=1)
    rays = scene.camera.rays()
    floor = scene.camera.position - scene.camera.position[1] / rays[..., 1:2] * rays
    square = 1.0 + floor[..., 0] ** 2 + floor[..., 2] ** 2
    expected = 4.0 * 0.25**2 * np.pi / square**1.5 / np.pi
    np.testing.assert_allclose(film.mean[..., 0], expected, rtol=0.05)
    assert film.mean[..., 0].mean() == pytest.approx(expected.mean(), rel=0.005)


def test_points_around_a_sphere_have_the_irradiance_of_the_closed_form():
    """pi L (r / d)^2 of a surface that faces it; here its triangles stand for it, for paths."""
    scene = scene_from_dict(
        {
            "camera": {"position": [0, 0.5, 4], "target": [0, 0, 0]},
            "shapes": [
                {"type": "quad", "corners": [[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]]},
                {
                    "type": "sphere",
                    "center": [0, 1, 0],
                    "radius": 0.5,
                    "subdivisions": 4,
                    "emission": {"radiance": 2},
                },
            ],
        }
    )
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [2.0, 0.0, -1.0]])
    found = glpath.irradiance(scene, points, (0, 1, 0), spp=4096, max_depth=1).values[:, 0]
    distance = np.linalg.norm(points - [0, 1, 0], axis=1)
    np.testing.assert_allclose(found, np.pi * 2 * (0.5 / distance) ** 2 / distance, rtol=0.015)
