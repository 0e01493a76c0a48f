"""Many punctual lights at once: what each sends alone, and what that is at most."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from glpath.lights.mixed import MixedLights
from glpath.lights.samples import incident
from tests.lights.test_light_tree import floor, lamps

SUN = {"type": "directional", "direction": [0.3, -1, 0.2], "irradiance": [1.0, 0.5, 2.0]}
SHARP = {"type": "spot", "position": [0, 2, 0], "target": [1, 0, 0], "intensity": 3.0, "cone": [30, 30]}


def test_each_of_many_lights_is_as_it_is_alone(tmp_path: Path) -> None:
    lights = floor([*lamps(tmp_path), SUN, SHARP]).lights
    random = np.random.default_rng(1)
    which = random.integers(0, len(lights), 4000)
    at = random.uniform([-4, -1, -3], [4, 4, 3], (4000, 3))
    found = MixedLights.of(lights).incident(which, at)
    for number, light in enumerate(lights):
        some = which == number
        assert some.sum() > 50
        alone = incident(light, at[some])
        np.testing.assert_allclose(found.wi[some], alone.wi, atol=1e-12)
        np.testing.assert_allclose(found.distance[some], alone.distance)
        np.testing.assert_allclose(found.irradiance[some], alone.irradiance, rtol=1e-9, atol=1e-12)


def test_no_point_nearby_gets_more_than_the_bound(tmp_path: Path) -> None:
    """Of flat surfaces that no light is nearer to than their own size."""
    lights = floor([*lamps(tmp_path), SUN, SHARP]).lights
    mixed, random = MixedLights.of(lights), np.random.default_rng(2)
    middle = random.uniform([-4, -1, -3], [4, -0.5, 3], (50, 3))
    normal = random.normal(size=(50, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius = np.full(50, 0.2)
    # Within a radius the square of the distance is larger by a third at most.
    bound = 1.5 * mixed.bounds(middle, normal, radius)
    across = np.cross(normal, np.roll(normal, 1, axis=1))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    seen = 0
    for number, light in enumerate(lights):
        for step in (-0.2, 0.0, 0.2):
            there = incident(light, middle + step * across)
            found = np.maximum((there.wi * normal).sum(axis=1), 0.0) * there.irradiance.mean(axis=1)
            assert (found <= bound[:, number] + 1e-12).all()
            seen += int((found > 0.5 * bound[:, number]).sum())
    assert seen > 50
