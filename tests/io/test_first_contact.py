"""What is often tried first: a lamp's file as a scene, and the words of other programs in a scene file."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from glpath.cli.main import app
from glpath.errors import SceneError
from tests.support.photometry import eulumdat, ies
from tests.support.repository import ROOT


@pytest.mark.parametrize("command", [["measure", "--plane", "y=0", "-o", "-"], ["info"], ["render", "-o", "a.png"]])
def test_a_lamps_file_is_told_what_it_is_and_where_it_goes(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """4 pi * 100 lm of 100 cd all around; and what the error says to write is a scene that has its light."""
    monkeypatch.chdir(tmp_path)
    ies(tmp_path / "lamp.ies", np.array([0.0, 90, 180]), np.zeros(1), np.full((1, 3), 100.0))
    result = CliRunner().invoke(app, [command[0], "lamp.ies", *command[1:]])
    assert result.exit_code == 1
    said = result.stderr
    assert "is the profile of a lamp (IES LM-63: up to 100 cd, 1,257 lm in all), not a scene." in said
    assert "Traceback" not in said
    light = textwrap.dedent(said[said.index("    [[lights]]") : said.index("  `glpath measure ROOM.toml")])
    (tmp_path / "room.toml").write_text(
        "camera = { position = [0, 1, 4], target = [0, 0, 0] }\n"
        '[[shapes]]\ntype = "sphere"\nradius = 1\ncenter = [0, -9, 0]\n' + light
    )
    (found,) = glpath.irradiance("room.toml", [[0, 1.5, 0]], [0, 1, 0], spp=16, max_depth=1).illuminance()
    assert found == pytest.approx(100, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("room.fbx", r"is an FBX model, not a scene\.\n.*glTF"),
        ("part.3mf", r"is a 3MF model, not a scene\.\n.*glTF"),
        ("sky.hdr", r'is a picture, not a scene\.\n.*\[sky\] with file = "sky\.hdr"'),
    ],
)
def test_other_files_are_told_where_they_go(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("what is in it is not asked")
    with pytest.raises(SceneError, match=f"(?s){words}"):
        glpath.load_scene(tmp_path / name)


def test_a_lamps_file_that_is_broken_or_absent_is_told_so(tmp_path: Path) -> None:
    (tmp_path / "lamp.ies").write_text("IESNA:LM-63-2002\n")
    with pytest.raises(SceneError, match=r"lamp\.ies.*TILT"):
        glpath.load_scene(tmp_path / "lamp.ies")
    with pytest.raises(SceneError, match="no such file"):
        glpath.load_scene(tmp_path / "none.ies")
    eulumdat(tmp_path / "lamp.ldt", np.array([0.0, 90, 180]), np.zeros(1), np.full((1, 3), 50.0), symmetry=1)
    with pytest.raises(SceneError, match=r"\(EULUMDAT: up to 50 cd, 628.3 lm in all\), not a scene.") as caught:
        glpath.load_scene(tmp_path / "lamp.ldt")
    assert 'profile = "lamp.ldt"' in str(caught.value)


def described(**material: Any) -> dict[str, Any]:
    return {
        "camera": {"position": [0, 1, 4], "target": [0, 0, 0]},
        "materials": {"a": material},
        "shapes": [{"type": "sphere", "radius": 1, "material": "a"}],
    }


@pytest.mark.parametrize(
    ("field", "answer"),
    [
        ("base_color", r"Did you mean `reflectance`\?"),
        ("baseColorFactor", r"Did you mean `reflectance`\?"),
        ("albedo", r"Did you mean `reflectance`\?"),
        ("color", r"Did you mean `reflectance`\?"),
        ("diffuse_texture", r"Did you mean `texture`\?"),
        ("normal_map", r"Did you mean `normal_texture`\?"),
        ("roughness", r'`roughness` is a field of the type "principled"\.'),
        ("metalness", r'`metallic` is a field of the type "principled"\.'),
        ("shininess", r'`exponent` is a field of the type "phong"\.'),
        ("emission", r"Light is of shapes: emission = \{ radiance"),
        ("reflectence", r"Did you mean `reflectance`\?"),
        ("thickness", r"Remove it, or see `glpath schema`"),
    ],
)
def test_words_of_other_programs_are_answered_with_ours(field: str, answer: str) -> None:
    with pytest.raises(SceneError, match=rf"(?s){field}.*is not a field of the type \"diffuse\".*{answer}"):
        glpath.load_scene(described(**{field: 0.5}))


@pytest.mark.parametrize(
    ("table", "field", "answer"),
    [
        ("camera", "lookat", "target"),
        ("camera", "eye", "position"),
        ("lights", "power", "intensity"),
        ("lights", "ies", "profile"),
        ("lights", "ldt", "profile"),
        ("shapes", "material_name", "material"),
        ("shapes", "luminance", "emission"),
    ],
)
def test_so_are_those_of_cameras_lights_and_shapes(table: str, field: str, answer: str) -> None:
    data = described(reflectance=0.5) | {"lights": [{"type": "point", "position": [0, 1, 0], "intensity": 1}]}
    part = data[table]
    (part if isinstance(part, dict) else part[0])[field] = 1
    with pytest.raises(SceneError, match=rf"(?s){field}.*is not a field.*Did you mean `{answer}`\?"):
        glpath.load_scene(data)


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_make_render_says_that_it_renders_with_the_path_buffer_and_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line that make prints, and the command that it runs, with fewer paths."""
    run = subprocess.run(
        ["make", "-n", "-o", ".venv/.glpath", "render", "SPP=2"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    lines = run.stdout.splitlines()
    told = [shlex.split(line)[1] for line in lines if line.startswith("echo ")]
    assert "with the path-buffer (Walter and Lengyel 1995)" in told[0]
    commands = [shlex.split(line) for line in lines if line.startswith(".venv/bin/glpath render")]
    monkeypatch.chdir(tmp_path)
    for command, integrator in zip(commands, ("path-buffer", "gather"), strict=True):
        result = CliRunner().invoke(app, [*command[1:], "--resolution", "97x96", "--stats", "stats.json"])
        assert result.exit_code == 0, result.output
        assert f'"integrator": "{integrator}"' in (tmp_path / "stats.json").read_text()
    for name in ("cornell-box.png", "cornell-box.exr", "cornell-box-default.png"):
        assert (tmp_path / "out" / name).exists()
