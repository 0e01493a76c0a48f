"""Errors of pixels are nearly independent, although paths of a set share light samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import glpath
from glpath.film.noise import standard_error
from glpath.scene.model import Environment, Scene, Sky

SEEDS = 10
RESOLUTION = (128, 96)


def environment() -> Environment:
    """Return a smooth coloured map with two small bright lamps."""
    v, u = np.mgrid[0:64, 0:128] / 64.0
    image = np.stack([1 + np.sin(np.pi * u), 1 + np.cos(np.pi * (u + v)), 2 - v], axis=-1).astype(np.float32)
    image[12:15, 30:34] = 900.0, 700.0, 400.0
    image[20:24, 90:96] = 100.0, 200.0, 400.0
    return Environment(image)


SKIES = {
    "map": environment(),
    "gradient": Sky(zenith=np.array([0.2, 0.4, 1.0]), horizon=np.array([1.0, 1.0, 0.9])),
}


def ball_on_a_floor(sky: Environment | Sky) -> Scene:
    floor = {"type": "quad", "corners": [[-50, 0, -50], [-50, 0, 50], [50, 0, 50], [50, 0, -50]]}
    ball = {"type": "sphere", "center": [0, 1, 0], "radius": 1}
    scene = glpath.load_scene(
        {
            "camera": {"position": [0, 3, 8], "target": [0, 0, 0], "fov": 40},
            "film": {"resolution": RESOLUTION},
            "materials": {"grey": {"type": "diffuse", "reflectance": 0.5}},
            "sky": {"zenith": [1, 1, 1], "horizon": [1, 1, 1]},
            "shapes": [{**shape, "material": "grey"} for shape in (floor, ball)],
        }
    )
    return replace(scene, sky=sky)


@pytest.mark.parametrize("sky", SKIES)
def test_the_image_mean_scatters_little_more_than_with_independent_pixels(sky: str) -> None:
    """Eight lanes share the numbers of their directions, which alone allows a factor of sqrt(8) = 2.8.

    With 16 light samples for a path set, the factors were 23 and 8.
    """
    scene = ball_on_a_floor(SKIES[sky])
    images = np.array(
        [glpath.render(scene, integrator="path", spp=16, seed=seed).mean.mean(axis=-1) for seed in range(SEEDS)]
    )
    independent = np.sqrt(images.var(axis=0, ddof=1).sum()) / images[0].size
    assert images.mean(axis=(1, 2)).std(ddof=1) < 5.0 * independent


def test_the_error_bar_of_the_image_mean_is_not_too_small() -> None:
    """The mean scatters over seeds by less than its error bar; with uneven light samples by 1.4 error bars."""
    scene = ball_on_a_floor(SKIES["map"]).with_camera(resolution=(32, 24))
    means, errors = [], []
    for seed in range(SEEDS):
        film = glpath.render(scene, integrator="path", spp=256, seed=seed)
        means.append(film.mean.mean())
        errors.append(standard_error(film.radiance_sums.mean(axis=(1, 2, 3)), film.batch_counts))
    assert np.std(means, ddof=1) < np.sqrt(np.mean(np.square(errors)))
