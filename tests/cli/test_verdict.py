"""A picture that shows next to nothing is reported, with what helps."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from glpath.cli.main import app

SCENE = """
[camera]
position = [0, 0, 5]
target = [0, 0, 0]
[film]
resolution = [16, 16]
[sky]
zenith = {zenith}
up = [0, 1, 0]
[[shapes]]
type = "sphere"
radius = 1
"""


@pytest.mark.filterwarnings("ignore::glpath.SceneWarning")
@pytest.mark.parametrize(
    ("zenith", "options", "said"),
    [
        (0.0, (), "nearly all black: --environment FILE.hdr lights it"),
        (1.0, ("--exposure", "-9"), "nearly all black: --exposure auto, --exposure STOPS brightens it"),
        (1.0, ("--exposure", "4"), "nearly all white: --exposure auto, --exposure -2 darkens it"),
        (1.0, (), ""),
    ],
)
def test_a_black_or_white_picture_is_named(tmp_path: Path, zenith: float, options: tuple[str, ...], said: str):
    path = tmp_path / "a.toml"
    path.write_text(SCENE.format(zenith=zenith))
    out = ("-o", str(tmp_path / "a.png"), "--spp", "2", "--no-denoise", "--integrator", "path", "--guide", "cosine")
    result = CliRunner().invoke(app, ["render", str(path), *out, *options])
    assert result.exit_code == 0, result.stderr
    found = [line for line in result.stderr.splitlines() if "nearly all" in line]
    assert len(found) == bool(said)
    assert all(said in line for line in found)
