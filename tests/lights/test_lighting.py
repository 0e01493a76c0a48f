"""Light samples: that they are unbiased, and as dense as they say; what punctual lights send, by closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from glpath.io import scene_from_dict
from glpath.lights.lighting import Lighting, max_radiance, sky_radiance
from glpath.sampling.points import uniform_sphere
from glpath.scene import Scene
from glpath.scene.spot_cone import spot_fade, spot_solid_angle

QUAD: dict[str, Any] = {"type": "quad", "corners": [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]}
UP = np.array([[0.0, 1.0, 0.0]])


def scene_of(*shapes: dict[str, Any], **tables: Any) -> Scene:
    camera = {"type": "perspective", "position": [0, 5, 9], "target": [0, 0, 0], "fov": 40}
    return scene_from_dict({"camera": camera, "shapes": list(shapes or (QUAD,)), **tables})


def samples(lighting: Lighting, count: int = 20_000) -> list[Any]:
    return [lighting.sample(u) for u in np.random.default_rng(1).random((count, 3))]


def test_light_points_are_chosen_half_by_power_and_lie_uniformly_on_their_emitter() -> None:
    """A weak large lamp, a strong small one, and a two-sided one, of which each side counts."""

    def lamp(x: float, size: float, radiance: float, two_sided: bool = False) -> dict[str, Any]:
        corners = [[x, 0, 0], [x + size, 0, 0], [x + size, 0, -size], [x, 0, -size]]
        return {"type": "quad", "corners": corners, "emission": {"radiance": radiance, "two_sided": two_sided}}

    points = samples(Lighting.of(scene_of(lamp(0, 2, 1), lamp(10, 1, 8), lamp(20, 1, 2, True))))
    assert {p.kind for p in points} == {"area"}
    x = np.array([p.position[0] for p in points])
    # Powers: 4 x 1, 1 x 8, and twice 1 x 2; and the four sides alike.
    np.testing.assert_allclose(
        [np.mean(x < 5), np.mean((x > 5) & (x < 15)), np.mean(x > 15)], [0.25, 0.375, 0.375], atol=0.015
    )
    assert all(p.density == pytest.approx(0.25 / 4) for p in points[:100] if p.position[0] < 5)
    sides = [p.direction[1] for p in points if p.position[0] > 15]
    assert np.mean(sides) == pytest.approx(0.0, abs=0.05)
    on_small = np.array([p.position for p in points if 5 < p.position[0] < 15]) - [10, 0, -1]
    counts, _, _ = np.histogram2d(on_small[:, 0], on_small[:, 2], bins=4, range=[[0, 1], [0, 1]])
    np.testing.assert_allclose(counts / counts.sum(), 1 / 16, atol=0.012)
    # Unbiased: radiance over density averages to the total of area times radiance, sides counted.
    assert np.mean([p.radiance[0] / p.density for p in points]) == pytest.approx(4 + 8 + 4, rel=0.01)


@pytest.mark.parametrize(
    ("transform", "area"),
    [
        ([], 4 * np.pi * 0.25),
        # A prolate spheroid, half axes 0.5, 0.5, 1.
        ([{"scale": [1, 1, 2]}], 2 * np.pi * 0.25 * (1 + 2 / np.sqrt(0.75) * np.arcsin(np.sqrt(0.75)))),
    ],
)
def test_points_of_a_shining_sphere_are_as_dense_as_its_surface(transform: list[Any], area: float) -> None:
    ball = {"type": "sphere", "radius": 0.5, "emission": {"radiance": 3.0}, "transform": transform}
    points = samples(Lighting.of(scene_of(QUAD, ball)))
    assert np.mean([1 / p.density for p in points]) == pytest.approx(area, rel=0.01)
    # Normals point outwards: Gauss, the flux of x through the surface is three volumes.
    flux = np.mean([p.position @ p.direction / p.density for p in points])
    assert flux == pytest.approx(4 * np.pi * 0.125 * (2 if transform else 1), rel=0.01)


def test_all_kinds_of_light_are_chosen_by_the_power_that_reaches_the_scene_and_alike() -> None:
    """Half by the one, half by the other. The quad's sphere has the radius sqrt(2)."""
    lights = [
        {"type": "point", "position": [0, 1, 0], "intensity": 2.0},
        {"type": "spot", "position": [0, 1, 0], "target": [0, 0, 0], "intensity": 4.0, "cone": [60, 90]},
        {"type": "directional", "direction": [0, -1, 0], "irradiance": 1.5},
        {"type": "point", "position": [0, 100, 0], "intensity": 1e4},
        {"type": "point", "position": [0, 1, 0], "intensity": 0.0},
    ]
    lamp = QUAD | {"emission": {"radiance": 0.7}}
    lighting = Lighting.of(scene_of(lamp, lights=lights, sky={"zenith": 0.6, "horizon": 0.2}))
    power = [
        4 * 0.7,
        4 * 2.0,
        4 * 4.0 * 2 * np.pi * (2 / 3) / (4 * np.pi),
        1.5 * 2,
        1e4 * 2 / 1e4,
        2 * np.pi * 0.6 * 2,
    ]
    np.testing.assert_allclose(np.diff(lighting.cdf), 0.5 * np.array(power) / sum(power) + 0.5 / 6, rtol=1e-3)
    assert lighting.infinite
    assert [x.kind for x in Lighting.of(lighting.scene, punctual=False).punctual] == []
    kinds = {p.kind for p in samples(lighting, 500)}
    assert kinds == {"area", "point", "spot", "directional", "sky"}


@pytest.mark.parametrize(("zenith", "horizon"), [(1.0, 1.0), (2.0, 0.5), (0.0, 1.0), (1.0, 0.0)])
def test_the_sky_is_sampled_by_its_radiance(zenith: float, horizon: float) -> None:
    up = np.array([0.6, 0.0, 0.8])
    scene = scene_of(sky={"zenith": [zenith, zenith, 3 * zenith], "horizon": horizon, "up": up.tolist()})
    lighting = Lighting.of(scene)
    drawn = samples(lighting, 5000)
    wi = -np.array([p.direction for p in drawn])
    density = np.array([p.density for p in drawn])
    np.testing.assert_allclose(np.linalg.norm(wi, axis=1), 1.0)
    np.testing.assert_allclose(lighting.sky_density(wi), density)
    np.testing.assert_allclose([p.radiance for p in drawn], sky_radiance(scene.sky, wi))
    # The density sums to one over all directions, and the samples follow it.
    directions = uniform_sphere(np.random.default_rng(2).random((200_000, 2)))
    uniform = lighting.sky_density(directions)
    assert 4 * np.pi * uniform.mean() == pytest.approx(1.0, rel=0.01)
    bins = np.linspace(-1, 1, 9)
    expected, _ = np.histogram(directions @ up, bins, weights=uniform * 4 * np.pi / len(directions))
    found, _ = np.histogram(wi @ up, bins)
    np.testing.assert_allclose(found / len(wi), expected, atol=0.02)
    # About up there is no preferred direction.
    assert np.linalg.norm((wi - np.outer(wi @ up, up)).mean(axis=0)) < 0.04


def test_irradiance_of_punctual_lights_by_their_closed_forms() -> None:
    lights = [
        {"type": "point", "position": [0, 2, 0], "intensity": [8.0, 4.0, 0.0]},
        {"type": "directional", "direction": [0.6, -0.8, 0], "irradiance": 5.0},
        {"type": "point", "position": [0, 2, 0], "intensity": 3.0, "falloff": "none"},
    ]
    x = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
    one_by_one = [Lighting.of(scene_of(lights=[light])).irradiance(x, np.repeat(UP, 2, axis=0)) for light in lights]
    np.testing.assert_allclose(one_by_one[0], np.outer([1 / 4, 2 / 2.5**3], [8.0, 4.0, 0.0]))
    np.testing.assert_allclose(one_by_one[1], 4.0)
    np.testing.assert_allclose(one_by_one[2], [[3.0] * 3, [3.0 * 2 / 2.5] * 3])
    everything = Lighting.of(scene_of(lights=lights))
    np.testing.assert_allclose(everything.irradiance(x, np.repeat(UP, 2, axis=0)), sum(one_by_one))
    assert not everything.irradiance(x, -np.repeat(UP, 2, axis=0)).any()


def test_a_spot_fades_as_gltf_defines_it() -> None:
    """The reference code of KHR_lights_punctual squares the share of the cosine between the two cones."""
    spot = {"type": "spot", "position": [0, 1, 0], "target": [0, 0, 0], "intensity": 1.0, "cone": [30, 60]}
    lighting = Lighting.of(scene_of(lights=[spot]))
    angles = np.radians([0, 29.9, np.degrees(np.arccos(np.cos(np.radians([30, 60])).mean())), 60.1, 80])
    x = np.stack([np.tan(angles), np.zeros(5), np.zeros(5)], axis=1)
    found = lighting.irradiance(x, np.repeat(UP, 5, axis=0))[:, 0] / np.cos(angles) ** 3
    np.testing.assert_allclose(found, [1, 1, 0.25, 0, 0], atol=1e-12)


@pytest.mark.parametrize("cone", [(10.0, 35.0), (20.0, 20.0), (0.0, 170.0)])
def test_the_solid_angle_of_a_spot_is_the_integral_of_its_fade(cone: tuple[float, float]) -> None:
    cosine = (np.arange(200_000) + 0.5) / 100_000 - 1.0
    full, end = np.cos(np.radians(cone))
    integral = 2 * np.pi * 2 * spot_fade(cosine, full, end).mean()
    assert spot_solid_angle(cone) == pytest.approx(integral, rel=1e-4)


def test_a_scene_without_light_says_so() -> None:
    lighting = Lighting.of(scene_of(sky={"zenith": 0.0}))
    assert lighting.dark
    assert not lighting.infinite
    assert not lighting.sky_density(UP).any()
    assert not sky_radiance(None, UP).any()


def test_the_brightest_of_a_point_light_is_what_it_makes_of_white_at_a_typical_distance() -> None:
    lights = [{"type": "point", "position": [0, 3, 0], "intensity": 9.0}]
    assert max_radiance(scene_of(lights=lights)) == pytest.approx(1 / np.pi)
    assert max_radiance(scene_of(lights=lights, ambient=[0.1, 0.9, 0.2])) == 0.9
