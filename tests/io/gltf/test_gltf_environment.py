"""Cube maps of files (EXT_lights_image_based), as environments."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glpath import SceneError, load_scene
from glpath.io.completed import aside
from glpath.scene import Environment
from tests.support.gltf_files import Gltf

pytestmark = pytest.mark.filterwarnings("ignore:.*no camera")

AXES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
#: Encoded; 0 and 255 stay what they are.
COLOURS = ((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255), (255, 0, 255))


def model(folder: Path, faces: Any, **light: Any) -> Path:
    made = Gltf().one_triangle()
    images = [made.image(face) for face in faces]
    light = {"specularImages": [images], "specularImageSize": 8, "irradianceCoefficients": [[0] * 3] * 9, **light}
    made.json["extensions"] = {"EXT_lights_image_based": {"lights": [light]}}
    made.json["scenes"] = [{"nodes": [0], "extensions": {"EXT_lights_image_based": {"light": 0}}}]
    made.json["extensionsUsed"] = ["EXT_lights_image_based"]
    return made.write(folder)


def plain(*colours: tuple[int, ...]) -> list[np.ndarray]:
    return [np.full((8, 8, len(colour)), colour, np.uint8) for colour in colours]


def sky(path: Path) -> Environment:
    scene = load_scene(path)
    assert isinstance(scene.sky, Environment)
    assert not scene.sky.assumed
    assert scene.background is None, "no studio"
    return scene.sky


def test_each_face_is_seen_along_its_axis_in_its_brightness(tmp_path: Path) -> None:
    found = sky(model(tmp_path, plain(*COLOURS), intensity=3.0))
    assert found.radiance(AXES) == pytest.approx(3.0 * np.array(COLOURS) / 255, abs=1e-6)


def test_faces_are_not_mirrored(tmp_path: Path) -> None:
    """Who looks along +z, y up, has +x on the left; +y is above its front."""
    faces = plain(*[(0, 0, 0)] * 6)
    faces[4][:, :4] = (255, 0, 0)
    faces[4][:2, 4:] = (0, 255, 0)
    found = sky(model(tmp_path, faces))
    directions = np.array([[0.4, 0, 1], [-0.4, 0, 1], [-0.4, 0.9, 1]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert found.radiance(directions) == pytest.approx(np.array([[1, 0, 0], [0, 0, 0], [0, 1, 0]]), abs=0.06)


def test_a_rotation_turns_the_light(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    found = sky(model(tmp_path, plain(*COLOURS), rotation=[0, half, 0, half]))  # about y: +z to +x
    assert found.radiance((1, 0, 0)) == pytest.approx(np.array(COLOURS[4]) / 255, abs=1e-6)


def test_four_channels_are_light_over_the_fourth(tmp_path: Path) -> None:
    found = sky(model(tmp_path, plain(*[(255, 255, 0, 51)] * 6)))
    assert found.radiance((0, 0, 1)) == pytest.approx([5, 5, 0])


def test_it_is_measured_and_baked_as_any_sky(tmp_path: Path) -> None:
    with aside("picture"):
        assert not load_scene(model(tmp_path, plain(*COLOURS))).sky.assumed  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"specularImages": [[0, 1]]}, r"specularImages\[0\] has 2 images, but a cube has 6 faces"),
        ({"specularImages": [[0, 1, 2, 3, 4, 9]]}, r"faces\[5\] is 9"),
        ({"rotation": [0, 0, 0, 0]}, "rotation is"),
        ({"specularImages": 3}, "specularImages"),
    ],
)
def test_what_is_no_cube_is_refused(tmp_path: Path, given: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        load_scene(model(tmp_path, plain(*COLOURS), **given))
