"""Shards: ranges of path sets that are rendered anywhere and merged, each once."""

from __future__ import annotations

import os
import shutil
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

import glpath
from glpath.film.film import Film, read_image
from glpath.jobs.shards import merge_shards
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
    assert run("merge", tmp_path / "all.npz", tmp_path / "all.npz", "-o", tmp_path / "all.npz").exit_code == 0
    assert np.array_equal(Film.load(tmp_path / "all.npz").radiance_sums, held.radiance_sums)


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
