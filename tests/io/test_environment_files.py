"""Environment maps of scene files: every kind of file, and what is wrong with one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from glpath import SceneError, SceneWarning, load_scene
from glpath.cli.main import app
from glpath.film.exr import write_exr
from glpath.film.image import write_png
from glpath.io import description
from glpath.scene import Environment
from glpath.system.colour import decode_srgb
from tests.support.rgbe_files import colours, run_lengths

HEAD = """
[camera]
position = [0, 0, 4]
target = [0, 0, 0]
up = [0, 3, 0]
[[shapes]]
type = "sphere"
radius = 1
[sky]
"""


def sky(text: str, folder: Path) -> Any:
    path = folder / "room.toml"
    path.write_text(HEAD + text)
    return load_scene(path).sky


def test_every_kind_of_file_is_a_map(tmp_path: Path):
    rgbe = np.random.default_rng(0).integers(120, 136, (4, 8, 4)).astype(np.uint8)
    light = np.random.default_rng(1).random((4, 8, 3)) * 100
    bytes_ = np.random.default_rng(2).integers(0, 256, (4, 8, 3)).astype(np.uint8)
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\n\n-Y 4 +X 8\n" + run_lengths(rgbe))
    write_exr(tmp_path / "b.exr", light)
    write_png(tmp_path / "c.png", bytes_)
    for name, image in (("a.hdr", colours(rgbe)), ("b.exr", light), ("c.png", decode_srgb(bytes_ / 255))):
        found = sky(f'file = "{name}"', tmp_path)
        assert isinstance(found, Environment)
        np.testing.assert_array_equal(found.image, image.astype(np.float32))
        assert (found.scale, found.rotation, found.up.tolist()) == (1.0, 0.0, [0, 1, 0])  # the camera's up


def test_a_map_may_be_scaled_and_turned(tmp_path: Path):
    write_exr(tmp_path / "a.exr", np.ones((2, 4, 3)))
    found = sky('file = "a.exr"\nscale = 2.5\nrotation = -30\nup = [0, 0, 2]', tmp_path)
    assert (found.scale, found.rotation, found.up.tolist()) == (2.5, -30.0, [0, 0, 1])
    np.testing.assert_allclose(found.radiance([0, 0, 1]), 2.5)


def test_what_is_below_zero_is_clipped_and_told(tmp_path: Path):
    image = np.ones((2, 4, 3))
    image[1, 2] = -0.25
    write_exr(tmp_path / "a.exr", image)
    with pytest.warns(SceneWarning, match=r"sky.file: 3 of 24 values of .*a.exr are below 0, down to -0.25"):
        found = sky('file = "a.exr"', tmp_path)
    np.testing.assert_array_equal(found.image, np.maximum(image, 0))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ["sky has no radiance, but a sky is", 'file = "sky.hdr"']),
        ('file = "a.exr"\nzenith = 1', ["sky has zenith and file, but a sky is"]),
        ('file = "a.exr"\nhorizon = 1', ["sky has horizon and file"]),
        ("zenith = 1\nscale = 2", ["sky has zenith and scale"]),
        ("zenith = 1\nrotation = 2", ["sky has zenith and rotation"]),
        ('file = "b.exr"', ["sky.file names the picture", "b.exr, which does not exist", "a.exr, nan.exr"]),
        ('file = "no/b.exr"', ["which does not exist", "no folder"]),
        ('file = "a.gif"', ["an environment map is a file that ends in .exr, .hdr, .png"]),
        ('file = "folder.hdr"', ["folder.hdr, which is not a file"]),
        ('file = "broken.hdr"', ["sky.file names a picture that cannot be used", "does not begin with #?RADIANCE"]),
        ('file = "nan.exr"', ["8 of its 8 pixels are NaN or infinite"]),
        ('file = "large.hdr"', ["of 999,999 x 9 pixels", "at most 16,384 pixels a side and 33,554,432 in all"]),
        ('file = "a.exr"\nscale = -1', ["sky.scale is -1", "at least 0"]),
        ('file = "a.exr"\nscale = 1e15', ["sky.file has radiance up to 3e+15", "at most 1e+15"]),
        ('file = "a.exr"\nrotation = inf', ["sky.rotation is inf"]),
        ('file = "a.exr"\nup = [0, 0, 0]', ["sky.up is [0, 0, 0]"]),
        ('file = "a.exr"\nturn = 3', ["turn", "rotation"]),
    ],
)
def test_what_is_wrong_is_said_with_its_place(tmp_path: Path, text: str, expected: list[str]):
    write_exr(tmp_path / "a.exr", np.full((2, 4, 3), 3.0))
    write_exr(tmp_path / "nan.exr", np.full((2, 4, 3), np.nan))
    (tmp_path / "folder.hdr").mkdir()
    (tmp_path / "broken.hdr").write_bytes(b"P6")
    (tmp_path / "large.hdr").write_bytes(b"#?RADIANCE\n\n-Y 9 +X 999999\n")
    with pytest.raises(SceneError) as error:
        sky(text, tmp_path)
    message = f"{error.value}\n{error.value.remedy}"
    assert message.startswith(f"{tmp_path / 'room.toml'}: sky")
    for part in expected:
        assert part in message
    assert description.MAX_ENVIRONMENT_PIXELS == 33_554_432


def test_info_tells_of_a_map(tmp_path: Path):
    write_exr(tmp_path / "a.exr", np.ones((2, 4, 3)))
    sky('file = "a.exr"\nscale = 2', tmp_path)
    result = CliRunner().invoke(app, ["info", str(tmp_path / "room.toml")])
    assert "map of 4 x 2" in result.stdout
