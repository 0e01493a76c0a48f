"""An environment and a background as parameters of every scene."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from glpath import SceneError, UsageError, load_scene
from glpath.film.exr import write_exr
from glpath.io.plain_background import PLAIN
from glpath.scene import Environment

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "a.obj").write_text(TRIANGLE)
    image = np.full((8, 16, 3), 0.5)
    write_exr(tmp_path / "sky.exr", image)
    return tmp_path


@pytest.mark.filterwarnings("ignore:.*no camera")
def test_an_environment_lights_a_model_and_is_turned_and_brightened(folder: Path):
    given = {"environment": str(folder / "sky.exr"), "environment_rotation": "30", "environment_exposure": "2"}
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*no light.*")
        scene = load_scene(folder / "a.obj", given)
    assert isinstance(scene.sky, Environment)
    assert (scene.sky.rotation, scene.sky.scale) == (30, 4)
    assert scene.sky.radiance([0.0, 0.0, 1.0]) == pytest.approx(2.0)
    assert (scene.background, scene.exposure) == (None, None)  # the studio's are gone
    plain = load_scene(folder / "a.obj", {**given, "background": "plain"})
    assert plain.background is not None
    assert plain.background.ground is not None, "of a model without light"
    assert plain.exposure == -1.0


def test_it_replaces_a_scene_files_sky_and_leaves_its_other_lights(folder: Path):
    own = load_scene("cornell-box-36")
    scene = load_scene("cornell-box-36", {"environment": folder / "sky.exr"})
    assert isinstance(scene.sky, Environment)
    assert [shape.emits for shape in scene.shapes] == [shape.emits for shape in own.shapes]


def test_a_plain_background_is_as_bright_as_a_ground_in_that_light(folder: Path):
    given = {"environment": folder / "sky.exr", "background": "plain"}
    scene = load_scene("cornell-box-36", given)
    assert scene.background is not None
    assert scene.background.radiance == pytest.approx(PLAIN * 0.5)
    assert scene.exposure == 1.0  # shows a white ground white


def test_a_background_changes_no_light():
    plain = load_scene("cornell-box-36", {"background": "plain"})
    own = load_scene("cornell-box-36")
    assert plain.digest(camera=False) == own.digest(camera=False)
    assert plain.digest() != own.digest()
    clear = load_scene(plain, {"background": "transparent"}).background
    assert clear is not None
    assert (clear.transparent, clear.radiance.tolist()) == (True, [0, 0, 0])
    assert load_scene(plain, {"background": "environment"}).background is None


def test_what_is_wrong_is_named(folder: Path):
    with pytest.raises(UsageError, match=r"environment_rotation.*no environment is given"):
        load_scene("cornell-box-36", {"environment_rotation": 30})
    with pytest.raises(SceneError, match=r"background.*pink.*environment, plain or transparent"):
        load_scene("cornell-box-36", {"background": "pink"})
    with pytest.raises(SceneError, match=r"environment.*no\.exr, which does not exist"):
        load_scene("cornell-box-36", {"environment": str(folder / "no.exr")})
    with pytest.raises(SceneError, match=r"environment_exposure.*stops from -100 to 100"):
        load_scene("cornell-box-36", {"environment": folder / "sky.exr", "environment_exposure": "bright"})
