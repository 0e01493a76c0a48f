"""The bench `mitsuba-scenes`: figures of known pictures, verdicts, and a folder of two files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from benchmarks import mitsuba_scenes_command
from benchmarks.benches.mitsuba_scenes import (
    SAMPLES,
    VERDICTS,
    compare,
    difference,
    files_of,
    first_seed,
    is_waiting,
    load,
    plugins_of,
    report,
    verdict,
)
from benchmarks.peers.mitsuba_file import radio_colours
from glpath.errors import GlpathError
from glpath.scene.model import Float64

CLOSE: dict[str, Any] = {
    "loads": True,
    "warnings": [],
    "mean_difference": 0.009,
    "worst_block": 0.04,
    "mean_noise": 0.009,
    "noise": 0.04,
}


def pictures(block_factor: float = 1.0, noise: float = 0.0, seed: int = 0) -> Float64:
    """(8, 32, 48, 3) of 1; one block of 16 x 16 times a factor."""
    image = np.ones((8, 32, 48, 3))
    image[:, 16:, 32:] *= block_factor
    return image * (1.0 + noise * np.random.default_rng(seed).standard_normal(image.shape))


def test_one_block_that_is_brighter_is_found() -> None:
    found = difference(pictures(1.2), pictures())
    assert found["worst_block"] == pytest.approx(0.2)
    assert found["mean_ratio"] == pytest.approx(1 + 0.2 / 6, abs=1e-5)
    assert found["noise"] == 0


def test_noise_is_taken_off() -> None:
    """Of 256 pixels, three channels and eight batches, noise of 10 % is 0.13 % of a block's mean."""
    found = difference(pictures(1.2, 0.1, 1), pictures(1.0, 0.1, 2))
    assert found["worst_block"] == pytest.approx(0.2 - 2 * 0.0013 * np.sqrt(1 + 1.2**2), abs=0.006)
    assert 0 < found["noise"] < 0.02
    same = difference(pictures(1.0, 0.1, 1), pictures(1.0, 0.1, 2))
    assert same["worst_block"] < 0.004


def test_one_channel_that_differs_is_found() -> None:
    ours = pictures()
    ours[..., 2] *= 0.9
    found = difference(ours, pictures())
    assert found["mean_ratio"] == pytest.approx(0.9)
    assert found["mean_difference"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, "same"),
        ({"loads": False}, "refused"),
        ({"warnings": ["a.xml: something"], "worst_block": 0.5}, "warned"),
        ({"worst_block": 0.06}, "differs"),
        ({"mean_difference": 0.011}, "differs"),
        ({"noise": 0.06}, "unclear"),
        ({"mean_noise": 0.011}, "unclear"),
        ({"noise": 0.06, "worst_block": 0.06}, "differs"),
    ],
)
def test_a_verdict_follows_from_the_figures(change: dict[str, Any], expected: str) -> None:
    assert verdict(CLOSE | change) == expected
    assert expected in VERDICTS
    assert verdict({"loads": True, "warnings": []}) == "not compared"


def test_noise_of_files_is_not_correlated() -> None:
    """No two batches of 185 files at three counts of samples share a seed of 32 bits."""
    starts = sorted(first_seed(f"{number}.xml", samples) for number in range(185) for samples in SAMPLES)
    assert np.diff(starts).min() >= 8
    assert starts[-1] + 8 < 2**32


def test_radio_materials_have_the_colours_of_the_checkout(tmp_path: Path) -> None:
    """Not those that glpath reads them with, so that a wrong one is a difference."""
    folder = tmp_path / "src/sionna/rt/radio_materials"
    folder.mkdir(parents=True)
    (folder / "itu_material.py").write_text(
        'class ITURadioMaterial:\n    ITU_MATERIAL_COLORS = {"brick": (0.4, 0.1, 0.2)}\n'
    )
    assert radio_colours(tmp_path / "src/sionna/rt/scenes/box/box.xml") == {"brick": (0.4, 0.1, 0.2)}


def test_more_samples_are_for_files_that_are_undecided() -> None:
    compared = CLOSE | {"verdict": "same", "samples": 128}
    assert not is_waiting(compared, 512)
    assert is_waiting(compared | {"verdict": "unclear"}, 512)
    assert not is_waiting(compared | {"verdict": "unclear"}, 128)
    assert is_waiting({"loads": True, "verdict": "warned"}, 128)
    assert not is_waiting({"loads": True, "verdict": "not compared", "error": "Mitsuba ends"}, 128)
    assert not is_waiting({"loads": False, "verdict": "refused"}, 128)


def write_files(folder: Path) -> None:
    """A file that uses half of its plugins, one that is refused, and one in a hidden folder."""
    folder.joinpath(".checkpoints").mkdir()
    folder.joinpath(".checkpoints/a.xml").write_text("<scene/>")
    folder.joinpath("refused.xml").write_text('<scene version="3.0.0"><shape type="linearcurve"/></scene>')
    folder.joinpath("ball.xml").write_text(
        '<scene version="3.0.0"><bsdf type="plastic" id="unused"/><bsdf type="diffuse" id="grey"/>'
        '<integrator type="path"/><emitter type="constant"/><sensor type="perspective"><transform name="to_world">'
        '<lookat origin="0 0 4" target="0 0 0" up="0 1 0"/></transform><sampler type="independent">'
        '<integer name="sample_count" value="$spp"/></sampler><film type="hdrfilm">'
        '<integer name="width" value="640"/><integer name="height" value="480"/></film></sensor>'
        '<shape type="sphere"><ref id="grey"/></shape></scene>'
    )


def test_files_of_a_folder_and_the_plugins_that_they_use(tmp_path: Path) -> None:
    write_files(tmp_path)
    assert [path.name for path in files_of(tmp_path)] == ["ball.xml", "refused.xml"]
    used = ["bsdf diffuse", "emitter constant", "sensor perspective", "shape sphere"]
    assert plugins_of(tmp_path / "ball.xml", {"spp": "4"}) == used


def test_a_refused_file_names_the_element(tmp_path: Path) -> None:
    write_files(tmp_path)
    row = load(tmp_path, tmp_path / "refused.xml")
    assert (row["verdict"], row["loads"]) == ("refused", False)
    assert row["error"].startswith('refused.xml: line 1, <shape type="linearcurve"> is a shape')


def test_files_of_a_stored_result_are_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_files(tmp_path)
    kept = CLOSE | {"file": "ball.xml", "verdict": "same"}
    stored = tmp_path / "result.json"
    stored.write_bytes(report([kept]).as_json().encode())
    mitsuba_scenes_command.mitsuba_scenes(tmp_path, stored, None)
    rows = {row["file"]: row for row in json.loads(stored.read_text())["rows"]}
    assert rows["ball.xml"] == kept
    assert rows["refused.xml"]["verdict"] == "refused"
    assert "DOES NOT HOLD" in capsys.readouterr().out


def test_a_folder_without_files_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(GlpathError, match=r"has no \.xml file"):
        mitsuba_scenes_command.mitsuba_scenes(tmp_path, tmp_path / "result.json", None)


@pytest.mark.evidence
def test_a_ball_has_the_picture_that_mitsuba_makes_of_it(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    write_files(tmp_path)
    row = compare(tmp_path, load(tmp_path, tmp_path / "ball.xml"), SAMPLES[0])
    assert row["parameters"] == {"spp": "16"}
    assert row["verdict"] == "same", row
    assert glpath.load_scene(tmp_path / "ball.xml", row["parameters"]).camera.resolution == (640, 480)
