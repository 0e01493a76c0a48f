"""The ground that catches a shadow, by closed forms: a disc above it, under skies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.film.aovs import FAR
from glpath.scene import Background, Environment, Scene, Sky

RADIUS, HEIGHT = 1.0, 0.7
ENGINES: list[dict[str, Any]] = [
    {"integrator": "path", "guide": "cosine"},
    {"integrator": "gather"},
    {"integrator": "classic"},
    {"integrator": "t-buffer", "secondary": "bvh"},
]
#: Of what the middle of the ground sees, the disc is so much by the cosine.
SHADE = RADIUS**2 / (RADIUS**2 + HEIGHT**2)


def disc(sky: Sky | Environment) -> Scene:
    """A disc above the ground, whose middle is in the middle of the picture."""
    angle = 2 * np.pi * np.arange(64) / 64
    rim = np.stack([RADIUS * np.cos(angle), np.full(64, HEIGHT), -RADIUS * np.sin(angle)], axis=1)
    vertices = np.concatenate([[[0.0, HEIGHT, 0.0]], rim])
    faces = np.array([[0, 1 + k, 1 + (k + 1) % 64] for k in range(64)])
    scene = glpath.load_scene({
        "camera": {"position": [0, 2.0, 9.0], "target": [0, 0, 0], "fov": 30},
        "film": {"resolution": [17, 17]},
        "sky": {"zenith": 1.0},
        "shapes": [{"type": "mesh", "vertices": vertices, "faces": faces}],
    })  # fmt: skip
    return replace(scene, sky=sky, background=Background(np.array([0.2, 0.4, 0.8]), ground=np.zeros(3)))


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: str(engine["integrator"]))
@pytest.mark.parametrize("sky", [Sky(np.ones(3), np.ones(3)), Environment(np.ones((32, 64, 3), np.float32))])
def test_the_disc_keeps_off_as_much_light_as_the_ground_sees_of_it(sky: Sky | Environment, engine: dict[str, Any]):
    scene = disc(sky)
    film = glpath.render(scene, spp=512, seed=2, aovs=("depth", "object_id"), **engine)
    colour = scene.background.radiance if scene.background else np.zeros(3)
    assert film.mean[8, 8] == pytest.approx((1 - SHADE) * colour, abs=0.08 * colour.max())
    assert film.mean[0, 0] == pytest.approx(colour, rel=1e-6)
    assert film.aov("depth")[8, 8] == FAR, "it is no surface"
    assert film.aov("object_id")[8, 8] == 0


def test_a_light_from_the_side_throws_the_shadow_to_the_other():
    image = np.zeros((32, 64, 3), np.float32)
    image[8, 48] = 1.0  # 45 degrees up: to the right, where columns grow
    sky = Environment(image)
    above = sky.directions(np.array([[0.5, 0.5, 0.5]]))[0]
    assert above[0] < -0.6, "from -x"
    film = glpath.render(disc(sky), integrator="path", guide="cosine", spp=16, resolution=(65, 65))
    row = film.mean[32, :, 0] / 0.2
    dark = np.flatnonzero(row < 0.5)
    assert len(dark)
    # At the height of 0.7 the shadow's middle is 0.7 from the disc's.
    middle = (dark.mean() - 32) / (65 / (2 * np.hypot(2.0, 9.0) * np.tan(np.radians(15))))
    assert middle == pytest.approx(-HEIGHT * above[0] / above[1], abs=0.12)


def test_what_the_ground_shows_does_not_depend_on_how_it_is_split():
    scene = disc(Environment(np.ones((8, 16, 3), np.float32)))
    options: dict[str, Any] = {"integrator": "path", "guide": "cosine", "resolution": (33, 33)}
    whole = glpath.render(scene, spp=16, **options)
    first, rest = (glpath.render(scene, spp=8, first_path_set=start, **options) for start in (0, 8))
    assert np.array_equal(first.merge(rest).mean, whole.mean)
    crop = glpath.render(scene, spp=16, crop=(9, 12, 11, 13), **options)
    assert np.array_equal(crop.mean, whole.mean[12:25, 9:20])


@pytest.mark.parametrize("engine", [{"integrator": "path-buffer"}, {"integrator": "gather", "cast": "path-buffer"}])
def test_engines_that_cast_by_scans_say_that_they_do_not_show_it(engine: dict[str, Any]):
    scene = disc(Sky(np.ones(3), np.ones(3)))
    with pytest.warns(
        glpath.SceneWarning, match=r'ground below the model catches no shadow.*integrator="path" shows'
    ):
        film = glpath.render(scene, spp=1, **engine)
    assert film.mean[8, 8] == pytest.approx(scene.background.radiance if scene.background else 0)
