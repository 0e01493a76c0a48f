"""The command line as people and shells meet it: completion, JSON of scenes, turntables, one dialect of errors."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from typer.testing import CliRunner

import glpath
from glpath.cli.main import app
from glpath.io import scene_parameters, shipped_scenes
from tests.support.command_line import run

SMALL = ("--resolution", "16x12", "--spp", "2", "--max-depth", "2")


def asked_by_bash(line: str) -> dict[str, str]:
    """The environment in which bash asks for what the last word of the line may be."""
    words = line.split(" ")
    return {"_GLPATH_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}


def offered(text: str) -> list[str]:
    return [each.split(",")[-1] for each in text.split("\n") if each]


def completed(line: str) -> list[str]:
    """What bash is offered for the last word of the line, by this process."""
    return offered(CliRunner().invoke(app, [], prog_name="glpath", env=asked_by_bash(line)).stdout)


def test_the_shell_completes_scenes_words_and_parameters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").touch()
    (tmp_path / "models").mkdir()
    (tmp_path / "notes.txt").touch()
    assert completed("glpath render off") == ["office", "office-premesh"]
    assert completed("glpath render m") == ["mine.toml", f"models{os.sep}"]
    # As the shell does it.
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(glpath.__file__).parents[1]),
        **asked_by_bash("glpath render m"),
    }
    done = subprocess.run([sys.executable, "-m", "glpath"], env=environment, capture_output=True, text=True)
    assert offered(done.stdout) == ["mine.toml", f"models{os.sep}"]
    assert completed("glpath validate three") == ["three-spheres"]
    assert completed("glpath render office --integrator t") == ["t-buffer"]
    assert completed("glpath render office --shadows ") == ["rays", "sphere", "cube"]
    assert completed("glpath render stacked -D obj") == ["objects="]
    assert completed("glpath info furnace -D re") == ["reflectance=", "resolution="]


def test_scenes_tells_their_parameters_to_people_and_programs() -> None:
    told = json.loads(run("scenes", "--json").stdout)
    assert [each["name"] for each in told] == list(shipped_scenes())
    stacked = next(each for each in told if each["name"] == "stacked")
    assert stacked["parameters"].keys() == scene_parameters("stacked").keys()
    for key, about in stacked["parameters"].items():
        glpath.load_scene("stacked", {key: about["default"]})  # the defaults are values that it takes
    assert "-D objects=" in run("scenes").stdout


def test_validate_tells_programs(tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text("x = 1")
    done = run("validate", "furnace", path, "--json")
    assert done.exit_code == 1
    good, bad = json.loads(done.stdout)
    assert good == {"scene": "furnace", "ok": True, "error": None, "warnings": []}
    assert not bad["ok"]
    assert "broken.toml" in bad["error"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--camera-up", "0,0,0"), "--camera-up is 0,0,0, but must be a vector of any length but zero"),
        (("--camera-up", "0,0,0"), "For example --camera-up 0,1,0."),
        (("--camera-up", "0,0,1"), "Choose another, such as --camera-up "),
        (("--camera-fov", "190"), "--camera-fov is 190, but must be above 0 and below 180"),
        (("--camera-target", "278,273,-800"), "--camera-target is the same point as --camera-position"),
        (("--resolution", "99999x99999"), "--resolution is 99999x99999, but must be two whole numbers"),
        (("--camera-position", "0,1"), "--camera-position 0,1: expected X,Y,Z"),
        (("--spp", "abc"), "--spp"),
        (("--nope",), "--nope"),
        (("--turntable", "0"), "--turntable 0: must be at least 1"),
        (("--turntable", "4", "--crop", "0,0,2,2"), "--crop beside --turntable"),
        (("--turntable", "4", "-o", "-"), "-o - beside --turntable"),
    ],
)
def test_what_options_get_wrong_is_said_in_their_own_words(
    options: tuple[str, ...], expected: str, tmp_path: Path
) -> None:
    done = run("render", "cornell-box", "-o", tmp_path / "a.png", *options)
    assert done.exit_code == 2
    assert done.stderr.startswith("glpath: error: "), done.stderr
    assert expected in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rendr", "Did you mean 'render'?"),
        ("render cornell-box", "--out"),
        ("scenes foo", "foo"),
        ("diff a.png", "B"),
        ("render cornell-box -o a.png --max-depth 1.5", "--max-depth"),
    ],
)
def test_wrong_usage_is_one_line_and_where_to_read_on(line: str, expected: str) -> None:
    done = run(*line.split())
    assert done.exit_code == 2
    first, *more = done.stderr.splitlines()
    assert first.startswith("glpath: error: ")
    assert expected in first
    assert any("--help" in each for each in more)
    assert "╭" not in done.stderr


def test_a_turntable_is_a_film_of_frames_with_one_exposure(tmp_path: Path) -> None:
    out = tmp_path / "turn.png"
    done = run("render", "cornell-box-36", "-o", out, "-o", tmp_path / "turn.npz", "--turntable", 12, *SMALL)
    assert done.exit_code == 0, done.stderr
    pictures = sorted(tmp_path.glob("*.png"))
    assert [path.name for path in pictures] == [f"turn-{i:02}.png" for i in range(12)]
    assert len({iio.immeta(path)["glpath.exposure_stops"] for path in pictures}) == 1
    scene = glpath.load_scene("cornell-box-36")
    third = glpath.Film.load(tmp_path / "turn-03.npz")
    camera = scene.camera.turned(90)
    alone = glpath.render(
        scene, camera={"position": camera.position}, spp=2, max_depth=2, resolution=(16, 12), integrator="path"
    )
    assert np.array_equal(third.mean, alone.mean)


def test_an_interrupted_turntable_keeps_its_frames(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "glpath", "render", "cornell-box-36", "-o", str(tmp_path / "a.png")]
    child = subprocess.Popen(
        [*command, "--turntable", "2000", *SMALL],
        env={**os.environ, "PYTHONPATH": str(Path(glpath.__file__).parents[1])},
        stderr=subprocess.PIPE,
        text=True,
    )
    limit = time.monotonic() + 60
    while not (tmp_path / "a-0002.png").exists() and time.monotonic() < limit:
        time.sleep(0.02)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 130, said
    assert "Traceback" not in said
    frames = sorted(tmp_path.iterdir())
    assert len(frames) >= 3
    assert f"{len(frames)} of 2000 frames are written" in said
    for path in frames:
        assert iio.imread(path).shape == (12, 16, 3)
