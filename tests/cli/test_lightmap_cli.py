"""What `glpath lightmap` says of a bake: denoised or not and why, and the bias of a gather at points."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from glpath.cli.main import app
from glpath.errors import GlpathError
from glpath.film.bias import Bias
from glpath.film.denoise import can_denoise
from glpath.film.film import Film
from tests.support.gltf_files import ReadGlb

needs_denoiser = pytest.mark.skipif(not can_denoise(), reason="needs the extra denoise")


def bake(out: Path, *options: str) -> Result:
    pytest.importorskip("xatlas")
    asked = ["lightmap", "cornell-box", "-o", str(out), "--size", "64", "--spp", "16", "--progress", "none"]
    done = CliRunner().invoke(app, [*asked, *options])
    assert done.exit_code == 0, done.output
    return done


def without_denoiser() -> None:
    raise GlpathError("pyoidn cannot be imported")


@needs_denoiser
def test_denoised_bake_says_so(tmp_path: Path) -> None:
    done = bake(tmp_path / "a.glb")
    assert "  denoised by Open Image Denoise\n" in done.stderr
    assert "before denoising" in done.stderr
    assert "not denoised" not in done.stderr
    assert ReadGlb.of(tmp_path / "a.glb").json["extras"]["denoised"] is True


def test_bake_without_denoising_says_that_it_was_asked_for(tmp_path: Path) -> None:
    done = bake(tmp_path / "a.glb", "--no-denoise")
    assert "  not denoised (--no-denoise)\n" in done.stderr
    assert "before denoising" not in done.stderr
    assert ReadGlb.of(tmp_path / "a.glb").json["extras"]["denoised"] is False


def test_bake_without_denoiser_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("glpath.film.denoise.require_denoiser", without_denoiser)
    done = bake(tmp_path / "a.glb")
    assert "  not denoised: pyoidn is missing (pip install 'glpath[denoise]')\n" in done.stderr
    assert ReadGlb.of(tmp_path / "a.glb").json["extras"]["denoised"] is False


@pytest.mark.parametrize("option", ["--no-denoise", pytest.param("--denoise", marks=needs_denoiser)])
def test_files_beside_kept_materials_say_whether_they_are_denoised(option: str, tmp_path: Path) -> None:
    bake(tmp_path / "a.glb", option, "--materials", "keep")
    about = json.loads((tmp_path / "a-0.lightmap.json").read_text("utf-8"))
    assert about["denoised"] is (option == "--denoise")


@pytest.mark.parametrize("option", ["--no-denoise", pytest.param("--denoise", marks=needs_denoiser)])
def test_last_json_object_says_whether_it_is_denoised(option: str, tmp_path: Path) -> None:
    done = bake(tmp_path / "a.glb", option, "--progress", "json")
    assert json.loads(done.stderr.splitlines()[-1])["denoised"] is (option == "--denoise")


@pytest.mark.parametrize(
    "command",
    [
        ["lightmap", "cornell-box", "-o", "a.glb", "--size", "64"],
        ["probes", "cornell-box", "-o", "a.json", "--grid", "2x2x2"],
        ["measure", "cornell-box", "-o", "a.csv", "--plane", "y=100", "--spacing", "100"],
    ],
    ids=lambda command: command[0],
)
@pytest.mark.parametrize("known", [True, False])
def test_bias_of_points_is_printed_if_it_is_known(
    command: list[str], known: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if command[0] == "lightmap":
        pytest.importorskip("xatlas")
    bias = Bias(mean=0.021, mean_error=0.004, blocks=0.03, blocks_error=0.01, worst_block=0.0)
    monkeypatch.setattr(Film, "bias", lambda _: bias if known else None)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, [*command, "--spp", "8", "--progress", "none"])
    assert done.exit_code == 0, done.output
    line = (
        "  bias of the gather: +2.1 % of the light, plus or minus 0.4; in blocks 3 %, which is too large; "
        "--integrator path has none\n"
    )
    assert (line in done.stderr) is known
    if command[0] == "lightmap":
        extras = ReadGlb.of(tmp_path / "a.glb").json["extras"]
        assert extras.get("bias") == (vars(bias) if known else None)
