"""The studio that stands in for light, and when it does."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import glpath
from glpath import SceneError
from glpath.io.completed import aside
from glpath.io.plain_background import PLAIN
from glpath.scene import Environment, Sky
from glpath.sky.studio import studio
from tests.support.gltf_files import Gltf


def test_a_white_level_ground_has_radiance_one_in_it():
    light = studio()
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosine = np.maximum(directions[:, 1:2], 0.0)
    assert (4 * light.radiance(directions) * cosine).mean(axis=0) == pytest.approx(1.0, rel=0.02)
    assert light.assumed


def test_its_key_comes_from_the_upper_left_front():
    light = studio()

    def seen(x: float, y: float, z: float) -> float:
        at = np.array([x, y, z])
        return float(light.radiance(at / np.linalg.norm(at))[0])

    assert seen(-1, 1.6, 1.1) > 3 * seen(1, 0.6, 0.5) > 3 * seen(0, 0, 1)
    assert seen(0, -1, 0) > seen(0, 0, 1)  # the floor is no black hole


def wall(light: Environment, x: float, y: float, z: float) -> float:
    """Radiance of a white, diffuse wall of this normal."""
    directions = np.random.default_rng(1).normal(size=(100_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosine = np.maximum(directions @ np.array([x, y, z], float), 0.0)
    return float((4 * light.radiance(directions)[:, 0] * cosine).mean())


def test_what_faces_the_eye_is_bright_and_other_sides_differ_from_it():
    light = studio()
    front, left, right = wall(light, 0, 0, 1), wall(light, -1, 0, 0), wall(light, 1, 0, 0)
    assert 0.65 < front < 0.9, "a front that is as dark as a wall is grey, in the light of the ground"
    assert left > 1.4 * right, "a ball has form"
    assert wall(light, 0, -1, 0) < 0.3


def test_what_glass_shows_from_behind_is_about_as_bright_as_the_background():
    seen = studio().radiance([[0.0, y, -1.0] for y in (-0.3, 0.0, 0.3)])
    assert seen == pytest.approx(PLAIN, rel=0.2)


def model(folder: Path, radiance: float, size: float) -> Path:
    """A triangle, and one that shines a unit above it."""
    made = Gltf()
    shines = {"KHR_materials_emissive_strength": {"emissiveStrength": radiance}}
    made.one_triangle().one_triangle(emissiveFactor=[1, 1, 1], extensions=shines)
    made.json["nodes"][1] |= {"translation": [0, 0, 1], "scale": [size] * 3}
    return made.write(folder)


@pytest.mark.parametrize(("radiance", "size", "lit"), [(50.0, 0.01, False), (50.0, 0.3, True), (0.9, 1.0, False)])
def test_a_lamp_is_the_light_where_it_sends_enough_of_it(tmp_path: Path, radiance: float, size: float, lit: bool):
    """A filament in a lamp lights nothing, however bright it is."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = glpath.load_scene(model(tmp_path, radiance, size))
    said = " ".join(str(each.message) for each in caught)
    assert (scene.sky is None) is lit
    assert ("so a studio lights it" in said) is not lit
    assert (scene.background is None) is lit


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
def test_a_picture_has_a_studio_and_a_lightmap_a_white_sky(tmp_path: Path):
    path = model(tmp_path, 0.5, 1.0)
    seen = glpath.load_scene(path)
    assert isinstance(seen.sky, Environment)
    assert seen.exposure == 0.0
    assert seen.background is not None
    assert seen.background.ground is not None
    assert -0.01 < seen.background.ground[1] < 0.0, "just below the model"
    with aside("picture"):
        baked = glpath.load_scene(path)
    assert isinstance(baked.sky, Sky)
    assert baked.background is None


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
def test_nothing_is_measured_by_a_studio(tmp_path: Path):
    path = Gltf().one_triangle().write(tmp_path)
    with pytest.raises(SceneError, match="no light to measure"):
        glpath.irradiance(path, [[0.0, 0.0, 1.0]], [0.0, 0.0, 1.0])


def test_a_scene_file_has_the_light_it_says():
    scene = glpath.load_scene("cornell-box-36")
    assert (scene.sky, scene.background) == (None, None)


def test_where_z_is_up_the_studio_stands_upright():
    """A description of the same block, turned as models are that come with z up, is the same picture."""

    def block(turned: bool) -> dict[str, object]:
        def at(x: float, y: float, z: float) -> list[float]:
            return [x, -z, y] if turned else [x, y, z]

        lower, upper = at(-1, 0, -0.5), at(1, 2, 0.5)
        low, high = ([f(pair) for pair in zip(lower, upper, strict=True)] for f in (min, max))
        return {
            "camera": {"position": at(3, 3, 5), "target": at(0, 1, 0), "up": at(0, 1, 0)},
            "film": {"resolution": [24, 24]},
            "materials": {"grey": {"reflectance": 0.5}},
            "shapes": [{"type": "box", "min": low, "max": high, "material": "grey"}],
        }

    films = []
    for turned in (False, True):
        with pytest.warns(glpath.SceneWarning, match="a studio lights it"):
            scene = glpath.load_scene(block(turned))
        assert scene.background is not None
        assert scene.background.ground is not None
        up = 2 if turned else 1
        assert scene.background.up.tolist() == np.eye(3)[up].tolist()
        assert scene.background.ground[up] == pytest.approx(0.0, abs=1e-3)
        films.append(glpath.render(scene, spp=64, integrator="path", max_depth=2).mean)
    assert films[1].mean() == pytest.approx(films[0].mean(), rel=0.02)
    blurred = [film.reshape(4, 6, 4, 6, 3).mean(axis=(1, 3)) for film in films]
    assert blurred[1] == pytest.approx(blurred[0], rel=0.08)
