"""Irradiance by an environment map, at points: beside the sum over all directions, and beside many rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glpath.radiosity.form_factors import lights
from glpath.radiosity.form_factors.lights import DirectLight
from glpath.scene.model import Environment, Float64, Scene
from tests.support.rooms import part, rectangle, room

FLOOR = part(rectangle((-1, -1, 0), (2, 0, 0), (0, 2, 0)), 0.5)
SCREEN = part(rectangle((-1, 0.2, 0), (2, 0, 0), (0, 0, 1)), 0.5)
UP = np.array([0.0, 0.0, 1.0])


def outdoors() -> Environment:
    """Unlike anywhere, with a texel that sends half of all light."""
    image = np.random.default_rng(2).uniform(0.0, 1.0, (16, 32, 3)).astype(np.float32)
    image[3, 7] = [300.0, 250.0, 200.0]
    return Environment(image, UP, 20.0)


def under_the_map(*shapes: object) -> DirectLight:
    scene: Scene = replace(room(*shapes), lights=(), sky=outdoors())
    return DirectLight(scene)


def summed() -> Float64:
    """(3,) irradiance of what sees half of the map, direction by direction."""
    cosine = (np.arange(1500) + 0.5) / 1500
    phi = (np.arange(3000) + 0.5) / 3000 * 2 * np.pi
    z, phi = np.meshgrid(cosine, phi, indexing="ij")
    r = np.sqrt(1 - z * z)
    radiance = outdoors().radiance(np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1))
    return np.asarray((z[..., None] * radiance).mean(axis=(0, 1)) * 2 * np.pi)


@pytest.mark.parametrize("points", [100, 5000])
def test_the_mean_is_the_sum_over_all_directions(points: int) -> None:
    """Whether each point draws its own directions, or chooses from what many share."""
    at = np.random.default_rng(3).uniform(-0.9, 0.9, (points, 3)) * [1, 1, 0]
    found = under_the_map(FLOOR).at(at, np.broadcast_to(UP, at.shape), np.zeros(points, np.int64))
    error = found.std(axis=0, ddof=1) / points**0.5
    true = summed()
    assert np.all(error < 0.005 * true)
    np.testing.assert_allclose(found.mean(axis=0), true, atol=0.0, rtol=0.004)


def test_a_point_is_no_noisier_for_what_it_shares(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before a screen, which hides half of the map."""
    light = under_the_map(FLOOR, SCREEN)
    at = np.broadcast_to([0.1, 0.0, 0.0], (4000, 3))
    sees = at, np.broadcast_to(UP, at.shape), np.zeros(len(at), np.int64)
    shared = light.at(*sees)
    monkeypatch.setattr(lights, "_DRAWN", 1 << 30)
    own = light.at(*sees)
    assert np.all(shared.std(axis=0) < 1.1 * own.std(axis=0))
    # What points share is an error of all of them, and as small as that of their mean without it.
    error = 2.0 * own.std(axis=0) / len(at) ** 0.5
    assert np.all(np.abs(shared.mean(axis=0) - own.mean(axis=0)) < 3 * error)
    assert np.all(own.mean(axis=0) < 0.8 * summed())
