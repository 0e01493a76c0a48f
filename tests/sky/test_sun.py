"""The sun's disc: its own light, its share of a sky, and the penumbra that it casts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import glpath
from glpath.errors import SceneError, SceneWarning
from glpath.sky.perez import Daylight, PerezSky
from glpath.sky.sky import Environment
from glpath.sky.sun import Sun

UP = np.array([0.0, 0.0, 1.0])
BLACK = np.zeros((2, 4, 3), np.float32)


def sun_at(altitude: float, irradiance: float = 100.0, diameter: float = 0.533) -> Sun:
    a = np.radians(altitude)
    return Sun(np.array([0.6 * np.cos(a), 0.8 * np.cos(a), np.sin(a)]), np.full(3, irradiance), diameter)


@pytest.mark.parametrize("diameter", [0.533, 5.0, 60.0])
def test_directions_are_even_over_the_disc(diameter: float) -> None:
    sun = sun_at(50, diameter=diameter)
    u = (np.stack(np.meshgrid(np.arange(64), np.arange(64)), -1).reshape(-1, 2) + 0.5) / 64
    wi = sun.directions(u)
    np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1)
    half = np.radians(diameter / 2)
    # Uniform by solid angle, the cosine to the axis is even between that of the rim and one.
    assert np.mean(wi @ sun.direction) == pytest.approx((1 + np.cos(half)) / 2, rel=1e-6)
    assert (sun.radiance(wi)[:, 0] > 0).all()
    aside = np.cross(sun.direction, UP) / np.linalg.norm(np.cross(sun.direction, UP))
    assert not sun.radiance(sun.direction * np.cos(1.01 * half) + aside * np.sin(1.01 * half)).any()
    # What a surface that faces it has.
    facing = float((sun.radiance(wi)[:, 0] * (wi @ sun.direction)).mean() * sun.solid_angle)
    assert facing == pytest.approx(100.0, rel=1e-4)


def test_sky_is_as_dense_as_map_and_sun_together() -> None:
    sky = Daylight(PerezSky.of(700, 120, 40), sun_at(40).direction, 700.0, 120.0, 0.2).environment(UP)
    u = np.random.default_rng(0).random((20_000, 3))
    wi = sky.directions(u)
    within = sky.sun.radiance(wi)[:, 0] > 0  # type: ignore[union-attr]
    assert within.mean() == pytest.approx(sky.sun_share, abs=0.01)
    # f over its density is the integral, whatever is asked for: of the cosine to the ground, the irradiance.
    pdf = sky.radiance(wi).mean(axis=1) / sky.mean_integral
    value = sky.radiance(wi)[:, 0] * np.maximum(wi[:, 2], 0) / pdf
    expected = 700 * np.sin(np.radians(40)) + 120
    assert abs(value.mean() - expected) < 4 * value.std() / np.sqrt(len(value)) + 1e-3 * expected
    assert sky.split == sky.sun_share
    assert replace(sky, sun=None).digest != sky.digest


def test_wrong_suns_are_refused() -> None:
    for wrong in ({"diameter": 0.0}, {"diameter": 200.0}, {"irradiance": -np.ones(3)}, {"direction": np.ones(3)}):
        with pytest.raises(SceneError, match="Sun"):
            replace(sun_at(30), **wrong)


def half_covered(sun: Sun) -> glpath.Scene:
    """White ground under the edge of a black roof one unit above it, and nothing but the sun."""
    scene = glpath.load_scene({
        "camera": {"position": [0, -3, 0.5], "target": [0, 0, 0], "up": [0, 0, 1]},
        "materials": {"black": {"reflectance": 0.0}},
        "shapes": [
            {"type": "quad", "corners": [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], "material": "black"},
            {"type": "quad", "corners": [[-9, -9, 1], [0, -9, 1], [0, 9, 1], [-9, 9, 1]], "material": "black"},
        ],
        "sky": {"zenith": 1.0},
    })  # fmt: skip
    return replace(scene, sky=Environment(BLACK, UP, sun=sun))


@pytest.mark.parametrize("integrator", ["path", "path-buffer"])
def test_penumbra_is_the_part_of_the_disc_that_is_seen(integrator: str) -> None:
    """Under a straight edge: the part of a disc beyond a chord."""
    sun = Sun(UP, np.full(3, 100.0), 4.0)
    offset = np.array([-0.9, -0.5, 0.0, 0.5, 0.9])
    half = np.radians(2.0)
    x = offset * np.tan(half)
    points = np.stack([x, np.zeros(5), np.zeros(5)], axis=1)
    found = glpath.irradiance(half_covered(sun), points, UP, integrator=integrator, spp=512, max_depth=1)
    share = 0.5 + (offset * np.sqrt(1 - offset**2) + np.arcsin(offset)) / np.pi
    values, errors = found.values[:, 0], found.standard_errors[:, 0]
    assert (np.abs(values - 100 * share) < 4 * errors + 0.5).all(), (values, 100 * share, errors)


@pytest.mark.parametrize("integrator", ["path", "path-buffer", "gather", "classic", "t-buffer"])
def test_every_integrator_has_the_light_of_sky_and_sun(integrator: str) -> None:
    """On open ground, which reflects nothing to itself."""
    sky = {"type": "perez", "direct": 700, "diffuse": 120, "altitude": 40, "azimuth": 200, "spectrum": "solar"}
    scene = glpath.load_scene({
        "camera": {"position": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 20},
        "film": {"resolution": [8, 8]},
        "materials": {"grey": {"reflectance": 0.5}},
        "shapes": [
            {"type": "quad", "corners": [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], "material": "grey"}
        ],
        "sky": {**sky, "up": [0, 0, 1], "ground": 0},
    })  # fmt: skip
    film = glpath.render(scene, integrator=integrator, spp=256 if integrator == "path-buffer" else 64)
    expected = 0.5 * (700 * np.sin(np.radians(40)) + 120) / np.pi
    assert film.mean.mean() == pytest.approx(expected, rel=0.06 if integrator == "path-buffer" else 0.03)


def test_the_eye_sees_the_disc() -> None:
    scene = half_covered(sun_at(40, diameter=8.0))
    sun = scene.sky.sun  # type: ignore[union-attr]
    camera = replace(
        scene.camera, position=np.array([3.0, 0, 3]), target=np.array([3.0, 0, 3]) + sun.direction, fov=12.0,
        resolution=(32, 32),
    )  # fmt: skip
    with pytest.warns(SceneWarning, match="no shape is in view"):
        film = glpath.render(replace(scene, camera=camera), integrator="path", spp=16, max_depth=1)
    # The disc's part of the picture, by its radius on a flat film.
    covered = np.pi * (np.tan(np.radians(4)) / np.tan(np.radians(6))) ** 2 / 4
    assert film.mean[..., 0].mean() == pytest.approx(covered * sun.radiance_of_disc[0], rel=0.02)
