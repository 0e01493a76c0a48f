"""Shards: ranges of path sets that are rendered anywhere and merged, each once."""

from __future__ import annotations

import os
import shutil
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glpath
from glpath.film.exr import read_exr_channels
from glpath.film.film import Film, read_image
from glpath.film.image import read_eight_bits
from glpath.gl.opening import CollectingContext
from glpath.jobs.shards import merge_shards
from glpath.rendering import RenderJob
from tests.conftest import MakeFilm
from tests.support.command_line import run
from tests.support.killing import SMALL


@pytest.fixture
def shards(make_film: MakeFilm, tmp_path: Path) -> list[Path]:
    paths = []
    for i, ends in enumerate(((0, 11), (11, 16), (40, 50))):
        paths.append(tmp_path / f"{i}.npz")
        make_film([ends]).save(paths[-1])
    return paths


def test_ranges_of_the_command_line_merge_into_the_render_of_all(tmp_path: Path) -> None:
    for name, ends in (("a", "0:13"), ("b", "13:30")):
        result = run("render", *SMALL, "-o", tmp_path / f"{name}.npz", "--sample-range", ends, "-q")
        assert result.exit_code == 0, result.stderr
    result = run(
        "merge", tmp_path / "b.npz", tmp_path / "a.npz", "-o", tmp_path / "all.npz", "-o", tmp_path / "all.exr"
    )
    assert result.exit_code == 0, result.stderr
    assert "30 path sets (0:30) of 2 films" in result.stderr
    whole = glpath.render("cornell-box-36", spp=30, resolution=(24, 16), max_depth=2)
    merged = Film.load(tmp_path / "all.npz")
    assert np.array_equal(merged.radiance_sums, whole.radiance_sums)
    assert merged.metadata.stop_rule == ""
    np.testing.assert_allclose(read_image(tmp_path / "all.exr"), whole.mean, rtol=1e-6)


def test_shards_are_weighed_by_their_path_sets_in_any_order(shards: list[Path], make_film: MakeFilm) -> None:
    whole = make_film([(0, 16), (40, 50)])
    for order in permutations(shards):
        merged, repeated = merge_shards(order)
        assert np.array_equal(merged.mean, whole.mean)
        assert (merged.ranges, repeated) == (whole.ranges, [])


def test_a_shard_counts_once_however_often_it_is_named(shards: list[Path], tmp_path: Path) -> None:
    copy, link = tmp_path / "copy.npz", tmp_path / "link.npz"
    shutil.copy(shards[0], copy)
    link.symlink_to(shards[1])
    merged, repeated = merge_shards([*shards, shards[2], copy, link])
    assert repeated == [shards[2], copy, link]
    assert merged.path_sets == 26
    result = run("merge", *shards, copy, "-o", tmp_path / "all.npz")
    assert f"{copy}: is there already, and counts once" in result.stderr
    # What is merged already may be merged again: the same file.
    held = Film.load(tmp_path / "all.npz")
    assert run("merge", tmp_path / "all.npz", tmp_path / "all.npz", "-o", tmp_path / "again.npz").exit_code == 0
    assert np.array_equal(Film.load(tmp_path / "again.npz").radiance_sums, held.radiance_sums)


def test_shards_that_share_path_sets_are_refused_by_name(
    shards: list[Path], make_film: MakeFilm, tmp_path: Path
) -> None:
    make_film([(8, 14)]).save(tmp_path / "over.npz")
    result = run("merge", *shards, tmp_path / "over.npz", "-o", tmp_path / "all.npz")
    assert result.exit_code == 2
    assert f"{tmp_path / 'over.npz'}: holds path sets 8 to 10, and {shards[0]} does, too." in result.stderr
    assert not (tmp_path / "all.npz").exists()


def test_a_shard_of_another_render_is_refused_with_all_that_differs(
    shards: list[Path], make_film: MakeFilm, tmp_path: Path
) -> None:
    make_film([(60, 64)], seed=4, settings={"sampling": "random"}).save(tmp_path / "other.npz")
    result = run("merge", *shards, tmp_path / "other.npz", "-o", tmp_path / "all.npz")
    assert result.exit_code == 2
    for words in (
        f"{tmp_path / 'other.npz'}: of another render than {shards[0]}: ",
        f"seed is 4, in {shards[0]} 3",
        f"settings.sampling is random, in {shards[0]} sobol",
    ):
        assert words in result.stderr
    assert "other.npz" in os.listdir(tmp_path)


def test_what_is_no_film_is_named(shards: list[Path], tmp_path: Path) -> None:
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    result = run("merge", shards[0], tmp_path / "bad.npz", "-o", tmp_path / "all.npz")
    assert (result.exit_code, "bad.npz: cannot be read as a film" in result.stderr) == (1, True)
    assert run("merge", "-o", tmp_path / "all.npz").exit_code == 2


# Pictures of merged shards.

LAYERS = {"R", "G", "B"} | {f"{layer}.{letter}" for layer in ("albedo", "denoised") for letter in "RGB"}
LAYERS |= {f"normal.{letter}" for letter in "XYZ"}


def succeed(*arguments: object) -> str:
    """Run a command, which has to succeed, and return what it prints on standard error."""
    result = run(*arguments)
    assert result.exit_code == 0, result.stderr
    return result.stderr


def pictures(folder: Path, name: str) -> tuple[list[Any], list[Path]]:
    """Return the arguments to write a .png and an .exr, and their paths."""
    paths = [folder / f"{name}.png", folder / f"{name}.exr"]
    return ["-o", paths[0], "-o", paths[1]], paths


def check_same_pictures(whole: list[Path], merged: list[Path]) -> set[str]:
    """Assert that the .png and every channel of the .exr are equal; return the names of the channels."""
    ours, theirs = read_eight_bits(merged[0]), read_eight_bits(whole[0])
    assert ours is not None
    assert theirs is not None
    np.testing.assert_array_equal(ours, theirs)
    channels, expected = (read_exr_channels(paths[1])[0] for paths in (merged, whole))
    assert channels.keys() == expected.keys()
    for name, pixels in expected.items():
        np.testing.assert_array_equal(channels[name], pixels, err_msg=name)
    return {*channels}


@pytest.mark.parametrize(
    ("scene", "options", "layers"),
    [
        ("cornell-box-36", "--resolution 112x96", LAYERS),  # auto takes the gather, as it is no thumbnail
        ("cornell-box-36", "--resolution 64x48 --integrator path --max-depth 2", LAYERS),
        ("cornell-box-36", "--resolution 64x48 --integrator path-buffer --max-depth 2", LAYERS),
        ("cornell-box-36", "--resolution 64x48 --crop 5,6,40,30 --max-depth 2", LAYERS),
        ("cornell-box-36", "--resolution 64x48 --max-depth 2 --aov depth --aov direct", None),
        ("cornell-box-36", "--resolution 64x48 --max-depth 2 --aov all", None),
        ("three-spheres", "--resolution 64x48 --integrator t-buffer --aov depth", {*"RGB", "depth.Z"}),
        ("three-spheres", "--resolution 64x48 --integrator classic", {*"RGB"}),
    ],
)
def test_merged_pictures_are_those_of_the_uninterrupted_render(
    scene: str, options: str, layers: set[str] | None, tmp_path: Path
) -> None:
    asked = ["render", scene, *options.split(), "-q"]
    outputs, whole = pictures(tmp_path, "whole")
    succeed(*asked, "--spp", 25, *outputs)
    shards = [tmp_path / "b.npz", tmp_path / "a.npz"]
    for shard, ends in zip(shards, ("11:25", "0:11"), strict=True):
        succeed(*asked, "--sample-range", ends, "-o", shard)
    outputs, merged = pictures(tmp_path, "merged")
    told = succeed("merge", *shards, *outputs)
    assert "warning" not in told
    found = check_same_pictures(whole, merged)
    assert found == layers if layers is not None else found > LAYERS


def test_exposure_and_tone_curve_of_merge_are_those_of_render(tmp_path: Path) -> None:
    shown = ["--exposure", "-1.5", "--tonemap", "aces"]
    outputs, whole = pictures(tmp_path, "whole")
    succeed("render", *SMALL, "--spp", 8, *outputs, *shown)
    succeed("render", *SMALL, "--spp", 8, "-o", tmp_path / "a.npz")
    outputs, merged = pictures(tmp_path, "merged")
    succeed("merge", tmp_path / "a.npz", *outputs, *shown)
    check_same_pictures(whole, merged)
    for option in (shown[:2], shown[2:]):
        for command in (["render", *SMALL], ["merge", tmp_path / "a.npz"]):
            typed = [*command, "-o", tmp_path / "b.exr", "-o", tmp_path / "b.npz", *option]
            result = run(*typed)
            assert result.exit_code == 2
            assert f"{' '.join(option)}: an .exr or .npz holds the light itself" in result.stderr


def test_a_checkpoint_is_a_shard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[int] = []

    def failing(self: CollectingContext) -> str:
        steps.append(1)
        return "GL_OUT_OF_MEMORY" if len(steps) > 4 else "GL_NO_ERROR"

    with monkeypatch.context() as patch:
        patch.setattr("glpath.rendering.loop._STEP_SECONDS", 0.0)
        patch.setattr(CollectingContext, "error", property(failing))
        patch.setattr("glpath.gl.memory._WORTH_ASKING", 1 << 40)
        asked = ("render", *SMALL, "-q", "-o", tmp_path / "a.png", "--spp", 64, "--checkpoint", "1h")
        assert run(*asked).exit_code == 1
    checkpoint = tmp_path / "a.checkpoint.npz"
    held = Film.load(checkpoint).path_sets
    succeed("render", *SMALL, "-q", "-o", tmp_path / "b.npz", "--sample-range", f"{held}:20")
    outputs, whole = pictures(tmp_path, "whole")
    succeed("render", *SMALL, "-q", "--spp", 20, *outputs)
    outputs, merged = pictures(tmp_path, "merged")
    succeed("merge", checkpoint, tmp_path / "b.npz", *outputs)
    assert check_same_pictures(whole, merged) == LAYERS


@pytest.mark.parametrize("aovs", [("albedo", "normal"), ()])
def test_parts_of_a_job_merge_to_the_pictures_of_the_job(aovs: tuple[str, ...], tmp_path: Path) -> None:
    job = RenderJob.of("cornell-box-36", resolution=(24, 16), max_depth=2, spp=24, aovs=aovs)
    job.save(tmp_path / "job.json")
    outputs, whole = pictures(tmp_path, "whole")
    succeed("render", "--job", tmp_path / "job.json", "-q", *outputs)
    parts = []
    for i, part in enumerate(job.split(2)):
        part.save(tmp_path / f"{i}.json")
        parts.append(tmp_path / f"{i}.npz")
        succeed("render", "--job", tmp_path / f"{i}.json", "-q", "-o", parts[-1])
    outputs, merged = pictures(tmp_path, "merged")
    told = succeed("merge", *parts, *outputs)
    assert check_same_pictures(whole, merged) == (LAYERS if aovs else {*"RGB"})
    assert ("a job made in Python has to ask for these AOVs" in told) == (not aovs)


@pytest.fixture
def raw_shards(tmp_path: Path) -> list[Path]:
    """Two shards without what a denoiser needs."""
    paths = [tmp_path / "raw-a.npz", tmp_path / "raw-b.npz"]
    for path, ends in zip(paths, ("0:8", "8:16"), strict=True):
        succeed("render", *SMALL, "-o", path, "--sample-range", ends, "-q", "--no-denoise")
    return paths


def test_merge_says_why_pictures_are_not_denoised(raw_shards: list[Path], tmp_path: Path) -> None:
    outputs, merged = pictures(tmp_path, "merged")
    told = succeed("merge", *raw_shards, *outputs, "-q")
    assert f"{merged[0]}: is not denoised, because {raw_shards[0]} has no AOVs albedo and normal" in told
    assert "Render shards without --no-denoise" in told
    assert succeed("merge", *raw_shards, *outputs, "-q", "--no-denoise") == ""
    assert succeed("merge", *raw_shards, "-o", tmp_path / "all.npz", "-q") == ""
    outputs, whole = pictures(tmp_path, "whole")
    succeed("render", *SMALL, "--spp", 16, *outputs, "--no-denoise")
    assert check_same_pictures(whole, merged) == {*"RGB"}


def test_merge_refuses_to_denoise_without_guides(raw_shards: list[Path], tmp_path: Path) -> None:
    result = run("merge", *raw_shards, "-o", tmp_path / "all.png", "--denoise")
    assert result.exit_code == 2
    assert f"--denoise: {raw_shards[0]} has no AOVs albedo and normal, by which pictures are" in result.stderr
    assert "Render shards without --no-denoise" in result.stderr
    succeed("render", "three-spheres", "--integrator", "classic", "-o", tmp_path / "c.npz", "--spp", 1, "-q")
    result = run("merge", tmp_path / "c.npz", "-o", tmp_path / "all.png", "--denoise")
    assert (result.exit_code, "is by classic, which has no noise" in result.stderr) == (2, True)
    assert not (tmp_path / "all.png").exists()


def test_merge_names_the_shard_that_lacks_what_a_denoiser_needs(raw_shards: list[Path], tmp_path: Path) -> None:
    guided = tmp_path / "guided.npz"
    succeed("render", *SMALL, "-o", guided, "--sample-range", "16:24", "-q")
    for order in ((*raw_shards, guided), (guided, *raw_shards)):
        result = run("merge", *order, "-o", tmp_path / "all.png")
        assert result.exit_code == 2
        assert f"{raw_shards[0]} has no AOVs albedo and normal, by which pictures are denoised." in result.stderr
        assert f"{guided} has no" not in result.stderr
        assert "Render shards without --no-denoise" in result.stderr
    other = tmp_path / "other.npz"
    succeed("render", *SMALL, "-o", other, "--sample-range", "24:32", "-q", "--seed", 1)
    result = run("merge", raw_shards[0], other, "-o", tmp_path / "all.png")
    assert "Merge shards of one render, all with the same AOVs." in result.stderr
    deep = tmp_path / "deep.npz"
    succeed("render", *SMALL, "-o", deep, "--sample-range", "24:32", "-q", "--aov", "depth")
    result = run("merge", guided, deep, "-o", tmp_path / "all.png")
    assert (result.exit_code, "all with the same AOVs" in result.stderr) == (2, True)


def test_merge_notes_what_an_uninterrupted_render_would_have_besides(
    shards: list[Path], make_film: MakeFilm, tmp_path: Path
) -> None:
    told = run("merge", *shards, "-o", tmp_path / "all.npz").stderr
    assert "no film holds path sets 16:40" in told
    make_film([(16, 40)], device="radeonsi").save(tmp_path / "other.npz")
    told = run("merge", *shards, tmp_path / "other.npz", "-o", tmp_path / "all.npz").stderr
    assert "no film holds" not in told
    assert "rendered by several devices (llvmpipe + radeonsi): the last bits may differ" in told


def test_merge_notes_that_a_denoiser_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    succeed("render", *SMALL, "-o", tmp_path / "a.npz", "--spp", 8, "-q")
    monkeypatch.setattr("glpath.film.denoise.can_denoise", lambda: False)
    told = succeed("merge", tmp_path / "a.npz", "-o", tmp_path / "all.exr")
    assert "not denoised: with pip install 'glpath[denoise]'" in told
    assert "not denoised" not in succeed("merge", tmp_path / "a.npz", "-o", tmp_path / "all.npz")
    channels = read_exr_channels(tmp_path / "all.exr")[0].keys()
    assert channels == {name for name in LAYERS if not name.startswith("denoised")}
